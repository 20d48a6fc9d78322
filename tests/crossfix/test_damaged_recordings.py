"""Every verb that reads a recording meets every bad one: one line and a code, never a traceback."""

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer
from msgspec.structs import replace

from crossfix.making import attachments_of, put, writing
from schemas.recording.contents import FORMAT, RUN, RunEnd, to_metadata
from schemas.recording.reader import open_recording
from tests.crossfix.conftest import Crossfix
from tests.crossfix.remade import everything, remade
from tests.crossfix.small_recording import record

SEED = 20260101
SAMPLES = 10
NEW = "{new}"
VERBS: dict[str, tuple[str, ...]] = {
    "info": (),
    "verify": ("--refuse",),
    "refuse": ("-o", NEW),
    "recover": ("-o", NEW),
    "cut": ("-o", NEW),
    "merge": ("{path}", "-o", NEW),
    "cat": (),
    "diff": ("{path}",),
    "foxglove": ("-o", NEW),
    "csv": ("-o", NEW),
    "czml": ("-o", NEW),
    "report": ("--json",),
}
"""Verb or format -> what follows the recording."""
REFUSED, TAKEN = 2, (0, 1)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("good") / "good.mcap"
    record(path)
    return path


@pytest.fixture
def run(tmp_path: Path, crossfix: Crossfix) -> Callable[[str, Path], int]:
    """Run a verb on a recording; its code, after a look at what it has printed."""
    made = iter(range(10**6))

    def run_verb(verb: str, path: Path) -> int:
        new = tmp_path / f"new{next(made)}"
        rest = [a.format(new=new, path=path) for a in VERBS[verb]]
        start = ("export", verb) if verb in ("foxglove", "csv", "czml") else (verb,)
        shown = crossfix(*start, path, *rest)
        if shown.code == REFUSED:
            assert shown.err.startswith("error: "), (verb, shown)
            assert len(shown.err.splitlines()) == 1, (verb, shown)
            assert verb == "csv" or not new.exists()
        else:
            assert shown.code in TAKEN, (verb, shown)
        return shown.code

    return run_verb


def other_makers(path: Path) -> None:
    """A whole MCAP file that is no recording of ours."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", "cdr", schema)
        writer.add_message(channel, 1, b"hello", 1)
        writer.finish()


def newer(good: Path, path: Path) -> None:
    """As a later version may write it."""
    with open_recording(good) as recording:
        header = replace(recording.header, format=FORMAT + 1)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="crossfix")
        writer.add_metadata(RUN, to_metadata(header))
        writer.finish()


@pytest.mark.parametrize("verb", VERBS)
def test_what_is_no_recording_is_refused(
    verb: str, good: Path, tmp_path: Path, run: Callable[[str, Path], int]
) -> None:
    bad = tmp_path / "bad"
    bad.mkdir()
    (bad / "empty.mcap").touch()
    (bad / "text.mcap").write_text("time,x,y\n")
    (bad / "head.mcap").write_bytes(good.read_bytes()[:20])
    (bad / "noise.mcap").write_bytes(random.Random(SEED).randbytes(5000))
    other_makers(bad / "other.mcap")
    newer(good, bad / "newer.mcap")
    for path in (bad, tmp_path / "none.mcap", *sorted(bad.iterdir())):
        assert run(verb, path) == REFUSED, path


@pytest.mark.parametrize("verb", VERBS)
def test_cut_off_anywhere(
    verb: str, good: Path, tmp_path: Path, run: Callable[[str, Path], int]
) -> None:
    data, chance, path = good.read_bytes(), random.Random(SEED), tmp_path / "torn.mcap"
    for size in sorted(chance.sample(range(len(data)), SAMPLES)):
        path.write_bytes(data[:size])
        run(verb, path)


@pytest.mark.parametrize("verb", VERBS)
def test_any_bit_flipped(
    verb: str, good: Path, tmp_path: Path, run: Callable[[str, Path], int]
) -> None:
    data, chance, path = good.read_bytes(), random.Random(SEED), tmp_path / "flipped.mcap"
    for place in sorted(chance.sample(range(len(data)), SAMPLES)):
        flipped = bytearray(data)
        flipped[place] ^= 1 << chance.randrange(8)
        path.write_bytes(flipped)
        run(verb, path)


@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb not in ("recover", "info")])
def test_without_its_scenario(
    verb: str, good: Path, tmp_path: Path, run: Callable[[str, Path], int]
) -> None:
    path = tmp_path / "bare.mcap"
    with open_recording(good) as recording, writing(path, recording.header, []) as writer:
        for message in recording.messages():
            put(writer, message)
        writer.close(RunEnd(reason="finished"))
    needs_it = {"verify", "refuse", "merge", "foxglove", "czml", "report"}
    assert (run(verb, path) == REFUSED) == (verb in needs_it)


@pytest.mark.parametrize("verb", VERBS)
def test_channels_of_others_are_passed_over(
    verb: str, good: Path, tmp_path: Path, run: Callable[[str, Path], int]
) -> None:
    """By the plain library, with lz4, and with a channel that no key of ours names."""
    path = tmp_path / "foreign.mcap"
    with open_recording(good) as recording, path.open("wb") as file:
        writer = Writer(file, chunk_size=2000, compression=CompressionType.LZ4)
        writer.start(profile="crossfix")
        for metadata in recording.index.metadata:
            writer.add_metadata(metadata.name, metadata.metadata)
        for a in attachments_of(recording):
            writer.add_attachment(0, 0, a.name, a.media_type, a.data)
        schema = writer.register_schema("x", "", b"")
        strange = writer.register_channel("/chatter", "cdr", schema)
        writer.add_message(strange, 0, b"hello", 0)
        ids = {key: writer.register_channel(key, "msgpack", schema)
               for key in {m.key for m in recording.messages()}}  # fmt: skip
        for m in recording.messages():
            writer.add_message(ids[m.key], m.log_time_ns, m.payload, m.publish_time_ns, m.sequence)
        writer.finish()
    assert len(everything(path)) == len(everything(good))
    assert run(verb, path) == 0


@pytest.mark.parametrize("verb", VERBS)
def test_payloads_that_are_no_messages(
    verb: str, good: Path, tmp_path: Path, run: Callable[[str, Path], int]
) -> None:
    """What the bus has refused may still be recorded; nothing else is lost by it."""
    chance = random.Random(SEED)

    def spoil(message):
        bad = message._replace(payload=chance.randbytes(30), sequence=message.sequence + 1000)
        return [message, bad]

    path = remade(good, tmp_path / "spoilt.mcap", spoil)
    run(verb, path)
