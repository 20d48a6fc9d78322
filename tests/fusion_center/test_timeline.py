"""Which messages count: exactly those a Closed names, in one order, if they are of its time."""

from __future__ import annotations

import random

import pytest

from fusion_center.state import Timeline
from fusion_center.timeline import BOOTS_KEPT, close, named, ordinal, take
from schemas.messages import (
    Closed,
    Event,
    Input,
    Navigation,
    Pose,
    SourceInfo,
    SourceProperties,
    SourceReport,
    StreamEnd,
    StreamSpan,
)
from tests.fusion_center.scenes import EPOCH_NS, STEP_NS, closed, stamp


def report(seq: int, t_s: float | None = None, carrier: str = "a", boot: str = "x") -> SourceReport:
    t_ns = stamp(seq if t_s is None else t_s)
    return SourceReport(carrier=carrier, boot=boot, stream="radar", seq=seq, t_ns=t_ns)


def fix(seq: int, t_s: float, carrier: str = "a") -> Navigation:
    pose = Pose(latitude_rad=0.7, longitude_rad=0.5)
    return Navigation(
        carrier=carrier, boot="x", stream="navigation", seq=seq, t_ns=stamp(t_s), pose=pose
    )


def end(last: int, carrier: str = "a", boot: str = "x") -> StreamEnd:
    return StreamEnd(carrier=carrier, boot=boot, stream="radar", last_seq=last)


def span(first: int, last: int) -> StreamSpan:
    return StreamSpan(carrier="a", boot="x", stream="radar", first=first, last=last)


def seqs(batch_messages: list[Input]) -> list[int]:
    return [message.seq for message in batch_messages]


def fused(timeline: Timeline, now: Closed, messages: list[Input]) -> list[int]:
    _, batch = take(timeline, now, messages, 1.0)
    return [m.seq for instant in batch.instants for m in instant.messages]


def test_a_closed_names_what_is_new_and_nothing_else() -> None:
    messages: list[Input] = [report(seq) for seq in range(1, 6)]
    first = Closed(step=1, t_ns=stamp(2), manifest=[end(2)])
    second = Closed(step=2, t_ns=stamp(4), manifest=[end(4)])
    assert fused(Timeline(), first, messages) == [1, 2]
    after, _ = take(Timeline(), first, messages, 1.0)
    assert fused(after, second, messages) == [3, 4]


def test_messages_of_no_manifest_are_left_alone() -> None:
    now = Closed(step=1, t_ns=stamp(2), manifest=[end(2)])
    wanted: list[Input] = [report(1), report(2)]
    strangers: list[Input] = [report(3), report(1, carrier="b"), report(2, boot="y"), fix(1, 1)]
    assert take(Timeline(), now, [*wanted, *strangers], 1.0) == take(Timeline(), now, wanted, 1.0)


def test_what_was_given_up_is_neither_waited_for_nor_fused() -> None:
    now = Closed(step=1, t_ns=stamp(4), manifest=[end(4)], gave_up=[span(2, 3)])
    assert fused(Timeline(), now, [report(1), report(4)]) == [1, 4]
    assert fused(Timeline(), now, [report(seq) for seq in range(1, 5)]) == [1, 4]
    assert take(Timeline(), now, [report(1), report(4)], 1.0)[1].gave_up_count == 2


def test_what_was_given_up_beyond_the_manifest_is_remembered_until_it_is_reached() -> None:
    first = Closed(step=1, t_ns=stamp(1), manifest=[end(1)], gave_up=[span(2, 2)])
    second = Closed(step=2, t_ns=stamp(3), manifest=[end(3)])
    after, _ = take(Timeline(), first, [report(1)], 1.0)
    assert fused(after, second, [report(3)]) == [3]
    reached, _ = take(after, second, [report(3)], 1.0)
    assert reached.gave_up == ()


def test_a_named_message_that_is_missing_is_the_callers_error() -> None:
    now = Closed(step=1, t_ns=stamp(2), manifest=[end(2)])
    with pytest.raises(ValueError, match="message 2 is not there"):
        take(Timeline(), now, [report(1)], 1.0)


def test_late_spans_are_fused_in_their_place() -> None:
    first = Closed(step=1, t_ns=stamp(2), manifest=[end(2)], gave_up=[span(1, 1)])
    after, _ = take(Timeline(), first, [report(2)], 1.0)
    second = Closed(step=2, t_ns=stamp(3), manifest=[end(3)], late=[span(1, 1)])
    _, batch = take(after, second, [report(1), report(3)], 1.0)
    assert [seqs(instant.messages) for instant in batch.instants] == [[1], [3]]
    assert batch.late == []
    assert batch.late_count == 0
    _, lost = take(after, second, [report(3)], 1.0)
    assert lost.late_count == 1


@pytest.mark.parametrize(
    ("t_s", "verdict"), [(1.999, "late"), (2.0, "fused"), (7.0, "fused"), (7.001, "future")]
)
def test_stamps_too_far_from_the_closings_are_not_fused(t_s: float, verdict: str) -> None:
    after = close(Timeline(), Closed(step=1, t_ns=stamp(5)))
    now = Closed(step=2, t_ns=stamp(6), manifest=[end(1)])
    _, batch = take(after, now, [report(1, t_s)], 1.0)
    assert (len(batch.instants) == 1) == (verdict == "fused")
    assert seqs(batch.late) == ([1] if verdict == "late" else [])
    assert batch.late_count == len(batch.late)
    assert seqs(batch.future) == ([1] if verdict == "future" else [])


def test_what_a_source_is_is_never_late() -> None:
    info = SourceInfo(
        carrier="a",
        boot="x",
        stream="info",
        seq=1,
        t_ns=EPOCH_NS,
        source="radar",
        properties=SourceProperties(),
    )
    after = close(Timeline(), Closed(step=1, t_ns=stamp(100)))
    _, batch = take(after, closed(2, [info], t_ns=stamp(101)), [info], 1.0)
    assert batch.fused == 1


def test_one_order_whatever_the_order_of_arrival() -> None:
    messages: list[Input] = [report(1, 1.0, c) for c in "ba"] + [fix(1, 1.0, c) for c in "ba"]
    messages += [report(2, 0.9, "b"), fix(2, 1.2, "a")]
    now = closed(1, messages, t_ns=stamp(2))
    random.Random(1).shuffle(messages)
    _, batch = take(Timeline(), now, messages, 1.0)
    got = [
        (instant.t_ns, [(m.carrier, m.stream) for m in instant.messages])
        for instant in batch.instants
    ]
    same = [("a", "navigation"), ("b", "navigation"), ("a", "radar"), ("b", "radar")]
    assert got == [
        (stamp(0.9), [("b", "radar")]),
        (stamp(1.0), same),
        (stamp(1.2), [("a", "navigation")]),
    ]


def test_boots_count_in_the_order_of_closed_and_few_are_remembered() -> None:
    timeline = Timeline()
    for n in range(1, 3 * BOOTS_KEPT):
        now = Closed(step=n, t_ns=stamp(n), manifest=[end(1, boot=f"boot{n}")])
        timeline = close(timeline, now)
        assert ordinal(timeline, "a", f"boot{n}") == n
    assert len(timeline.seen) == BOOTS_KEPT
    assert ordinal(timeline, "a", "boot1") == 0
    assert ordinal(timeline, "a", f"boot{2 * BOOTS_KEPT}") == 2 * BOOTS_KEPT


def test_events_of_the_step_come_in_their_order() -> None:
    events = [
        Event(centre="fusion", seq=seq, step=step, t_ns=STEP_NS, id=f"e{seq}", kind="suspend")
        for seq, step in ((3, 2), (1, 1), (2, 2))
    ]
    _, batch = take(Timeline(), Closed(step=2, t_ns=stamp(2)), events, 1.0)
    assert [event.seq for event in batch.events] == [2, 3]


def test_named_covers_a_stream_once_however_often_a_manifest_names_it() -> None:
    now = Closed(step=1, t_ns=stamp(4), manifest=[end(2), end(4), end(3)])
    assert named(Timeline(), now) == [span(1, 2), span(3, 4)]
