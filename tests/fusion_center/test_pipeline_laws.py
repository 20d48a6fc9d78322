"""Laws of the pure step: what the outputs depend on, and what they do not."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from estimation.arrays import Array
from estimation.frames import rotation_clockwise, target_from_source, yaw_rad
from fusion_center import pipeline
from fusion_center.state import State, pack, unpack
from schemas import codec
from schemas.messages import Closed, Correction, Input
from tests.fusion_center.scenes import (
    CLOSED_FORM,
    EPOCH_NS,
    Scene,
    Ship,
    as_bytes,
    closed,
    correction,
    matrix,
    named,
    stamp,
    targets_around,
    two_ships,
)

STEPS = 6


def lively() -> Scene:
    """Three moving ships that look at three instants; most targets have a name, some do not."""
    rng = np.random.default_rng(11)
    identities = [*named(8), None, None, None]
    ships = (
        Ship("a", velocity_mps=(5.0, 2.0), position_error_m=(400.0, 100.0), north_error_rad=0.01),
        Ship("b", at_m=(9000.0, 8000.0), velocity_mps=(-3.0, 6.0), looks_before_s=0.3,
             position_error_m=(-700.0, 900.0), north_error_rad=-0.012),
        Ship("c", at_m=(-8000.0, 7000.0), velocity_mps=(2.0, -6.0), looks_before_s=0.6,
             position_error_m=(100.0, -1200.0), north_error_rad=0.015),
    )  # fmt: skip
    return Scene(ships, targets_around(rng, 11), rng.normal(0, 8, (11, 2)), identities)


def nameless() -> Scene:
    """The same with neither identities nor tracks: nothing but plots."""
    return replace(lively(), identities=None, tracks=False)


def memoryless() -> Scene:
    """The same with the baseline that forgets."""
    return replace(lively(), fusion=CLOSED_FORM)


EVERY_KIND = pytest.mark.parametrize("make", [lively, nameless, memoryless])


def story(scene: Scene, steps: int = STEPS) -> list[list[Input]]:
    rng = np.random.default_rng(12)
    return [scene.said(step, rng) for step in range(1, steps + 1)]


def told(state: State, closings: Sequence[tuple[Closed, Sequence[Input]]]) -> tuple[State, list]:  # type: ignore[type-arg]
    outputs = []
    for now, messages in closings:
        state, out = pipeline.step(state, now, messages)
        outputs.append(out)
    return state, outputs


def one_by_one(told_by_step: Sequence[Sequence[Input]]) -> list[tuple[Closed, Sequence[Input]]]:
    return [(closed(step, said), said) for step, said in enumerate(told_by_step, 1)]


def test_the_story_is_lively() -> None:
    """What the laws below are tried on reaches every kind of pair and the applied state."""
    _, outputs = told(lively().initial(), one_by_one(story(lively())))
    last = outputs[-1]
    assert {correction(last, name).state for name in "bc"} == {"applied"}
    methods = {target.method for target in last[-2].message.targets}
    assert methods == {"identity", "coordinates"}


@EVERY_KIND
def test_order_repetitions_and_strangers_change_no_byte(make: Callable[[], Scene]) -> None:
    scene = make()
    plain = one_by_one(story(scene))
    everything = [message for _, said in plain for message in said]
    shuffle = random.Random(13).sample
    untidy = [
        (now, shuffle([*said, *said[:4], *everything], len(said) + 4 + len(everything)))
        for now, said in plain
    ]
    state, outputs = told(scene.initial(), plain)
    again, same = told(scene.initial(), untidy)
    assert as_bytes(outputs) == as_bytes(same)
    assert pack(state) == pack(again)


@EVERY_KIND
def test_any_partition_of_the_logs_gives_the_same_final_state(make: Callable[[], Scene]) -> None:
    """One Closed a step, three for all, one for all, and one for every instant."""
    scene = make()
    messages = [message for said in story(scene) for message in said]
    instants = sorted({message.t_ns for message in messages})
    cuts = [
        [stamp(step) for step in range(1, STEPS + 1)],
        [stamp(1), stamp(4), stamp(STEPS)],
        [stamp(STEPS)],
        instants,
    ]
    finals = []
    for closings in cuts:
        parts = []
        for n, (after, until) in enumerate(zip([-1, *closings], closings, strict=False), 1):
            said = [m for m in messages if after < m.t_ns <= until]
            parts.append((closed(n, said, t_ns=until), said))
        state, _ = told(scene.initial(), parts)
        finals.append(state)
    assert {len(closings) for closings in cuts} == {6, 3, 1, 19}
    for state in finals[1:]:
        assert memory(state) == memory(finals[0])
    assert finals[0].links["b"].monitor.good > 0


def memory(state: State) -> bytes:
    """What a state remembers but for how many messages it published."""
    return pack(changed(state, published={}))


def test_empty_closings_change_nothing_but_their_own_outputs() -> None:
    scene = lively()
    parts = one_by_one(story(scene, 4))
    state, _ = told(scene.initial(), parts)
    idle, outputs = told(state, [(Closed(step=5, t_ns=stamp(4)), [])])
    assert memory(idle) == memory(state)
    before, after = correction(told(scene.initial(), parts)[1][-1]), correction(outputs[0])
    assert changed(after, seq=before.seq, step=before.step, id=before.id) == before


@EVERY_KIND
def test_a_state_may_be_packed_at_any_step(make: Callable[[], Scene]) -> None:
    scene = make()
    state, outputs = told(scene.initial(), one_by_one(story(scene)))
    carried, pieces = scene.initial(), []
    for now, said in one_by_one(story(scene)):
        carried = unpack(pack(carried))
        carried, out = pipeline.step(carried, now, said)
        pieces.append(out)
    assert as_bytes(pieces) == as_bytes(outputs)
    assert pack(carried) == pack(state)
    assert pack(unpack(pack(state))) == pack(state)


@EVERY_KIND
def test_a_step_leaves_the_state_it_began_with_as_it_was(make: Callable[[], Scene]) -> None:
    scene = make()
    parts = one_by_one(story(scene))
    state, _ = told(scene.initial(), parts[:-1])
    before = pack(state)
    first, second = pipeline.step(state, *parts[-1])[1], pipeline.step(state, *parts[-1])[1]
    assert pack(state) == before
    assert as_bytes([first]) == as_bytes([second])


def test_outputs_are_numbered_by_key_and_pass_the_wire() -> None:
    _, outputs = told(lively().initial(), one_by_one(story(lively())))
    for n, out in enumerate(outputs, 1):
        assert [o.topic.key("run", *o.ids) for o in out] == [
            "crossfix/@v1/run/correction/fusion/b",
            "crossfix/@v1/run/correction/fusion/c",
            "crossfix/@v1/run/track/fusion",
            "crossfix/@v1/run/association/fusion",
            "crossfix/@v1/run/quality/fusion",
        ]
        for o in out:
            assert (o.message.seq, o.message.step, o.message.t_ns) == (n, n, stamp(n))
            assert codec.decode(type(o.message), codec.encode(o.message)) == o.message


def test_no_boot_id_is_in_the_outputs() -> None:
    scene = lively()
    renamed = replace(scene, ships=tuple(replace(s, boot=f"other-{s.name}") for s in scene.ships))
    _, outputs = told(scene.initial(), one_by_one(story(scene)))
    _, same = told(renamed.initial(), one_by_one(story(renamed)))
    assert as_bytes(outputs) == as_bytes(same)


def test_swapping_the_carriers_turns_the_frame_about() -> None:
    """q_ba = -R(-D) q_ab and D_ba = -D_ab, to a hundredth of a sigma (the planes differ)."""
    scene = two_ships(9, seed=3)
    rng = np.random.default_rng(5)
    said = scene.said(1, rng)
    there = correction(pipeline.step(scene.initial(), closed(1, said), said)[1], "b")
    swapped = replace(scene, fusion={"own": "b"})
    back = correction(pipeline.step(swapped.initial(), closed(1, said), said)[1], "a")
    ab, ba = there.own_axes, back.own_axes
    assert ab is not None
    assert ba is not None
    known = yaw_rad(target_from_source(*(scene.reported_site(s, 1) for s in scene.ships)))
    turn = rotation_clockwise(-(ab.rotation_rad + known))
    sigmas = np.sqrt(np.diag(matrix(ba.covariance, 3)))
    expected = np.array([*(-turn @ [ab.east_m, ab.north_m]), -ab.rotation_rad])
    found = np.array([ba.east_m, ba.north_m, ba.rotation_rad])
    assert np.all(np.abs(found - expected) < 0.01 * sigmas)
    assert back.chi2 == pytest.approx(there.chi2, rel=1e-3)
    assert [d.ratio for d in back.directions] == pytest.approx(
        [d.ratio for d in there.directions], rel=0.01
    )


@pytest.mark.parametrize("degrees", [30.0, 145.0, 270.0])
def test_turning_the_scene_turns_the_offset_and_nothing_else(degrees: float) -> None:
    """To a hundredth of a sigma: the Earth is not quite the same in every direction."""
    turn = rotation_clockwise(math.radians(degrees))
    scene = two_ships(9, seed=3)
    ships = tuple(
        replace(ship, at_m=tuple(turn @ ship.at_m),
                position_error_m=tuple(turn @ ship.position_error_m))
        for ship in scene.ships
    )  # fmt: skip
    turned = replace(scene, ships=ships, targets_m=scene.targets_m @ turn.T)
    one = correction(scene.run(1, np.random.default_rng(5))[1][0])
    two = correction(turned.run(1, np.random.default_rng(5))[1][0])
    assert two.own_axes is not None
    before, after = error(one, scene), error(two, turned)
    expected = np.array([*(turn @ before[:2]), before[2]])
    sigmas = np.sqrt(np.diag(matrix(two.own_axes.covariance, 3)))
    assert np.all(np.abs(after - expected) < 0.01 * sigmas)
    assert two.chi2 == pytest.approx(one.chi2, rel=1e-2)


def error(found: Correction, scene: Scene) -> Array:
    """(q, D) less the truth; the truth of D has in it how norths differ where the ships are not."""
    axes, truth = found.own_axes, scene.truth("b", found.step)
    assert axes is not None
    return np.array([*([axes.east_m, axes.north_m] - truth.q_m), axes.rotation_rad - truth.D_rad])


def test_a_longer_name_of_the_epoch_is_no_part_of_the_result() -> None:
    """Stamps are only ever compared: the same story a year later has the same frames."""
    scene = lively()
    year_ns = 365 * 86_400 * 10**9
    _, outputs = told(scene.initial(), one_by_one(story(scene)))
    later = [
        (changed(now, t_ns=now.t_ns + year_ns), [changed(m, t_ns=m.t_ns + year_ns) for m in said])
        for now, said in one_by_one(story(scene))
    ]
    _, moved = told(scene.initial(), later)
    for out, again in zip(outputs, moved, strict=True):
        one, two = correction(out), correction(again)
        assert isinstance(one, Correction)
        assert two.valid_t_ns - one.valid_t_ns == year_ns
        assert two.own_axes == one.own_axes
    assert EPOCH_NS > 0
