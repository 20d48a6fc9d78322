"""A recording is read while it is written, and copied while it goes on."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from schemas import keys
from schemas.errors import RecordingError
from schemas.recording.contents import run_attachments
from schemas.recording.follow import Follower, follow
from schemas.recording.parts import Limits, PartedWriter, Safety
from schemas.recording.reader import open_recording
from schemas.recording.recorded import Recorded
from schemas.recording.snapshot import main, snapshot
from schemas.recording.writer import RecordingWriter
from tests.schemas.recording.recordings import (
    DONE,
    HEADER,
    SMALL_RESERVE,
    Written,
    everything,
    messages,
    put,
    scenario,
)

STREAM = list(messages(1000))
SMALL = Safety(reserve_bytes=SMALL_RESERVE)
DEADLINE_S = 30


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def written(found: Iterator[Recorded] | list[Recorded]) -> list[Written]:
    return [Written(*message[1:]) for message in found]


def test_what_is_flushed_is_read_once_and_at_once(path: Path) -> None:
    with RecordingWriter(path, HEADER, reserve_bytes=SMALL_RESERVE) as writer:
        follower = Follower(path)
        assert written(follower.news()) == []
        for start in range(0, 1000, 100):
            for sample in STREAM[start : start + 100]:
                put(writer, sample)
            assert written(follower.news()) == []
            writer.flush()
            assert written(follower.news()) == STREAM[start : start + 100]
        assert follower.end is None
        writer.close(DONE)
        assert written(follower.news()) == []
        assert follower.end == DONE
        follower.close()


def test_half_a_record_is_waited_for(path: Path, tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    with RecordingWriter(whole, HEADER, reserve_bytes=SMALL_RESERVE) as writer:
        for sample in STREAM:
            put(writer, sample)
            if sample.sequence % 97 == 0:
                writer.flush()
        writer.close(DONE)
    data = whole.read_bytes()
    path.touch()  # as it is for a moment when its recorder begins it
    follower, found = Follower(path), list[Written]()
    for length in (0, 1, 7, 8, 9, *range(100, len(data), 1733)):
        path.write_bytes(data[:length])
        found += written(follower.news())
        assert found == STREAM[: len(found)]
    path.write_bytes(data)
    found += written(follower.news())
    assert found == STREAM
    assert follower.end == DONE
    follower.close()


WRITER = """
import sys, time
from pathlib import Path
from schemas.recording.parts import Limits, PartedWriter
from tests.schemas.recording.test_following import DONE, HEADER, SMALL, STREAM, put
limits = Limits(part_s=float(sys.argv[2]))
with PartedWriter(Path(sys.argv[1]), HEADER, limits=limits, safety=SMALL) as writer:
    print("ready", flush=True)
    for n, sample in enumerate(STREAM):
        put(writer, sample)
        if n % 50 == 0:
            writer.flush()
            time.sleep(0.005)
    writer.close(DONE)
"""


@pytest.mark.parametrize("part_s", ["0", "0.3"])
def test_another_process_is_followed_to_its_end_over_all_parts(path: Path, part_s: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), part_s], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        found = [m for m in follow(path, poll_s=0.002)]  # noqa: C416 - it ends by itself
        assert process.wait(DEADLINE_S) == 0
    own = [w for w in written(found)]  # noqa: C416
    if part_s == "0":
        assert own == STREAM
    else:  # each part begins with the latched values of the one before
        assert [w for w in own if not keys.parse(w.key).topic.latched] == [
            w for w in STREAM if not keys.parse(w.key).topic.latched
        ]
        assert set(STREAM) <= set(own)


def test_who_has_enough_ends_it(path: Path) -> None:
    with RecordingWriter(path, HEADER, reserve_bytes=SMALL_RESERVE) as writer:
        put(writer, STREAM[0])
        writer.flush()
        assert written(follow(path, is_over=lambda: True)) == STREAM[:1]


def test_nothing_cannot_be_followed(path: Path) -> None:
    with pytest.raises(RecordingError, match="no such recording"):
        next(follow(path))


def test_damage_ends_it_with_an_error(path: Path) -> None:
    with RecordingWriter(path, HEADER, reserve_bytes=SMALL_RESERVE) as writer:
        for sample in STREAM[:50]:
            put(writer, sample)
        writer.close(DONE)
    with open_recording(path) as recording:
        chunk = recording.index.spans[0]
    data = bytearray(path.read_bytes())
    data[(chunk.offset + chunk.end) // 2] ^= 1
    path.write_bytes(data)
    follower = Follower(path)
    with pytest.raises(RecordingError):
        list(follower.news())
    follower.close()


@pytest.mark.parametrize("limits", [Limits(), Limits(part_s=0.3), Limits(part_s=0.3, keep=2)])
@pytest.mark.parametrize("sealed", [True, False])
def test_a_snapshot_holds_the_last_seconds_and_what_was_latched(
    path: Path, limits: Limits, sealed: bool
) -> None:
    target, last_s = path.with_name("copy.mcap"), 0.25
    with PartedWriter(
        path, HEADER, attachments=run_attachments(scenario()), limits=limits, safety=SMALL
    ) as writer:
        for sample in STREAM:
            put(writer, sample)
        writer.flush()
        if sealed:
            writer.close(DONE)
        end_ns = STREAM[-1].log_time_ns
        wanted = [w for w in STREAM if w.log_time_ns >= end_ns - 250_000_000]
        assert snapshot(path, target, last_s) == len(wanted)
    with open_recording(target) as recording:
        recording.check()
        found = everything(recording)
        repeated = recording.header.repeated
        assert found[repeated:] == wanted
        latched = {w.key: w for w in STREAM[: -len(wanted)] if keys.parse(w.key).topic.latched}
        assert {w.key: w.payload for w in found[:repeated]} == {
            key: w.payload for key, w in latched.items()
        }
        assert recording.scenario == scenario()
        assert recording.header.made_from["verb"] == "snapshot"
        assert recording.end is not None
        assert recording.end.recorded == len(wanted)


def test_a_snapshot_of_nothing_says_so(path: Path) -> None:
    assert main([str(path), str(path.with_name("copy.mcap")), "1"]) != 0
    assert not path.with_name("copy.mcap").exists()


@pytest.mark.parametrize("seconds", [-1.0, 0.0, 0.0005, 0.1, 0.5, 2.0])
def test_latched_values_at_any_instant(path: Path, seconds: float) -> None:
    with RecordingWriter(path, HEADER, reserve_bytes=SMALL_RESERVE) as writer:
        for n, sample in enumerate(STREAM):
            put(writer, sample)
            if n % 10 == 0:
                writer.flush()
        writer.close(DONE)
    at_ns = STREAM[0].log_time_ns + round(seconds * 1e9)
    before = [w for w in STREAM if w.log_time_ns < at_ns and keys.parse(w.key).topic.latched]
    with open_recording(path) as recording:
        found = {w.key: w for w in written(recording.latched(at_ns))}
    assert found == {w.key: w for w in before}


@pytest.mark.parametrize("flush_every", [7, 100, 10_000])
def test_the_order_of_stamps_is_exact_whatever_the_chunks(path: Path, flush_every: int) -> None:
    """Stamps that jump about by more than a chunk; ties keep the order of the file."""
    stirred = [
        w._replace(publish_time_ns=10**9 + (n * 37 % 250) * 10**6) for n, w in enumerate(STREAM)
    ]
    with RecordingWriter(path, HEADER, reserve_bytes=SMALL_RESERVE) as writer:
        for n, sample in enumerate(stirred):
            put(writer, sample)
            if n % flush_every == 0:
                writer.flush()
        writer.close(DONE)
    expected = sorted(stirred, key=lambda w: w.publish_time_ns)
    with open_recording(path) as recording:
        assert written(recording.messages(order="stamp")) == expected
        start_ns, stop_ns = 10**9 + 50 * 10**6, 10**9 + 60 * 10**6
        part = recording.messages(order="stamp", start_ns=start_ns, stop_ns=stop_ns)
        assert written(part) == [w for w in expected if start_ns <= w.publish_time_ns < stop_ns]


def test_a_topic_that_is_rare_is_found_without_reading_the_rest(path: Path) -> None:
    rare = STREAM[3]  # the first closing
    others = [w for w in STREAM if w.key != rare.key]
    with RecordingWriter(path, HEADER, reserve_bytes=SMALL_RESERVE) as writer:
        for n, sample in enumerate([*others[:400], rare, *others[400:]]):
            put(writer, sample._replace(log_time_ns=STREAM[0].log_time_ns + n))
            if n % 50 == 0:
                writer.flush()
        writer.close(DONE)
    with open_recording(path) as recording:
        read = list[int]()
        data = recording._data
        recording._data = lambda span: read.append(span.offset) or data(span)  # type: ignore[method-assign, func-returns-value]
        found = list(recording.messages(topics=(keys.parse(rare.key).topic,)))
    assert [m.payload for m in found] == [rare.payload]
    assert len(read) == 1
