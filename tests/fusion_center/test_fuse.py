"""The fusion centre as a function: the same bytes as the steps it is made of."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from fusion_center import pipeline
from fusion_center.fuse import Fusible, fuse
from fusion_center.holding import CLOSINGS_KEPT, Holding
from fusion_center.settings import Settings
from fusion_center.state import Timeline
from schemas.errors import RecordingError, SettingsError
from schemas.messages import Closed, Event, Input, StreamEnd, StreamSpan
from tests.fusion_center.scenes import Scene, as_bytes, closed, correction, stamp, two_ships

STEPS = 6


def told(scene: Scene, steps: int = STEPS) -> list[tuple[Closed, list[Input]]]:
    rng = np.random.default_rng(3)
    said = [scene.said(step, rng) for step in range(1, steps + 1)]
    return [(closed(step, messages), messages) for step, messages in enumerate(said, 1)]


def recorded(scene: Scene, parts: Iterable[tuple[Closed, list[Input]]]) -> list[Fusible]:
    sequence: list[Fusible] = [scene.scenario()]
    for now, messages in parts:
        sequence += [*messages, now]
    return sequence


def stepped(scene: Scene, parts: Iterable[tuple[Closed, list[Input]]]) -> list[pipeline.Outputs]:
    state, outputs = scene.initial(), []
    for now, messages in parts:
        state, out = pipeline.step(state, now, messages)
        outputs.append(out)
    return outputs


def suspend(step: int, seq: int = 1) -> Event:
    return Event(
        centre="fusion", seq=seq, step=step, t_ns=stamp(step), id=f"e{seq}", kind="suspend",
        carrier="b",
    )  # fmt: skip


def test_a_recorded_sequence_gives_the_bytes_of_its_steps() -> None:
    scene = two_ships(8)
    parts = told(scene)
    assert as_bytes(fuse(recorded(scene, parts))) == as_bytes(stepped(scene, parts))


@pytest.mark.parametrize("seed", range(5))
def test_disorder_and_repetitions_do_not_matter(seed: int) -> None:
    """Whatever is shuffled among three steps; the scenario may come late, too."""
    scene = two_ships(8)
    parts = told(scene)
    sequence = recorded(scene, parts)
    shuffle = random.Random(seed)
    third = len(sequence) // 2
    untidy = [*sequence[:third], *shuffle.sample(sequence[:third], 5)]
    shuffle.shuffle(untidy)
    rest = sequence[third:]
    shuffle.shuffle(rest)
    assert as_bytes(fuse([*untidy, *rest])) == as_bytes(stepped(scene, parts))


def test_settings_come_from_the_scenario_or_instead_of_it() -> None:
    scene = replace(two_ships(8), fusion={"monitor": {"apply_after": 1}})
    sequence = recorded(scene, told(scene))

    def first_state(outputs: Iterator[pipeline.Outputs]) -> str:
        return correction(next(outputs)).state

    assert first_state(fuse(sequence)) == "applied"
    assert first_state(fuse(sequence, Settings())) == "candidate"
    assert first_state(fuse(sequence, {"monitor": {"apply_after": 1}})) == "applied"
    with pytest.raises(SettingsError):
        next(fuse(sequence, {"monitr": {}, "x": 1}))


def test_an_event_recorded_after_its_closed_is_in_time() -> None:
    scene = two_ships(8)
    parts = told(scene)
    sequence = recorded(scene, parts)
    sequence.insert(sequence.index(parts[3][0]) + 1, suspend(4))
    states = [correction(outputs).state for outputs in fuse(sequence)]
    assert states == ["candidate", "candidate", "applied", "suspended", "suspended", "suspended"]


def test_an_event_that_comes_too_late_is_an_error() -> None:
    scene = two_ships(8)
    with pytest.raises(RecordingError, match="after its step"):
        list(fuse([*recorded(scene, told(scene)), suspend(2)], ahead=1))


def test_a_message_may_be_recorded_after_the_closed_that_names_it() -> None:
    scene = two_ships(8)
    parts = told(scene)
    sequence = recorded(scene, parts)
    late = parts[1][1][1]
    sequence.remove(late)
    assert as_bytes(fuse([*sequence, late])) == as_bytes(stepped(scene, parts))


def test_a_message_that_never_comes_is_an_error_after_all_that_could_be_fused() -> None:
    scene = two_ships(8)
    parts = told(scene)
    sequence = recorded(scene, parts)
    sequence.remove(parts[3][1][1])
    outputs = []
    with pytest.raises(RecordingError) as error:
        outputs.extend(fuse(sequence))
    assert as_bytes(outputs) == as_bytes(stepped(scene, parts)[:3])
    assert error.value.where == "step 4"
    assert isinstance(error.value.got, StreamSpan)
    assert (error.value.got.stream, error.value.got.first) == ("radar", 4)


def test_a_closed_that_never_comes_and_a_scenario_that_never_comes_are_errors() -> None:
    scene = two_ships(8)
    parts = told(scene)
    with pytest.raises(RecordingError, match="step 3"):
        list(fuse(recorded(scene, [*parts[:2], *parts[3:]])))
    with pytest.raises(RecordingError, match="no declared scenario"):
        list(fuse(recorded(scene, parts)[1:]))


def test_a_centre_that_started_late_begins_with_its_own_first_step() -> None:
    scene = two_ships(8)
    parts = [(changed(now, step=now.step + 40), said) for now, said in told(scene)]
    assert as_bytes(fuse(recorded(scene, parts))) == as_bytes(stepped(scene, parts))


def test_nothing_fused_is_held_and_nothing_unclaimed_for_ever() -> None:
    scene = two_ships(8)
    parts = told(scene)
    held, before = Holding(), Timeline()
    now, messages = parts[0]
    for message in [*messages, *messages, suspend(1)]:
        held.put(message)
    assert len(held) == len(messages) + 1
    assert held.missing(before, now) is None
    assert len(held.release(before, now)) == len(messages) + 1
    assert len(held) == 0
    held.put(parts[1][1][0])
    for step in range(2, CLOSINGS_KEPT + 200):
        held.release(before, Closed(step=step, t_ns=stamp(step)))
    assert len(held) == 0


def test_late_messages_are_waited_for_and_fused_in_their_place() -> None:
    scene = two_ships(8)
    (first, said), (second, more) = told(scene, 2)
    straggler = next(m for m in said if m.carrier == "b" and m.stream == "radar")
    span = StreamSpan(carrier="b", boot="b1", stream="radar", first=1, last=1)
    first, second = changed(first, gave_up=[span]), changed(second, late=[span])
    on_time = [m for m in said if m is not straggler]
    sequence: list[Fusible] = [scene.scenario(), *on_time, first, *more, second, straggler]
    outputs = list(fuse(sequence))
    quality = outputs[1][-1].message
    rows = {row.carrier: row for row in quality.sources}  # type: ignore[attr-defined]
    assert (rows["a"].late, rows["b"].late) == (0, 0)
    assert (rows["a"].logs, rows["b"].logs) == (8, 16)
    assert quality.late == 0  # type: ignore[attr-defined]
    assert correction(outputs[0]).pairs == 0
    assert correction(outputs[1]).pairs == 8


def test_a_manifest_that_lies_does_not_hang() -> None:
    """A Closed that names 10^15 messages is incomplete, and said to be so at once."""
    scene = two_ships(8)
    end = StreamEnd(carrier="a", boot="b1", stream="radar", last_seq=10**15)
    with pytest.raises(RecordingError, match="never came"):
        list(fuse([scene.scenario(), Closed(step=1, t_ns=stamp(1), manifest=[end])]))
