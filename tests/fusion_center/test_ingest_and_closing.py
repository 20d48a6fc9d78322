"""What is held, claimed, given up and late; how Closed messages come about."""

from __future__ import annotations

import pytest

from fusion_center.process.closing import LockstepClosing, PacedClosing
from fusion_center.process.ingest import Ingest
from schemas import codec, keys
from schemas.bus.interface import Sample
from schemas.bus.ledger import StreamKey
from schemas.messages import (
    Closed,
    DeclaredCarrier,
    DeclaredScenario,
    Navigation,
    Origin,
    Pose,
    SourceReport,
    Step,
    StreamEnd,
    StreamSpan,
)

SECOND = 10**9
SCENARIO = DeclaredScenario(
    name="r",
    origin=Origin(latitude_rad=0.7, longitude_rad=0.5),
    epoch_ns=0,
    step_ns=SECOND,
    steps=5,
    carriers=[DeclaredCarrier(name="alpha", sigma_position_m=1.0, sigma_north_rad=0.01)],
)


def report(seq: int, step: int | None = None, t_ns: int | None = None, boot: str = "b") -> Sample:
    message = SourceReport(
        carrier="alpha",
        boot=boot,
        stream="radar",
        seq=seq,
        step=seq if step is None else step,
        t_ns=seq * SECOND if t_ns is None else t_ns,
        bearing_rad=[1.0],
        range_m=[100.0],
    )
    key = keys.REPORT.key("r", "alpha", "radar")
    return Sample(key, codec.encode(message), codec.encoding_of(SourceReport))


def end(last: int, boot: str = "b") -> StreamEnd:
    return StreamEnd(carrier="alpha", boot=boot, stream="radar", last_seq=last)


def closed(step: int, last: int) -> Closed:
    return Closed(step=step, t_ns=step * SECOND, manifest=[end(last)])


def test_a_closed_gets_exactly_what_it_names_and_only_once() -> None:
    ingest = Ingest()
    for seq in (3, 1, 2, 2, 4):
        ingest.accept(report(seq))
    assert sorted(m.seq for m in ingest.claim(closed(1, 2))) == [1, 2]
    assert sorted(m.seq for m in ingest.claim(closed(2, 3))) == [3]
    assert ingest.claim(closed(3, 3)) == []
    counts = ingest.statistics()[0]
    assert (counts.received, counts.duplicates) == (4, 1)


def test_gaps_of_a_manifest_are_named_and_giving_up_closes_them() -> None:
    ingest = Ingest()
    ingest.accept(report(2))
    key = StreamKey("alpha", "b", "radar")
    assert ingest.missing([end(4)]) == [(key, 1, 1), (key, 3, 4)]
    assert ingest.give_up((key, 1, 1)) == StreamSpan(
        carrier="alpha", boot="b", stream="radar", first=1, last=1
    )
    ingest.give_up((key, 3, 4))
    assert ingest.missing([end(4)]) == []
    assert [m.seq for m in ingest.claim(closed(1, 4))] == [2]
    ingest.accept(report(3))
    assert [(s.first, s.last) for s in ingest.late()] == [(3, 3)]
    assert ingest.late() == []


@pytest.mark.parametrize(
    ("sample", "word"),
    [
        (Sample("crossfix/@v1/r/report/alpha/*", b"", ""), "no key"),
        (Sample(keys.REPORT.key("r", "beta", "radar"), report(1).payload, ""), "disagree"),
        (Sample(keys.REPORT.key("r", "alpha", "ais"), report(1).payload, ""), "disagree"),
        (Sample(report(1).key, b"\xc1rubbish", ""), "MessagePack"),
        (Sample(report(1).key, report(1).payload[:-5], ""), "truncated"),
    ],
)
def test_what_is_wrong_is_counted_with_its_reason(sample: Sample, word: str) -> None:
    ingest = Ingest()
    ingest.accept(sample)
    counts = ingest.statistics()[0]
    assert counts.rejected == 1
    assert word in counts.reason


def test_lockstep_waits_for_the_messages_and_keeps_the_order_of_steps() -> None:
    ingest = Ingest()
    closing = LockstepClosing(SCENARIO, ingest)
    closing.on_closed(closed(2, 2))
    assert closing.gaps() == [(StreamKey("world", "", "closed/world"), 1, 2)]
    closing.on_closed(closed(1, 1))
    assert closing.next(0.0) is None
    assert closing.gaps() == [(StreamKey("alpha", "b", "radar"), 1, 1)]
    ingest.accept(report(2))
    ingest.accept(report(1))
    steps = [closing.next(0.0), closing.next(0.0), closing.next(0.0)]
    assert [c and c.step for c in steps] == [1, 2, None]


def test_lockstep_names_what_it_gave_up_and_what_came_too_late() -> None:
    ingest = Ingest()
    closing = LockstepClosing(SCENARIO, ingest)
    closing.on_closed(closed(1, 1))
    closing.give_up(closing.gaps()[0])
    first = closing.next(0.0)
    assert first is not None
    assert [(s.first, s.last) for s in first.gave_up] == [(1, 1)]
    ingest.accept(report(1))
    ingest.accept(report(2))
    closing.on_closed(closed(2, 2))
    second = closing.next(0.0)
    assert second is not None
    assert [(s.first, s.last) for s in second.late] == [(1, 1)]
    assert second.gave_up == []


def test_lockstep_claims_publishers_that_answer_no_steps_and_nothing_of_those_that_do() -> None:
    ingest = Ingest()
    closing = LockstepClosing(SCENARIO, ingest)
    ingest.accept(report(1))
    ingest.accept(report(2, step=2))  # of a step still open: its carrier will answer for it
    ingest.accept(report(1, step=0, boot="stranger"))
    ingest.accept(report(2, step=0, t_ns=9 * SECOND, boot="stranger"))  # from the future
    closing.on_closed(closed(1, 1))
    first = closing.next(0.0)
    assert first is not None
    assert first.manifest == [end(1), end(1, boot="stranger")]


def test_a_granted_step_says_that_the_one_before_is_closed() -> None:
    closing = LockstepClosing(SCENARIO, Ingest())
    closing.on_step(Step(boot="w", step=3, t_ns=0), 0.0)
    assert closing.gaps() == [(StreamKey("world", "", "closed/world"), 1, 2)]


def test_paced_closes_each_step_after_the_lateness_with_what_is_here() -> None:
    ingest = Ingest()
    closing = PacedClosing(SCENARIO, ingest, lateness_s=0.2)
    closing.on_step(Step(boot="w", step=1, t_ns=SECOND, mode="paced"), 10.0)
    ingest.accept(report(1, step=0))
    assert closing.next(10.1) is None
    first = closing.next(10.21)
    assert first is not None
    assert (first.step, first.t_ns, first.manifest) == (1, SECOND, [end(1)])
    assert closing.next(99.0) is None


def test_paced_waits_for_known_gaps_and_catches_up_on_steps_not_heard_of() -> None:
    ingest = Ingest()
    closing = PacedClosing(SCENARIO, ingest, lateness_s=0.2)
    ingest.accept(report(3, step=0))
    closing.on_step(Step(boot="w", step=3, t_ns=3 * SECOND, mode="paced"), 10.0)
    assert closing.next(11.0) is None
    ingest.accept(report(1, step=0))
    closing.give_up(closing.gaps()[0])
    steps = [closing.next(11.0) for _ in range(4)]
    assert [c and c.step for c in steps] == [1, 2, 3, None]
    assert steps[0] is not None
    assert [(s.first, s.last) for s in steps[0].gave_up] == [(2, 2)]


def test_what_nobody_claims_of_a_lost_boot_is_counted() -> None:
    ingest = Ingest()
    nav = Navigation(
        carrier="alpha", boot="b", stream="navigation", seq=1, t_ns=1, step=1,
        pose=Pose(latitude_rad=0.7, longitude_rad=0.5),
    )  # fmt: skip
    ingest.accept(Sample(keys.NAVIGATION.key("r", "alpha"), codec.encode(nav), ""))
    ingest.accept(report(1))
    ingest.claim(closed(1, 1))
    assert ingest.abandon("alpha", "b") == 1
    assert {s.stream: s.unclaimed for s in ingest.statistics()} == {"navigation": 1, "radar": 0}
