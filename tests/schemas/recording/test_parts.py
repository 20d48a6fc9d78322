"""A recording in parts: each can be read alone, together they hold everything once."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from schemas import keys
from schemas.errors import RecordingError
from schemas.recording import parts as parts_module
from schemas.recording.contents import NEXT_PART, run_attachments
from schemas.recording.parts import Limits, PartedWriter, Safety, part_path, parts_of
from schemas.recording.reader import open_recording
from tests.schemas.recording.recordings import (
    DONE,
    EPOCH_NS,
    HEADER,
    SMALL_RESERVE,
    Written,
    everything,
    messages,
    put,
    scenario,
)

STREAM = list(messages(3000))
SMALL = Safety(reserve_bytes=SMALL_RESERVE)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def record(path: Path, limits: Limits, stream: list[Written] = STREAM) -> PartedWriter:
    writer = PartedWriter(
        path, HEADER, attachments=run_attachments(scenario()), limits=limits, safety=SMALL
    )
    with writer:
        for n, sample in enumerate(stream):
            put(writer, sample)
            if n % 100 == 99:
                writer.flush()
        writer.close(DONE)
    return writer


def own(path: Path) -> list[Written]:
    """The messages of a part but for those that it repeats."""
    with open_recording(path) as recording:
        return everything(recording)[recording.header.repeated :]


@pytest.mark.parametrize("limits", [Limits(part_bytes=100_000), Limits(part_s=0.35)])
def test_parts_together_hold_everything_once(path: Path, limits: Limits) -> None:
    writer = record(path, limits)
    assert len(writer.parts) > 3
    assert parts_of(path) == writer.parts
    assert [message for part in writer.parts for message in own(part)] == STREAM
    assert writer.counts[:3] == (len(STREAM), len(STREAM), 0)
    assert writer.counts.bytes == sum(part.stat().st_size for part in writer.parts)


def test_every_part_can_be_read_alone(path: Path) -> None:
    writer = record(path, Limits(part_s=0.5))
    latched = {w.key for w in STREAM if keys.parse(w.key).topic.latched}
    assert latched
    for number, part in enumerate(writer.parts, start=1):
        with open_recording(part) as recording:
            recording.check()
            assert recording.condition == ""
            assert recording.header.part == number
            assert recording.scenario == scenario()
            assert recording.end is not None
            last = number == len(writer.parts)
            assert recording.end.reason == (DONE.reason if last else NEXT_PART)
            first = everything(recording)[: recording.header.repeated]
            assert {w.key for w in first} == (latched if number > 1 else set())


def test_a_part_begins_with_the_latched_values_of_its_first_instant(path: Path) -> None:
    writer = record(path, Limits(part_s=0.5))
    for part in writer.parts[1:]:
        begin_ns = own(part)[0].log_time_ns
        with open_recording(part) as recording:
            repeated = everything(recording)[: recording.header.repeated]
        for found in repeated:
            before = [w for w in STREAM if w.key == found.key and w.log_time_ns < begin_ns]
            assert found.payload == before[-1].payload
            assert found.publish_time_ns == before[-1].publish_time_ns
            assert found.log_time_ns == begin_ns


def test_a_part_spans_no_more_time_than_it_may(path: Path) -> None:
    for part in record(path, Limits(part_s=0.5)).parts:
        times_ns = [w.log_time_ns for w in own(part)]
        assert times_ns[-1] - times_ns[0] < 0.5e9


def test_a_ring_keeps_the_last_parts(path: Path) -> None:
    writer = record(path, Limits(part_s=0.5, keep=2))
    assert parts_of(path) == writer.parts
    assert [part.name for part in writer.parts] == ["run.0005.mcap", "run.0006.mcap"]
    assert [message for part in writer.parts for message in own(part)] == STREAM[2000:]
    assert writer.counts.recorded == len(STREAM)


def test_without_limits_it_is_one_file(path: Path) -> None:
    assert record(path, Limits()).parts == [path]
    assert parts_of(path) == [path]
    assert own(path) == STREAM


def test_a_split_that_is_asked_for(path: Path) -> None:
    with PartedWriter(path, HEADER, limits=Limits(part_s=1e6), safety=SMALL) as writer:
        for n, sample in enumerate(STREAM[:30]):
            put(writer, sample)
            if n == 9:
                writer.split()
        writer.close(DONE)
    assert [len(own(part)) for part in writer.parts] == [10, 20]


def test_parts_are_numbered_beyond_four_digits(tmp_path: Path) -> None:
    for part in (2, 10000, 9999):
        part_path(tmp_path / "run.mcap", part).touch()
    (tmp_path / "run.x001.mcap").touch()
    (tmp_path / "other.0001.mcap").touch()
    names = [part.name for part in parts_of(tmp_path / "run.mcap")]
    assert names == ["run.0002.mcap", "run.9999.mcap", "run.10000.mcap"]


def test_the_oldest_parts_make_room_on_the_disk(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def free_bytes(folder: Path) -> int:
        return 1_000_000 - sum(file.stat().st_size for file in folder.iterdir())

    monkeypatch.setattr(parts_module, "_free_bytes", free_bytes)
    limits = Limits(part_s=0.5, keep=100, min_free_bytes=400_000)
    with PartedWriter(path, HEADER, limits=limits, safety=SMALL) as writer:
        for n, sample in enumerate(STREAM):
            put(writer, sample)
            writer.tick(n)
            assert free_bytes(path.parent) >= 390_000
        writer.close(DONE)
    assert 1 < len(writer.parts) < 6
    assert writer.error is None
    assert own(writer.parts[-1])[-1] == STREAM[-1]


def test_a_recording_ends_before_the_disk_is_full(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = iter([10**9] * 5 + [10**6] * 5)
    monkeypatch.setattr(parts_module, "_free_bytes", lambda _: next(free))
    writer = PartedWriter(path, HEADER, limits=Limits(min_free_bytes=10**7), safety=SMALL)
    errors = []
    for n, sample in enumerate(STREAM[:20]):
        try:
            put(writer, sample)
            writer.tick(n)
        except RecordingError as error:
            errors.append(error)
    writer.close(DONE)
    assert errors == [writer.error]
    assert "less than 10000000 bytes free" in str(errors[0])
    assert writer.counts[:3] == (20, 6, 14)
    with open_recording(path) as recording:
        recording.check()
        assert everything(recording) == STREAM[:6]
        assert recording.end is not None
        assert recording.end.reason.startswith("disk error: less than")


def test_where_no_next_part_can_be_made_the_last_one_is_whole_and_the_rest_counted(
    path: Path,
) -> None:
    writer = PartedWriter(path, HEADER, limits=Limits(part_s=0.5), safety=SMALL)
    part_path(path, 3).write_bytes(b"somebody else's")
    errors = []
    for sample in STREAM:
        try:
            put(writer, sample)
        except RecordingError as error:
            errors.append(error)
    writer.close(DONE)
    assert errors == [writer.error]
    assert os.strerror(errno.EEXIST) in str(errors[0])
    assert writer.counts[:3] == (3000, 1000, 2000)
    assert [m for part in writer.parts for m in own(part)] == STREAM[:1000]
    assert part_path(path, 3).read_bytes() == b"somebody else's"


def test_epochs_of_zero_do_not_confuse_the_clock(path: Path) -> None:
    early = [w._replace(log_time_ns=w.log_time_ns - EPOCH_NS) for w in STREAM]
    writer = record(path, Limits(part_s=0.5), early)
    assert [message for part in writer.parts for message in own(part)] == early
