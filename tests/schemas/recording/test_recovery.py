"""Recovery: torn anywhere, a recording comes back as a gapless prefix with a whole index."""

import random
import struct
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from schemas import codec, keys
from schemas.errors import RecordingError
from schemas.messages import Step
from schemas.recording.contents import RunHeader, run_attachments
from schemas.recording.reader import open_recording
from schemas.recording.records import Source, frames
from schemas.recording.recovery import recover
from schemas.recording.writer import RecordingWriter, RunEnd
from tests.fusion_center.scenes import two_ships

KEY = keys.STEP.key("torn", *())
MESSAGES, EVERY = 4000, 500
SEED = 20260101


def payload(n: int, noise: bytes) -> bytes:
    return codec.encode(Step(boot="w", step=n, t_ns=n, ended=noise.hex()))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording in several chunks that hardly compress, so that tears fall into the midst."""
    path = tmp_path_factory.mktemp("recovery") / "whole.mcap"
    chance = random.Random(SEED)
    with RecordingWriter(
        path, RunHeader(run="torn"), attachments=run_attachments(two_ships().scenario())
    ) as writer:
        for n in range(1, MESSAGES + 1):
            other = keys.CLOSED_WORLD.key("torn") if n > MESSAGES // 2 and n % 3 == 0 else KEY
            writer.write(
                other, payload(n, chance.randbytes(120)), "m",
                log_time_ns=n, publish_time_ns=n, sequence=n,
            )  # fmt: skip
            if n % EVERY == 0:
                writer.flush()
        writer.close(RunEnd(reason="finished"))
    return path


def numbers(path: Path) -> list[int]:
    with open_recording(path) as recording:
        assert recording.condition == ""
        recording.check()
        return [message.sequence for message in recording.messages()]


def numbers_as_far(path: Path) -> list[int]:
    with open_recording(path) as recording:
        return [message.sequence for message in recording.messages()]


def torn_at(whole: Path, folder: Path, size: int) -> Path:
    path = folder / "torn.mcap"
    path.write_bytes(whole.read_bytes()[:size])
    return path


def first_chunk(whole: Path) -> int:
    with open_recording(whole) as recording:
        return min(span.offset for span in recording.index.spans)


def test_torn_anywhere_it_is_a_gapless_prefix(whole: Path, tmp_path: Path) -> None:
    chance, size = random.Random(SEED), whole.stat().st_size
    for _ in range(60):
        cut = chance.randrange(first_chunk(whole), size)
        path = torn_at(whole, tmp_path, cut)
        with open_recording(path) as recording:
            readable = sum(recording.index.counts.values())
        found = recover(path)
        assert numbers(path) == list(range(1, found.messages + 1))
        assert found.messages >= readable
        assert found.damage == ()
        assert (found.salvaged > 0) <= (found.messages > readable)
        with open_recording(path) as recording:
            assert recording.end is not None
            assert recording.end.torn or recording.end.reason == "finished"
            assert recording.scenario


def test_the_torn_chunk_is_salvaged(whole: Path, tmp_path: Path) -> None:
    with open_recording(whole) as recording:
        spans = sorted(recording.index.spans)
    span = max(spans, key=lambda span: span.end - span.offset)
    path = torn_at(whole, tmp_path, span.offset + 9 * (span.end - span.offset) // 10)
    before = sum(1 for s in spans if s.offset < span.offset) * EVERY
    found = recover(path)
    assert found.salvaged > EVERY // 10
    assert found.messages == before + found.salvaged


def test_of_a_torn_chunk_what_makes_no_sense_is_left(whole: Path, tmp_path: Path) -> None:
    """Nothing says whether it is right: not compressed, it may hold anything."""
    head = whole.read_bytes()[: len(whole.read_bytes()) // 2]
    before = numbers_as_far(torn_at(whole, tmp_path, len(head)))
    source = Source(tmp_path / "torn.mcap")
    end = max(frame.end for frame in frames(source, 8))
    source.close()
    chance = random.Random(SEED)
    for kind in (3, 4, 5, 5, 5):
        inner = bytes([kind]) + (40).to_bytes(8, "little") + chance.randbytes(40)
        inner += bytes([5]) + (3).to_bytes(8, "little") + b"abc"
        fields = struct.pack("<QQQIL", 0, 2**63, 10**6, 0, 0) + (10**6).to_bytes(8, "little")
        torn = bytes([6]) + (10**6).to_bytes(8, "little") + fields + inner
        (tmp_path / "torn.mcap").write_bytes(head[:end] + torn)
        assert recover(tmp_path / "torn.mcap").salvaged == 0
        assert numbers(tmp_path / "torn.mcap") == before


def test_recovered_twice_is_recovered_once(whole: Path, tmp_path: Path) -> None:
    path = torn_at(whole, tmp_path, whole.stat().st_size * 2 // 3)
    assert not recover(path).was_whole
    once = path.read_bytes()
    assert recover(path).was_whole
    assert path.read_bytes() == once


def test_what_is_whole_is_not_touched(whole: Path) -> None:
    before = whole.read_bytes()
    found = recover(whole)
    assert found.was_whole
    assert found.messages == MESSAGES
    assert whole.read_bytes() == before


def test_torn_within_the_index_only_the_index_is_made_anew(whole: Path, tmp_path: Path) -> None:
    path = torn_at(whole, tmp_path, whole.stat().st_size - 20)
    assert recover(path).messages == MESSAGES
    with open_recording(path) as recording:
        assert recording.end == RunEnd(reason="finished")


def test_the_librarys_own_reader_reads_what_was_recovered(whole: Path, tmp_path: Path) -> None:
    path = torn_at(whole, tmp_path, whole.stat().st_size // 2)
    found = recover(path)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary().statistics.message_count == found.messages
        read = [m.sequence for _, _, m in reader.iter_messages()]
        one_key = [m.sequence for _, _, m in reader.iter_messages(topics=[KEY])]
    assert read == list(range(1, found.messages + 1))
    assert one_key == [n for n in read if n <= MESSAGES // 2 or n % 3]


def test_damaged_in_its_midst_it_is_left_alone_and_all_that_is_good_is_copied(
    whole: Path, tmp_path: Path
) -> None:
    with open_recording(whole) as recording:
        span = sorted(recording.index.spans)[3]
    path, target = tmp_path / "bad.mcap", tmp_path / "good.mcap"
    data = bytearray(whole.read_bytes())
    data[(span.offset + span.end) // 2] ^= 0x10
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="--output NEW"):
        recover(path)
    assert path.read_bytes() == data
    found = recover(path, target)
    assert len(found.damage) >= 1
    assert found.lost_bytes >= span.end - span.offset
    lost = set(range(3 * EVERY + 1, 4 * EVERY + 1))
    assert numbers(target) == [n for n in range(1, MESSAGES + 1) if n not in lost]


def test_zeros_at_the_end_are_cut_off(whole: Path, tmp_path: Path) -> None:
    """As some file systems leave a file when the power goes."""
    path = torn_at(whole, tmp_path, whole.stat().st_size // 2)
    with path.open("ab") as file:
        file.write(bytes(5000))
    recover(path)
    assert numbers(path) == list(range(1, len(numbers(path)) + 1))
    assert len(numbers(path)) >= MESSAGES // 2 - 2 * EVERY


def test_a_flipped_bit_never_gives_a_wrong_message(whole: Path, tmp_path: Path) -> None:
    chance, good = random.Random(SEED), whole.read_bytes()
    with open_recording(whole) as recording:
        payloads = {m.sequence: m.payload for m in recording.messages()}
    path, target = tmp_path / "bad.mcap", tmp_path / "good.mcap"
    for _ in range(30):
        data = bytearray(good)
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        path.write_bytes(data)
        target.unlink(missing_ok=True)
        try:
            recover(path, target)
        except RecordingError:
            continue
        with open_recording(target) as recording:
            recording.check()
            for message in recording.messages():
                assert payloads[message.sequence] == message.payload


@pytest.mark.parametrize(
    "content", [b"", b"not MCAP", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + b"x" * 99]
)
def test_what_is_no_recording_is_left_alone(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "no.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError):
        recover(path)
    assert path.read_bytes() == content


def test_a_folder_and_nothing_are_errors(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none"):
        with pytest.raises(RecordingError):
            recover(path)


def test_a_hundred_megabytes_would_take_a_second(tmp_path: Path) -> None:
    """Of processor time, twice the demand: a short file bears the fixed costs alone."""
    path, noise = tmp_path / "large.mcap", random.Random(SEED).randbytes(400)
    with RecordingWriter(path, RunHeader(run="torn")) as writer:
        chance = random.Random(SEED)
        for n in range(1, 40_000):
            body = payload(n, chance.randbytes(400)) if n % 2 else payload(n, noise)
            writer.write(KEY, body, "m", log_time_ns=n, publish_time_ns=n, sequence=n)
    size = path.stat().st_size - 1000
    with path.open("r+b") as file:
        file.truncate(size)
    started_s = time.process_time()
    recover(path)
    assert (time.process_time() - started_s) / size < 2 / 100e6
