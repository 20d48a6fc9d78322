"""Laws of late messages: whatever the order of arrival within the window, the same final state."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest
from msgspec.structs import replace as changed

from fusion_center import pipeline
from fusion_center.rollback import STATES
from fusion_center.state import pack, unpack
from fusion_center.timeline import BACK_NS
from schemas.messages import Closed, Input, StreamSpan
from tests.fusion_center.scenes import (
    Scene,
    as_bytes,
    closed,
    correction,
    of_radar,
    quality,
    stamp,
)
from tests.fusion_center.test_pipeline_laws import (
    lively,
    memory,
    memoryless,
    nameless,
    one_by_one,
    story,
    told,
)

STEPS = 8
MAKERS = pytest.mark.parametrize("make", [lively, nameless, memoryless])


def delayed(scene: Scene, seed: int, most: int = 2) -> list[tuple[Closed, list[Input]]]:
    """The story with every stream held up now and then by `most` steps; at the end all is there.

    But for what sources are, which has no time and counts from when it is told.
    """
    draw = random.Random(seed)
    due: dict[int, list[Input]] = {step: [] for step in range(1, STEPS + 1)}
    held_to: dict[tuple[str, str], int] = {}
    for step, said in enumerate(story(scene, STEPS), 1):
        for message in said:
            stream = (message.carrier, message.stream)
            wait = draw.choice([0, 0, 1, most]) if message.stream != "info" else 0
            held_to[stream] = min(max(held_to.get(stream, 0), step + wait), STEPS)
            due[held_to[stream]].append(message)
    return [(closed(step, said), said) for step, said in due.items()]


@MAKERS
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_any_order_of_arrival_gives_the_same_final_state(
    make: Callable[[], Scene], seed: int
) -> None:
    scene = make()
    in_order, outputs = told(scene.initial(), one_by_one(story(scene, STEPS)))
    late, later = told(scene.initial(), delayed(scene, seed))
    assert memory(late) == memory(in_order)
    assert as_bytes(later[-1:])[:-2] == as_bytes(outputs[-1:])[:-2]  # all but what is counted
    _, counted = told(in_order, [(closed(STEPS + 1, []), [])])
    _, same = told(late, [(closed(STEPS + 1, []), [])])
    assert as_bytes(same) == as_bytes(counted)


def test_delays_are_what_they_are_meant_to_be() -> None:
    """The law above is tried on messages that come after younger ones."""
    newest, behind = -1, 0
    for _, said in delayed(lively(), 1):
        behind += sum(message.t_ns < newest for message in said)
        newest = max([newest, *(message.t_ns for message in said)])
    assert behind > 10


def test_a_message_named_late_is_put_in_its_place() -> None:
    scene = lively()
    plain = one_by_one(story(scene, STEPS))
    (first, said), (second, more), *rest = plain
    straggler = next(m for m in said if m.carrier == "b" and m.stream == "radar")
    span = StreamSpan(carrier="b", boot="b1", stream="radar", first=1, last=1)
    without = (closed(1, said, gave_up=[span]), [m for m in said if m is not straggler])
    with_it = (closed(2, more, late=[span]), [*more, straggler])
    in_order, _ = told(scene.initial(), plain[:2])
    late, outputs = told(scene.initial(), [without, with_it])
    assert memory(late) == memory(in_order)
    assert quality(outputs[1]).late == 0
    assert of_radar(outputs[1], "b").logs == 22
    assert memory(told(late, rest)[0]) == memory(told(in_order, rest)[0])
    assert first.step == second.step - 1


def test_nothing_is_counted_twice() -> None:
    scene = lively()
    parts = delayed(scene, 2)
    _, outputs = told(scene.initial(), parts)
    logs = sum(row.logs for out in outputs for row in quality(out).sources)
    assert logs == sum(len(m) for said in story(scene, STEPS) for m in said if m.stream == "radar")  # type: ignore[arg-type]


def test_what_is_older_than_the_window_is_counted_and_changes_nothing() -> None:
    scene = lively()
    plain = one_by_one(story(scene, STEPS))
    state, _ = told(scene.initial(), plain)
    oldest_ns = stamp(STEPS) - round(scene.scenario().max_clock_error_s * 1e9) - BACK_NS
    ship = scene.ships[1]
    too_old = scene.report(ship, STEPS + 1)
    message = changed(too_old, t_ns=oldest_ns - 1)
    after, outputs = pipeline.step(state, closed(STEPS + 1, [message]), [message])
    assert quality(outputs).late == 1
    assert after.carriers == state.carriers


def test_the_past_is_bounded_and_survives_packing() -> None:
    scene = lively()
    state, _ = told(scene.initial(), one_by_one(story(scene, 20)))
    assert sum(past.before is not None for past in state.past) <= STATES + 2
    assert state.past[0].t_ns <= stamp(20) - BACK_NS
    assert len(state.past) < 20 * 4
    more = [(closed(21, said), said) for said in [scene.said(21)]]
    here, there = told(state, more), told(unpack(pack(state)), more)
    assert memory(here[0]) == memory(there[0])
    assert correction(here[1][0]) == correction(there[1][0])
