"""Cut or altered files give a prefix of what was written or an error, never anything else."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from schemas.errors import RecordingError
from schemas.recording.contents import RunHeader, run_attachments
from schemas.recording.reader import open_recording, summary
from tests.schemas.recording.recordings import (
    DONE,
    HEADER,
    Written,
    messages,
    scenario,
    write,
)

STREAM = list(messages(120))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A finished recording of several chunks."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    write(path, STREAM, attachments=run_attachments(scenario()), flush_every=10)
    return path.read_bytes()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def read_as_far_as_it_goes(path: Path) -> tuple[list[Written], RecordingError | None]:
    found: list[Written] = []
    try:
        with open_recording(path) as recording:
            assert recording.header == HEADER
            found.extend(Written(*message[1:]) for message in recording.messages())
            assert recording.end in (None, DONE)
            assert recording.scenario == scenario()
    except RecordingError as error:
        return found, error
    return found, None


def check_all(path: Path) -> None:
    """Anything wrong is an error here, also what reading the messages can do without."""
    with open_recording(path) as recording:
        recording.check()
        if recording.condition:
            raise RecordingError(recording.condition)


def chunk_offsets(whole: bytes) -> list[int]:
    """Offset of every chunk, by its opcode and where the name of its compression is."""
    places = [i.start() for i in re.finditer(b"zstd", whole)]
    return [at - 41 for at in places if whole[at - 41] == 0x06]


def test_a_file_cut_anywhere_gives_a_prefix(whole: bytes, path: Path) -> None:
    lengths = {0, 1, 7, 8, 9, len(whole) - 1, len(whole) - 8, len(whole) - 38}
    lengths |= set(random.Random(1).sample(range(len(whole)), 400))
    read_before = 0
    for length in sorted(lengths):
        path.write_bytes(whole[:length])
        found, error = read_as_far_as_it_goes(path)
        assert found == STREAM[: len(found)]
        assert len(found) >= read_before
        read_before = len(found)
        if found:
            assert error is None
            assert summary(path).condition != ""
            assert summary(path).messages == len(found)
    assert read_before == len(STREAM)


def test_a_cut_file_loses_only_the_chunk_it_is_cut_in(whole: bytes, path: Path) -> None:
    chunks = chunk_offsets(whole)
    assert len(chunks) == 12
    for n, offset in enumerate(chunks):
        path.write_bytes(whole[: offset + 60])
        found, error = read_as_far_as_it_goes(path)
        assert found == STREAM[: 10 * n]
        assert error is None
        condition = summary(path).condition
        assert condition == f"unfinished: torn at byte {offset}, 60 bytes of it not read"


def test_bytes_after_a_tear_are_not_taken_for_records(whole: bytes, path: Path) -> None:
    """What a lost power leaves at the end: zeros, or blocks of something else."""
    cut = chunk_offsets(whole)[8] + 60
    for rubbish in (bytes(4096), b"\xff" * 4096, random.Random(2).randbytes(4096)):
        path.write_bytes(whole[:cut] + rubbish)
        found, error = read_as_far_as_it_goes(path)
        assert found == STREAM[: len(found)]
        assert len(found) >= 10
        assert error is not None or summary(path).condition.startswith("unfinished")


@pytest.mark.parametrize("seed", range(4))
def test_an_altered_bit_is_found(whole: bytes, path: Path, seed: int) -> None:
    """Reading gives what was written up to the error; a check of the whole file finds any bit."""
    rng = random.Random(seed)
    for _ in range(60):
        altered = bytearray(whole)
        altered[rng.randrange(8, len(whole))] ^= 1 << rng.randrange(8)
        path.write_bytes(altered)
        found, error = read_as_far_as_it_goes(path)
        assert found == STREAM[: len(found)]
        assert error is not None or len(found) == len(STREAM)
        with pytest.raises(RecordingError):
            check_all(path)


@pytest.mark.parametrize("seed", range(2))
def test_an_altered_bit_of_an_unfinished_file_is_found_or_ends_it(
    whole: bytes, path: Path, seed: int
) -> None:
    rng = random.Random(seed)
    unfinished = whole[: len(whole) * 2 // 3]
    for _ in range(60):
        altered = bytearray(unfinished)
        altered[rng.randrange(8, len(altered))] ^= 1 << rng.randrange(8)
        path.write_bytes(altered)
        found, _ = read_as_far_as_it_goes(path)
        assert found == STREAM[: len(found)]


def test_a_damaged_chunk_is_named_after_what_lies_before_it(whole: bytes, path: Path) -> None:
    altered = bytearray(whole)
    offset = chunk_offsets(whole)[7]
    altered[offset + 100] ^= 1
    path.write_bytes(altered)
    found, error = read_as_far_as_it_goes(path)
    assert found == STREAM[:70]
    assert str(error).startswith(f"{path} at byte {offset}: chunk: ")


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "empty file"),
        (b"\x89MCA", "not an MCAP file"),
        (b"SQLite format 3\0" * 10, "not an MCAP file"),
        (b"\x89MCAP1\r\n" + bytes(100), "another version of MCAP; got b'1'"),
        (b"\x89MCAP0\r\n", "not a recording of crossfix"),
    ],
)
def test_what_is_no_recording_is_refused_in_words(path: Path, content: bytes, why: str) -> None:
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=why) as caught:
        open_recording(path)
    assert str(path) in str(caught.value)


def test_a_directory_and_a_missing_file_are_refused_in_words(path: Path) -> None:
    with pytest.raises(RecordingError, match="Is a directory"):
        open_recording(path.parent)
    with pytest.raises(RecordingError, match="No such file"):
        summary(path)


def test_the_header_is_the_one_written(whole: bytes, path: Path) -> None:
    """MCAP has no checksum over metadata; ours has."""
    altered = whole.replace(b"strait", b"streit", 1)
    assert altered != whole
    path.write_bytes(altered)
    with pytest.raises(RecordingError, match="metadata damaged"):
        open_recording(path)
    assert RunHeader(run="strait") != RunHeader(run="streit")
