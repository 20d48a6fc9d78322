"""Into the file: messages and megabytes a second beside the library's writer; memory an hour."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from mcap.writer import CompressionType, Writer

from bench.figures import Figure, at_most, scaled_seconds, time_ratio, told
from schemas.recording.contents import RunEnd, RunHeader
from schemas.recording.writer import RecordingWriter

from .samples import ENCODING, LARGE_BYTES, SMALL_BYTES, Message, payloads, stream

HEADER = RunHeader(run="bench")
DONE = RunEnd(reason="finished")
HOUR = """
import sys
from bench.recording.writing import an_hour
print(an_hour(sys.argv[1], int(sys.argv[2])))
"""


def figures(folder: Path, seed: int, size: float) -> Iterator[Figure]:
    """Of the writers alone, without a bus."""
    for name, length in (("200 B", SMALL_BYTES), ("2 kB", LARGE_BYTES)):
        data = payloads(seed, length, 2000)
        messages = stream(data, max(2000, round(100_000 * size)))

        def ours(messages: Sequence[Message] = messages) -> None:
            """By our writer."""
            write(folder / "ours.mcap", messages)

        def theirs(messages: Sequence[Message] = messages) -> None:
            """By the library's."""
            write_plainly(folder / "theirs.mcap", messages)

        took_s = scaled_seconds(ours, 3)
        megabytes = sum(len(message.payload) for message in messages) / 1e6
        yield told(f"writer alone, {name}: messages", len(messages) / took_s, "msg/s")
        yield told(f"writer alone, {name}: bytes", megabytes / took_s, "MB/s")
        ratio = time_ratio(ours, theirs, 3)
        yield at_most(f"writer alone, {name}: time / mcap's writer", ratio, 1.0)
    seconds = max(60, round(3600 * size))
    command = [sys.executable, "-c", HOUR, str(folder / "hour.mcap"), str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    grown_mb = float(done.stdout) * 3600 / seconds
    yield at_most("memory grows at 200 msg/s", grown_mb, 20, "MB/h")


def write(path: Path, messages: Sequence[Message]) -> None:
    """By our writer."""
    path.unlink(missing_ok=True)
    with RecordingWriter(path, HEADER) as writer:
        for message in messages:
            writer.write(
                message.key,
                message.payload,
                ENCODING,
                log_time_ns=message.t_ns,
                publish_time_ns=message.t_ns,
                sequence=message.seq,
            )
        writer.close(DONE)


def write_plainly(path: Path, messages: Sequence[Message]) -> None:
    """By the library's writer, with the same chunks, compression and checksums."""
    with path.open("wb") as file:
        writer = Writer(
            file, chunk_size=256 * 1024, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        writer.start()
        schema = writer.register_schema("crossfix.SourceReport", "jsonschema", b"{}")
        channels: dict[str, int] = {}
        for message in messages:
            channel = channels.get(message.key)
            if channel is None:
                channel = writer.register_channel(message.key, "msgpack", schema)
                channels[message.key] = channel
            writer.add_message(channel, message.t_ns, message.payload, message.t_ns, message.seq)
        writer.finish()  # type: ignore[no-untyped-call]


def an_hour(path: str, seconds: int) -> float:
    """Growth of the resident memory [MB] of 200 messages a second, flushed as in an hour."""
    data = payloads(1, SMALL_BYTES, 2000)
    messages = iter(stream(data, 2000))
    before_kib = 0
    with RecordingWriter(path, HEADER) as writer:
        for quarter in range(4 * seconds):
            for _ in range(50):
                message = next(messages, None)
                if message is None:
                    messages = iter(stream(data, 2000))
                    message = next(messages)
                writer.write(
                    message.key,
                    message.payload,
                    ENCODING,
                    log_time_ns=message.t_ns,
                    publish_time_ns=message.t_ns,
                    sequence=message.seq,
                )
            writer.tick(0.25 * quarter)
            if quarter == 40:
                before_kib = resident_kib()
        return (resident_kib() - before_kib) / 1024


def resident_kib(what: str = "VmRSS") -> int:
    """Memory of this process that is in the machine now; `VmHWM` = the most there ever was."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split(f"{what}:")[1].split()[0])
