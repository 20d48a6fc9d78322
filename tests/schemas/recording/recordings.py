"""Recordings for tests: a plausible stream of messages, written and read back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from schemas import codec, keys
from schemas import messages as m
from schemas.recording.contents import Attachment, RunEnd, RunHeader
from schemas.recording.reader import Recording, open_recording
from schemas.recording.writer import RecordingWriter

EPOCH_NS = 1_767_225_600_000_000_000
HEADER = RunHeader(run="strait", scenario="strait", created_ns=EPOCH_NS, versions={"python": "3"})
DONE = RunEnd(reason="finished", received=9, recorded=8, dropped=1, gaps=2)
SMALL_RESERVE = 64 * 1024


class Written(NamedTuple):
    """What one call of the writer is given."""

    key: str
    payload: bytes
    encoding: str
    log_time_ns: int
    publish_time_ns: int
    sequence: int


def messages(count: int, logs: int = 3) -> Iterator[Written]:
    """Reports of two carriers, one in JSON, with closings and corrections in between."""
    for n in range(count):
        t_ns = EPOCH_NS + n * 1_000_000
        if n % 5 == 3:
            yield written(keys.CLOSED_FUSION.key("strait"), m.Closed(step=n + 1, t_ns=t_ns), t_ns)
        elif n % 5 == 4:
            key = keys.CORRECTION.key("strait", "fusion", "bravo")
            yield written(key, correction(n + 1, t_ns), t_ns)
        else:
            carrier, form = (("alpha", "msgpack"), ("bravo", "json"))[n % 2]
            yield written(
                keys.REPORT.key("strait", carrier, "radar"),
                report(carrier, n, t_ns, logs),
                t_ns,
                form,
            )


def written(key: str, message: msgspec.Struct, t_ns: int, form: str = "msgpack") -> Written:
    payload = codec.encode(message) if form == "msgpack" else codec.encode_json(message)
    sequence = getattr(message, "seq", getattr(message, "step", 0))
    encoding = codec.encoding_of(type(message), form)
    return Written(key, payload, encoding, t_ns, t_ns - 5, sequence)


def report(carrier: str, n: int, t_ns: int, logs: int) -> m.SourceReport:
    return m.SourceReport(
        carrier=carrier,
        boot="b1",
        stream="radar",
        seq=n + 1,
        t_ns=t_ns,
        bearing_rad=[0.001 * n % 6 + 0.1 * k for k in range(logs)],
        range_m=[5000.0 + n + k for k in range(logs)],
    )


def correction(step: int, t_ns: int) -> m.Correction:
    return m.Correction(
        centre="fusion",
        seq=step,
        step=step,
        t_ns=t_ns,
        carrier="bravo",
        id=f"bravo/{step}",
        state="observing",
    )


def scenario() -> m.DeclaredScenario:
    carriers = [m.DeclaredCarrier(name="alpha", sigma_position_m=100.0, sigma_north_rad=0.02)]
    return m.DeclaredScenario(
        name="strait",
        origin=m.Origin(latitude_rad=0.7, longitude_rad=0.5),
        epoch_ns=EPOCH_NS,
        step_ns=10**9,
        steps=3,
        carriers=carriers,
    )


def write(
    path: Path,
    stream: Iterable[Written],
    *,
    attachments: Iterable[Attachment] = (),
    flush_every: int = 0,
) -> list[Written]:
    """Write a finished recording; returns what went in."""
    done = []
    with RecordingWriter(
        path, HEADER, attachments=attachments, reserve_bytes=SMALL_RESERVE
    ) as writer:
        for sample in stream:
            put(writer, sample)
            done.append(sample)
            if flush_every and len(done) % flush_every == 0:
                writer.flush()
        writer.close(DONE)
    return done


def put(writer: RecordingWriter, sample: Written) -> None:
    writer.write(
        sample.key,
        sample.payload,
        sample.encoding,
        log_time_ns=sample.log_time_ns,
        publish_time_ns=sample.publish_time_ns,
        sequence=sample.sequence,
    )


def everything(recording: Recording) -> list[Written]:
    """All messages in the order of the file."""
    return [Written(*message[1:]) for message in recording.messages()]


def read(path: Path) -> list[Written]:
    with open_recording(path) as recording:
        return everything(recording)
