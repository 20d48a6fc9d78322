"""A recorder of its own: what it records, what it can be asked, when it ends."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
import pytest

from crossfix.commands.info import lost_by_key
from fusion_center.recorder import How, Wanted, require_wanted, thread
from fusion_center.recorder.alone import RecorderAlone, record_whatever
from schemas import codec, keys
from schemas.bus.answering import reply_to
from schemas.bus.interface import Bus, Sample
from schemas.bus.member import Buses, Member
from schemas.bus.memory_bus import MemoryNetwork
from schemas.errors import BusError, CrossfixError
from schemas.messages import (
    BackfillRecord,
    BackfillReply,
    BackfillRequest,
    Navigation,
    Pose,
    RecorderCommand,
    RecorderStatus,
    SourceReport,
    Statistics,
    Step,
)
from schemas.qos import DATA
from schemas.recording.parts import Limits, Safety
from schemas.recording.reader import open_recording, summary
from tests.bad_input.test_flood import SCENARIO

RUN = SCENARIO.name
DEADLINE_S = 10.0
SMALL = Safety(max_loss_s=0.05, reserve_bytes=64 * 1024)


class Alone:
    """A recorder in a thread, somebody who speaks, and somebody who asks."""

    def __init__(self, network: MemoryNetwork, path: Path, how: How) -> None:
        self.bus: Bus = network.bus("speaker")
        buses = Buses(network.bus("record"), network.bus("record"))
        self.member = Member(RUN, "record", buses)
        self.alone: RecorderAlone = record_whatever(self.member, path, how, 0.0)
        self.reason = ""
        self.errors: list[Exception] = []
        self._seq = self._command = 0
        self.thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        try:
            self.alone.start()
            self.reason = self.alone.run()
        except Exception as error:
            self.errors.append(error)

    def say(self, count: int = 1, carrier: str = "alpha") -> None:
        """Reports that the recorder has taken when this returns."""
        before = self.received("report")
        for _ in range(count):
            self._seq += 1
            message = SourceReport(
                carrier=carrier, boot="a", stream="radar", seq=self._seq, t_ns=self._seq * 10**9
            )
            self.publish(keys.REPORT, (carrier, "radar"), message)
        self.until(lambda: self.received("report") == before + count)

    def received(self, topic: str) -> int:
        """How many messages of a topic the recorder has taken so far."""
        rows = self.alone.recorder.statistics().keys
        return sum(row.received for row in rows if f"{RUN}/{topic}" in row.key)

    def recorded(self, topic: str) -> int:
        """How many of them it has handed to its writer."""
        rows = self.alone.recorder.statistics().keys
        return sum(row.recorded for row in rows if f"{RUN}/{topic}" in row.key)

    def publish(self, topic: keys.Topic, ids: tuple[str, ...], message: Any) -> None:
        encoding = codec.encoding_of(type(message))
        self.bus.publish(topic.key(RUN, *ids), codec.encode(message), encoding, topic.qos)

    def ask(self, kind: str, **fields: Any) -> RecorderStatus:
        self._command += 1
        command = RecorderCommand(id=fields.pop("id", f"c{self._command}"), kind=kind, **fields)  # type: ignore[arg-type]
        key = keys.RECORDING.key(RUN, "record")
        encoding = codec.encoding_of(RecorderCommand)
        [answer] = self.bus.query(key, codec.encode(command), encoding, DEADLINE_S)
        return codec.decode(RecorderStatus, answer.payload)

    def until(self, met: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + DEADLINE_S
        while not met():
            assert time.monotonic() < deadline_s, "it never came so far"
            time.sleep(0.002)

    def end(self) -> str:
        self.alone.stop("told to")
        self.thread.join(DEADLINE_S)
        assert not self.thread.is_alive()
        return self.reason


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


@pytest.fixture
def network() -> Iterator[MemoryNetwork]:
    with MemoryNetwork() as network:
        yield network


@contextmanager
def recording(network: MemoryNetwork, path: Path, **how: Any) -> Iterator[Alone]:
    alone = Alone(network, path, How(safety=SMALL, **how))
    alone.thread.start()
    alone.until(alone.alone.recorder._thread.is_alive)
    yield alone
    alone.end()


def seqs(path: Path) -> list[int]:
    with open_recording(path) as recording_:
        return [m.sequence for m in recording_.messages(topics=(keys.REPORT,))]


def test_it_records_what_is_said_without_a_world(network: MemoryNetwork, path: Path) -> None:
    before_ns = time.time_ns()
    with recording(network, path) as alone:
        alone.say(5)
        assert alone.end() == "told to"
    assert seqs(path) == [1, 2, 3, 4, 5]
    with open_recording(path) as found:
        found.check()
        assert found.header.run == RUN
        assert found.header.scenario == ""
        assert found.end is not None
        assert found.end.reason == "told to"
        assert found.end.recorded == len(list(found.messages()))
        assert all(before_ns <= m.log_time_ns <= time.time_ns() for m in found.messages())


def test_with_a_world_it_has_the_scenario_and_its_time(network: MemoryNetwork, path: Path) -> None:
    world = network.bus("world")
    payload, encoding = codec.encode(SCENARIO), codec.encoding_of(type(SCENARIO))
    key = keys.SCENARIO.key(RUN)
    world.serve(key, lambda _: [Sample(key, payload, encoding)])
    with recording(network, path) as alone, world.announce(keys.alive(RUN, "world", "w")):
        step = Step(boot="w", step=1, t_ns=SCENARIO.epoch_ns + SCENARIO.step_ns)
        alone.publish(keys.STEP, (), step)
        alone.until(lambda: alone.alone.recorder.step == 1)
        alone.say()
    with open_recording(path) as found:
        assert found.scenario == SCENARIO
        assert found.header.scenario == SCENARIO.name
        times_ns = {m.address.topic.name: m.log_time_ns for m in found.messages()}
        assert times_ns["scenario"] == SCENARIO.epoch_ns
        assert times_ns["report"] == step.t_ns


def test_it_ends_when_world_and_fusion_centre_have_gone(network: MemoryNetwork, path: Path) -> None:
    with recording(network, path) as alone:
        world = network.bus("world")
        with world.announce(keys.alive(RUN, "world", "w")):
            with world.announce(keys.alive(RUN, "fusion", "f")):
                alone.until(lambda: len(alone.alone._seen) == 2)
            alone.publish(keys.STEP, (), Step(boot="w", step=0, t_ns=0, ended="finished"))
            alone.until(lambda: alone.alone.recorder.ended)
        alone.thread.join(DEADLINE_S)
        assert alone.reason == "finished"


def test_what_passes_while_it_is_paused_is_neither_written_nor_missed(
    network: MemoryNetwork, path: Path
) -> None:
    with recording(network, path) as alone:
        alone.say(2)
        assert alone.ask("pause").state == "paused"
        alone.say(3)
        assert alone.ask("resume").state == "recording"
        alone.say(2)
        counters = alone.alone.recorder.counters()
    assert seqs(path) == [1, 2, 6, 7]
    assert counters["passed_over"] >= 3
    assert counters["gaps"] == 0


def test_only_what_is_wanted_is_recorded(network: MemoryNetwork, path: Path) -> None:
    wanted = Wanted(include=("report/**", "navigation/*"), exclude=("report/bravo/*",), pattern="a")
    with recording(network, path, wanted=wanted) as alone:
        alone.say(1, "alpha")
        alone.say(1, "bravo")
        navigation = Navigation(
            carrier="alpha", boot="a", stream="navigation", seq=1, t_ns=1,
            pose=Pose(latitude_rad=0.1, longitude_rad=0.1),
        )  # fmt: skip
        alone.publish(keys.NAVIGATION, ("alpha",), navigation)
        alone.publish(keys.STEP, (), Step(boot="w", step=1, t_ns=1))
        alone.until(lambda: alone.received("step") == 1)
    with open_recording(path) as found:
        names = [m.key.removeprefix(f"{keys.PREFIX}/{RUN}/") for m in found.messages()]
        assert names == ["report/alpha/radar", "navigation/alpha"]


@pytest.mark.parametrize("wanted", [Wanted(("report/#",)), Wanted((), ("",)), Wanted(pattern="(")])
def test_expressions_that_mean_nothing_are_refused(wanted: Wanted) -> None:
    with pytest.raises(CrossfixError):
        require_wanted(wanted)


def test_a_split_that_is_asked_for(network: MemoryNetwork, path: Path) -> None:
    with recording(network, path, limits=Limits(part_s=3600.0)) as alone:
        alone.say(2)
        assert alone.ask("split", id="once").taken
        assert alone.ask("split", id="once").taken  # the same command again
        alone.until(lambda: len(alone.alone.recorder.files()) == 2)
        alone.say(2)
        assert alone.ask("status").files == ["run.0001.mcap", "run.0002.mcap"]
    assert [seqs(file) for file in alone.alone.recorder.files()] == [[1, 2], [3, 4]]


def test_one_file_is_not_split(network: MemoryNetwork, path: Path) -> None:
    with recording(network, path) as alone:
        answer = alone.ask("split")
        assert not answer.taken
        assert "not recorded in parts" in answer.reason


def test_a_snapshot_while_the_recording_goes_on(network: MemoryNetwork, path: Path) -> None:
    copy = path.with_name("copy.mcap")
    with recording(network, path) as alone:
        alone.say(5)
        assert alone.ask("snapshot", output="copy.mcap", last_s=3600.0).taken
        alone.until(lambda: _is_sealed(copy))
        alone.say(1)
        refused = alone.ask("snapshot", output="copy.mcap", last_s=1.0)
        assert "exists already" in refused.reason
        for name in ("", "../x.mcap", "a/b.mcap", "x.txt"):
            assert not alone.ask("snapshot", output=name, last_s=1.0).taken
        assert not alone.ask("snapshot", output="y.mcap").taken
    assert seqs(copy) == [1, 2, 3, 4, 5]
    assert seqs(path) == [1, 2, 3, 4, 5, 6]


def _is_sealed(path: Path) -> bool:
    if not path.exists():
        return False
    try:
        with open_recording(path) as found:
            return found.end is not None
    except CrossfixError:
        return False


def test_statistics_by_key_are_answered_and_recorded(network: MemoryNetwork, path: Path) -> None:
    with recording(network, path) as alone:
        alone.say(3)
        alone.publish(keys.REPORT, ("alpha", "radar"), Step(boot="w", step=1, t_ns=1))
        alone.publish(keys.STEP, (), Step(boot="w", step=1, t_ns=1))
        alone.until(lambda: alone.recorded("step") == 1)
        status = alone.ask("status")
    assert isinstance(status.statistics, Statistics)
    rows = {row.key.rpartition(f"{RUN}/")[2]: row for row in status.statistics.keys}
    report = rows["report/alpha/radar"]
    assert (report.received, report.recorded, report.rejected) == (4, 3, 1)
    assert (rows["step"].received, rows["step"].recorded) == (1, 1)
    with open_recording(path) as found:
        told: dict[str, tuple[int, int]] = {}
        for statistics in found.statistics():
            told |= {row.key: (row.received, row.recorded) for row in statistics.keys}
    assert told[report.key] == (4, 3)


def test_two_of_one_name_are_one_too_many(network: MemoryNetwork, path: Path) -> None:
    with recording(network, path) as alone:
        second = Alone(network, path.with_name("second.mcap"), How(safety=SMALL))
        second._run()
        assert isinstance(second.errors[0], BusError)
        assert "--as" in str(second.errors[0])
        alone.say()


def test_what_was_lost_by_key_stands_in_the_file_and_is_shown(
    network: MemoryNetwork, path: Path
) -> None:
    with recording(network, path) as alone:
        alone.say(3)
        alone.publish(keys.REPORT, ("alpha", "radar"), Step(boot="w", step=1, t_ns=1))
        alone.until(lambda: alone.received("report") == 4)
    found = summary(path)
    assert found.statistics is not None
    assert sum(row.received for row in found.statistics.keys) == found.statistics.received
    assert lost_by_key(found) == {keys.REPORT.key(RUN, "alpha", "radar"): "1 refused"}


def test_gaps_all_over_a_stream_are_fetched_before_it_ends(
    network: MemoryNetwork, path: Path
) -> None:
    """Every third message is lost on the way; the owner has all but one."""
    payloads = {
        seq: codec.encode(
            SourceReport(carrier="alpha", boot="a", stream="radar", seq=seq, t_ns=seq * 10**9)
        )
        for seq in range(1, 1501)
    }
    never, key = 600, keys.REPORT.key(RUN, "alpha", "radar")
    encoding = codec.encoding_of(SourceReport)

    def answer(question: Sample) -> list[Sample]:
        asked = codec.decode(BackfillRequest, question.payload)
        records = [
            BackfillRecord(key=key, encoding=encoding, payload=payloads[seq])
            for seq in range(asked.first, min(asked.last, asked.first + 499) + 1)
            if seq != never
        ]
        return [reply_to(question, BackfillReply(records=records))]

    with recording(network, path) as alone, alone.bus.announce(keys.alive(RUN, "alpha", "a")):
        alone.until(lambda: bool(alone.alone._seen))
        alone.bus.serve(keys.BACKFILL.key(RUN, "alpha"), answer)
        for seq, payload in payloads.items():
            if seq % 3 or seq == 1500:
                alone.bus.publish(key, payload, encoding, keys.REPORT.qos)
        alone.end()
        counters = alone.alone.recorder.counters()
    assert sorted(seqs(path)) == [seq for seq in payloads if seq != never]
    assert counters["gaps"] == 1


def test_what_there_was_no_time_for_is_counted(
    network: MemoryNetwork, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its owner never answers."""
    monkeypatch.setattr(thread, "FINISH_S", 0.2)
    key, encoding = keys.REPORT.key(RUN, "alpha", "radar"), codec.encoding_of(SourceReport)
    with recording(network, path) as alone, alone.bus.announce(keys.alive(RUN, "alpha", "a")):
        alone.until(lambda: bool(alone.alone._seen))
        for seq in (1, 2, 10):
            report = SourceReport(carrier="alpha", boot="a", stream="radar", seq=seq, t_ns=1)
            alone.bus.publish(key, codec.encode(report), encoding, keys.REPORT.qos)
        alone.end()
    with open_recording(path) as found:
        assert found.end is not None
        assert found.end.gaps == 7


def test_a_stream_that_goes_on_is_recorded_once_and_only_what_is_valid(
    network: MemoryNetwork, path: Path
) -> None:
    """Whatever order a stream of a member comes in, each seq is there once: the first valid one."""
    key = keys.REPORT.key(RUN, "alpha", "radar")

    def said(seq: int, **fields: Any) -> bytes:
        report = {"carrier": "alpha", "boot": "a", "stream": "radar", "seq": seq, "t_ns": seq}
        return bytes(msgpack.packb(report | {"bearing_rad": [0.5]} | fields))

    with (
        recording(network, path) as alone,
        alone.bus.announce(keys.alive(RUN, "alpha", "a")),
    ):
        alone.until(lambda: alone.alone.recorder.lives.has("alpha"))
        spoken = [said(seq) for seq in (1, 2, 3, 3, 5, 4, 6)]
        spoken += [said(7, bearing_rad=[99.0]), said(7, boot="b"), said(7), said(2), said(8)]
        for payload in spoken:
            alone.bus.publish(key, payload, codec.encoding_of(SourceReport), DATA)
        alone.until(lambda: alone.received("report") == len(spoken))
        alone.end()
    with open_recording(path) as recording_:
        found = list(recording_.messages(topics=(keys.REPORT,)))
        assert recording_.end is not None
        end = recording_.end
    kept = [m for m in found if b"\xa4boot\xa1a" in m.payload]
    assert [m.sequence for m in kept] == [1, 2, 3, 5, 4, 6, 7, 8]
    assert [m.payload for m in kept] == [spoken[n] for n in (0, 1, 2, 4, 5, 6, 9, 11)]
    assert (end.rejected, end.recorded, len(found)) == (1, end.received - 3, 9)
