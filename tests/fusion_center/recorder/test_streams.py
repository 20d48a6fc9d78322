"""The short way of a stream that has been admitted: the same account as on the long one."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from pathlib import Path

import pytest

from fusion_center.recorder.beginning import How, begin
from fusion_center.recorder.rows import EVERYTHING, Wanted
from fusion_center.recorder.thread import FINISH_S, Recorder
from schemas import codec, keys
from schemas.bus.interface import Sample
from schemas.bus.ledger import StreamKey
from schemas.bus.member import Buses, Member
from schemas.bus.memory_bus import MemoryNetwork
from schemas.bus.roster import Life
from schemas.messages import SourceInfo, SourceProperties, SourceReport
from schemas.recording.parts import Safety
from schemas.recording.record_file import RecordFile
from tests.promptness import prompt, within

KEY = keys.REPORT.key("run", "alpha", "radar")
PROPERTIES = SourceProperties(kind="radar")
STREAM = StreamKey("alpha", "a", "radar")


@pytest.fixture
def recorder(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Recorder]:
    """One that does what a test tells it, in the test's thread; it wants what the test says."""
    with MemoryNetwork() as network:
        buses = Buses(network.bus("record"), network.bus("record"))
        wanted = getattr(request, "param", EVERYTHING)
        how = How(safety=Safety(reserve_bytes=64 * 1024), wanted=wanted)
        made = begin(Member("run", "record", buses), tmp_path / "run.mcap", how, None, None)
        life = Life("alpha", "a")
        made.lives.show([life], [life])
        yield made
        made._watched(lambda: made._writer.close(made._end()))
        made._gaps.close()
        if made.commands is not None:
            made.commands.close(1.0)


def said(*seqs: int) -> list[Sample]:
    reports = [
        SourceReport(carrier="alpha", boot="a", stream="radar", seq=seq, t_ns=seq) for seq in seqs
    ]
    encoding = codec.encoding_of(SourceReport)
    return [Sample(KEY, codec.encode(report), encoding) for report in reports]


def test_after_an_error_of_the_disk_a_stream_is_counted_as_dropped(
    recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(file: RecordFile, records: bytes) -> None:
        raise OSError(errno.ENOSPC, "no space left")

    recorder._record(said(*range(1, 11)))
    monkeypatch.setattr(RecordFile, "_append", full)
    recorder._watched(recorder.flush)
    recorder._record(said(*range(11, 21)))
    counts = recorder.counters()
    assert (counts["received"], counts["recorded"], counts["dropped"]) == (20, 0, 20)
    [row] = recorder.statistics().keys
    assert (row.received, row.recorded, row.dropped) == (20, 0, 20)


def test_a_stream_that_was_forgotten_is_still_recorded_once(recorder: Recorder) -> None:
    recorder._record(said(1, 2, 3))
    recorder._forget(STREAM)
    recorder._record(said(4, 4, 5, 4))
    counts = recorder.counters()
    assert (counts["recorded"], counts["repeated"]) == (5, 2)


def test_what_fills_a_gap_is_recorded_and_what_is_there_is_not(recorder: Recorder) -> None:
    recorder._record(said(1, 2, 7, 8, 3, 4, 5, 6, 7, 8, 9))
    counts = recorder.counters()
    assert (counts["received"], counts["recorded"], counts["repeated"]) == (11, 9, 2)
    [row] = recorder.statistics().keys
    assert (row.recorded, row.repeated) == (9, 2)


@prompt
@pytest.mark.parametrize("recorder", [Wanted(exclude=("report/alpha/radar",))], indirect=True)
def test_what_is_not_wanted_is_not_missed(recorder: Recorder) -> None:
    """Nor waited for at the end, though a Closed names it."""
    recorder._record(said(1, 2))
    with within(FINISH_S / 2):
        recorder._thread.start()
        recorder.finish("told to", {STREAM: 40})
    counts = recorder.counters()
    assert (counts["passed_over"], counts["recorded"], counts["gaps"]) == (2, 0, 0)


@pytest.mark.parametrize("recorder", [Wanted(exclude=("source/alpha/lidar",))], indirect=True)
def test_of_sources_that_share_a_stream_one_may_be_left_out(recorder: Recorder) -> None:
    """Its messages leave no gaps between those of the other."""
    encoding = codec.encoding_of(SourceInfo)
    for seq, source in enumerate(("radar", "lidar", "lidar", "radar"), start=1):
        info = SourceInfo(
            carrier="alpha",
            boot="a",
            stream="info",
            seq=seq,
            t_ns=seq,
            source=source,
            properties=PROPERTIES,
        )
        key = keys.SOURCE.key("run", "alpha", source)
        recorder._record([Sample(key, codec.encode(info), encoding)])
    recorder._gaps.conclude()
    counts = recorder.counters()
    assert (counts["recorded"], counts["passed_over"], counts["gaps"]) == (2, 2, 0)
