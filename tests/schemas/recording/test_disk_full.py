"""A disk that fails ends the recording once, with a readable file and exact counts."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from schemas import messages as m
from schemas.errors import RecordingError
from schemas.recording import record_file
from schemas.recording.contents import schemas_attachment
from schemas.recording.reader import open_recording
from schemas.recording.writer import RecordingWriter
from tests.schemas.recording.recordings import (
    DONE,
    HEADER,
    Written,
    everything,
    messages,
    put,
)

COUNT = 600
STREAM = list(messages(COUNT))


class Disk:
    """Stands in for `os` under a recording: takes `room` bytes, and more when the reserve goes."""

    def __init__(
        self, room: int, reserve: int, code: int = errno.ENOSPC, *, frees: bool = True
    ) -> None:
        self.room, self.reserve, self.code, self.frees = room, reserve, code, frees

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)

    def write(self, fd: int, data: memoryview) -> int:
        if self.room <= 0:
            raise OSError(self.code, os.strerror(self.code))
        taken = os.write(fd, data[: self.room])
        self.room -= taken
        return taken

    def ftruncate(self, fd: int, length: int) -> None:
        self.room += self.frees * (os.fstat(fd).st_size - length)
        os.ftruncate(fd, length)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def install(monkeypatch: pytest.MonkeyPatch, disk: Disk) -> None:
    def release(file: record_file.RecordFile) -> None:
        if file._reserve is not None:
            file._reserve.close()
            file._reserve = None
            disk.room += disk.reserve

    monkeypatch.setattr(record_file, "os", disk)
    monkeypatch.setattr(record_file.RecordFile, "_release", release)


def record(
    path: Path, stream: list[Written], **options: Any
) -> tuple[RecordingWriter, list[RecordingError]]:
    """Write all of it, flushing at times; returns the errors it raised too."""
    writer = RecordingWriter(path, HEADER, **options)
    errors = []
    for n, sample in enumerate(stream):
        try:
            put(writer, sample)
            if n % 37 == 0:
                writer.write_statistics(m.Statistics(t_ns=n, received=n, recorded=n, gaps=n))
                writer.flush()
        except RecordingError as error:
            errors.append(error)
    try:
        writer.close(DONE)
    except RecordingError as error:
        errors.append(error)
    return writer, errors


def holds_what_it_counts(path: Path, writer: RecordingWriter, stream: list[Written]) -> str:
    """Returns the reason of the end the file names; empty where there was no room for one."""
    counts = writer.counts
    assert counts.received == len(stream) == counts.recorded + counts.dropped
    with open_recording(path) as recording:
        assert everything(recording) == stream[: counts.recorded]
        recording.check()
        if recording.end is None:
            assert recording.condition == "unfinished: no end"
            return ""
        if recording.end != DONE:
            assert recording.end.recorded == counts.recorded
        return recording.end.reason


HEADER_BYTES = len(schemas_attachment().data) + 2_000
WHOLE_BYTES = HEADER_BYTES + 76_000


@pytest.mark.parametrize("room", range(HEADER_BYTES, WHOLE_BYTES, 1_703))
def test_the_reserve_keeps_all_that_was_accepted(
    path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    install(monkeypatch, Disk(room, reserve=200_000))
    writer, errors = record(path, STREAM, reserve_bytes=1)
    reason = holds_what_it_counts(path, writer, STREAM)
    if reason == DONE.reason:  # all of it fitted, with the reserve at the latest when it was sealed
        assert errors == []
        assert writer.counts.dropped == 0
        return
    assert reason == "disk error: No space left on device"
    assert errors == [writer.error]
    with open_recording(path) as recording:
        assert recording.condition == ""
        assert recording.end is not None
        assert recording.end.dropped == 0  # the rest came after the end


@pytest.mark.parametrize("room", range(HEADER_BYTES, WHOLE_BYTES, 1_703))
def test_with_too_small_a_reserve_the_file_ends_at_the_last_whole_chunk(
    path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    install(monkeypatch, Disk(room, reserve=400, code=errno.EIO))
    writer, errors = record(path, STREAM, reserve_bytes=1)
    reason = holds_what_it_counts(path, writer, STREAM)
    assert reason in ("disk error: Input/output error", DONE.reason, "")
    assert errors == ([] if reason == DONE.reason else [writer.error])


@pytest.mark.parametrize("room", range(HEADER_BYTES, WHOLE_BYTES, 7_919))
def test_where_nothing_more_can_be_written_the_file_stays_unfinished_and_readable(
    path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    install(monkeypatch, Disk(room, reserve=0, frees=False))
    writer, errors = record(path, STREAM, reserve_bytes=1)
    assert errors == [writer.error]
    counts = writer.counts
    assert counts.received == COUNT == counts.recorded + counts.dropped
    with open_recording(path) as recording:
        assert everything(recording) == STREAM[: counts.recorded]
        assert recording.condition == "unfinished: no end"


def test_after_the_error_nothing_is_raised_and_everything_counted(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(monkeypatch, Disk(HEADER_BYTES, reserve=200_000))
    writer, errors = record(path, STREAM, reserve_bytes=1)
    assert errors == [writer.error]
    before = path.read_bytes()
    put(writer, STREAM[0])
    writer.write_statistics(m.Statistics(t_ns=1, received=1, recorded=1))
    writer.tick(1e9)
    writer.flush()
    writer.close(DONE)
    assert writer.counts.dropped == COUNT + 1 - writer.counts.recorded
    assert path.read_bytes() == before


def test_a_disk_too_full_to_begin_says_so(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, Disk(1_000, reserve=0))
    with pytest.raises(RecordingError, match="No space left"):
        RecordingWriter(path, HEADER, reserve_bytes=1)


def test_a_disk_without_room_for_the_reserve_is_refused_and_left_as_it_was(path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot record"):
        RecordingWriter(path, HEADER, reserve_bytes=2**60)
    assert list(path.parent.iterdir()) == []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of 2 MiB, where we may mount one."""
    mount = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(tmp_path)]
    try:
        mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    except OSError:
        mounted = False
    if not mounted:
        pytest.skip("a file system cannot be mounted here")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


def test_a_real_full_disk(small_disk: Path) -> None:
    stream = [w._replace(payload=os.urandom(3000)) for w in STREAM]
    path = small_disk / "run.mcap"
    writer, errors = record(path, stream, reserve_bytes=512 * 1024)
    assert errors == [writer.error]
    assert writer.counts.recorded > 300
    assert holds_what_it_counts(path, writer, stream) == "disk error: No space left on device"


LIMITED = """
import resource, sys
from pathlib import Path
from tests.schemas.recording.test_disk_full import (
    HEADER_BYTES, STREAM, holds_what_it_counts, record
)
for room in range(20_000, 24_000, 500):
    resource.setrlimit(resource.RLIMIT_FSIZE, (HEADER_BYTES + room, resource.RLIM_INFINITY))
    path = Path(sys.argv[1]).with_name(f"{room}.mcap")
    writer, errors = record(path, STREAM, reserve_bytes=1)
    reason = holds_what_it_counts(path, writer, STREAM)
    print(len(errors), writer.counts.recorded, reason, sep=";")
"""


def test_a_real_limit_on_the_size_of_a_file(path: Path) -> None:
    """A reserve beside the file makes no room in it: whether the end fits is chance."""
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    errors, recorded, reasons = zip(
        *(line.split(";") for line in done.stdout.splitlines()), strict=True
    )
    assert set(errors) == {"1"}
    assert all(0 < int(count) < COUNT for count in recorded)
    assert "disk error: File too large" in reasons
    assert set(reasons) <= {"disk error: File too large", ""}
