"""Publishers that answer no steps in a lock-step run: joined, missed and lost as any other."""

from __future__ import annotations

from fusion_center.process.closing import LockstepClosing
from fusion_center.process.ingest import Ingest
from schemas.bus.interface import Sample
from schemas.bus.ledger import StreamKey
from schemas.messages import Closed, StreamEnd
from tests.fusion_center.test_ingest_and_closing import SCENARIO, SECOND, end, report


def stepless(seq: int, boot: str = "b") -> Sample:
    return report(seq, step=0, boot=boot)


def empty(step: int, **fields: list[str]) -> Closed:
    return Closed(step=step, t_ns=step * SECOND, **fields)


def following(closing: LockstepClosing, closed: Closed) -> Closed:
    closing.on_closed(closed)
    found = closing.next(0.0)
    assert found is not None
    return found


def test_a_guest_joins_with_its_first_message_and_is_lost_with_its_token() -> None:
    ingest = Ingest()
    closing = LockstepClosing(SCENARIO, ingest)
    closing.on_joined("alpha")
    assert following(closing, empty(1)).joined == []
    ingest.accept(stepless(1))
    assert following(closing, empty(2)).joined == ["alpha"]
    ingest.accept(stepless(2))
    assert following(closing, empty(3)).joined == []
    closing.on_lost("alpha")
    ingest.accept(stepless(3))  # it was under way
    assert following(closing, empty(4)).lost == ["alpha"]
    ingest.accept(stepless(4))
    fifth = following(closing, empty(5))
    assert (fifth.joined, fifth.lost, fifth.manifest) == ([], [], [end(4)])


def test_of_carriers_that_answer_steps_only_the_world_says_who_is_lost() -> None:
    closing = LockstepClosing(SCENARIO, Ingest())
    closing.on_joined("alpha")
    assert following(closing, empty(1, joined=["alpha"])).joined == ["alpha"]
    closing.on_lost("alpha")
    assert following(closing, empty(2)).lost == []
    assert following(closing, empty(3, lost=["alpha"])).lost == ["alpha"]


def test_a_guest_that_begins_to_answer_is_the_worlds_from_then_on() -> None:
    ingest = Ingest()
    closing = LockstepClosing(SCENARIO, ingest)
    closing.on_joined("alpha")
    ingest.accept(stepless(1, boot="a"))
    assert following(closing, empty(1)).joined == ["alpha"]
    assert following(closing, empty(2, joined=["alpha"])).joined == ["alpha"]
    closing.on_lost("alpha")
    assert following(closing, empty(3)).lost == []


def test_what_a_guest_lost_on_the_way_is_asked_for_and_holds_nobody_up() -> None:
    ingest = Ingest()
    closing = LockstepClosing(SCENARIO, ingest)
    for sample in (stepless(1), stepless(3), report(5, boot="answers")):
        ingest.accept(sample)
    gap = (StreamKey("alpha", "b", "radar"), 2, 2)
    assert closing.gaps() == [gap]  # what answers steps is asked for when its answer names it
    assert following(closing, empty(1)).manifest == [end(1)]
    closing.give_up(gap)
    second = following(closing, empty(2))
    assert second.manifest == [StreamEnd(carrier="alpha", boot="b", stream="radar", last_seq=3)]
    assert [(s.first, s.last) for s in second.gave_up] == [(2, 2)]
