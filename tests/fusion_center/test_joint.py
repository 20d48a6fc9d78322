"""Frames searched for without identities, followed together, given up when they have jumped."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace as changed

from estimation.consistency import mean_interval
from fusion_center import pipeline
from fusion_center.published import Outputs
from fusion_center.state import State
from schemas.messages import Correction
from tests.fusion_center.scenes import (
    Scene,
    Ship,
    association,
    closed,
    correction,
    drawn,
    event,
    named,
    own_axes_score,
    stamp,
    targets_around,
    two_ships,
)

RUNS = 24


def plots(count: int = 10, *, seed: int = 1, **more: Any) -> Scene:
    """Two ships, moving targets, and nothing that names them."""
    rng = np.random.default_rng(seed)
    scene = two_ships(count, seed=seed, identities=False, tracks=False, **more)
    return replace(scene, velocities_mps=rng.normal(0, 8, (count, 2)))


def states(outputs: Iterable[Outputs], name: str = "b") -> list[str]:
    return [correction(out, name).state for out in outputs]


def right_pairs(outputs: Outputs) -> tuple[int, int]:
    """Pairs whose logs are of one target (the index in the report is the target), and all."""
    pairs = [target.logs for target in association(outputs).targets]
    return sum(len({log.rpartition("/")[2] for log in logs}) == 1 for logs in pairs), len(pairs)


# search


def test_plots_without_any_name_are_registered() -> None:
    """Found when the tracks are confirmed, the right pairs, applied three events later."""
    scene = plots()
    _, outputs = scene.run(8, np.random.default_rng(1))
    assert states(outputs) == ["observing"] * 2 + ["candidate"] * 2 + ["applied"] * 4
    assert all(right_pairs(out) == (10, 10) for out in outputs[3:])
    last = correction(outputs[-1])
    assert (last.method, last.pairs) == ("joint", 10)
    assert last.mode_probability > 0.99
    assert own_axes_score(last, scene.truth("b", 8)) < 5.4  # 0.1 % of chi2 3


@pytest.mark.parametrize("seed", range(6))
def test_pictures_without_a_common_target_are_not_laid_upon_each_other(seed: int) -> None:
    """Each ship sees five other targets, in the same waters."""
    scene = plots(10, seed=seed)
    state, rng = scene.initial(), np.random.default_rng(seed)
    for step in range(1, 7):
        said = [
            only(m, range(5) if m.carrier == "a" else range(5, 10)) for m in scene.said(step, rng)
        ]
        state, outputs = pipeline.step(state, closed(step, said), said)
    found = correction(outputs)
    assert found.state == "observing"
    assert found.own_axes is None
    assert found.reason


@pytest.mark.parametrize(
    ("count", "spread_m", "words"),
    [(1, 0.0, "one common target"), (6, 30.0, "a cluster")],
)
def test_undetermined_geometries_are_said_in_words_and_not_applied(
    count: int, spread_m: float, words: str
) -> None:
    rng = np.random.default_rng(3)
    targets = np.array([7000.0, 2000.0]) + rng.normal(0, max(spread_m, 1.0), (count, 2))
    scene = replace(two_ships(count), targets_m=targets, identities=named(count))
    _, outputs = scene.run(6, rng)
    found = correction(outputs[-1])
    assert found.state == "observing"
    assert any(words in correction(out).reason for out in outputs)
    assert found.directions[0].status != "determined"


def test_two_bearing_only_carriers_are_said_to_need_more() -> None:
    scene = two_ships(8)
    passive = tuple(replace(ship, coordinates="bearing") for ship in scene.ships)
    _, outputs = replace(scene, ships=passive).run(2, np.random.default_rng(1))
    found = correction(outputs[-1])
    assert found.state == "off"
    assert found.reason.startswith("two bearing-only carriers")


@pytest.mark.parametrize("apart_km", [pytest.param(3.0, marks=pytest.mark.slow), 30.0, 300.0])
def test_carriers_far_apart_register_as_well_as_near_ones(apart_km: float) -> None:
    """Curvature and meridians are in the transform: NEES of 3 dof, whatever the distance."""
    rng, scores = np.random.default_rng(int(apart_km)), []
    for seed in range(RUNS):
        scene = two_ships(10, seed=seed)
        a, b = scene.ships
        b = replace(b, at_m=(apart_km * 800.0, apart_km * 600.0))
        middle = np.array(b.at_m) / 2
        targets = middle + targets_around(np.random.default_rng(seed), 10, 40_000.0)
        scene = drawn(replace(scene, ships=(a, b), targets_m=targets), rng)
        _, outputs = scene.run(4, rng)
        assert correction(outputs[-1]).state == "applied"
        scores.append(own_axes_score(correction(outputs[-1]), scene.truth("b", 4)))
    low, high = mean_interval(3, RUNS, 0.999)
    assert low < np.mean(scores) < high


# following


@pytest.mark.slow
def test_errors_shrink_over_time_and_stay_within_their_covariance() -> None:
    """Draws of moving ships; the drift that is allowed for and does not come costs a little."""
    rng, scores, before, after = np.random.default_rng(5), [], [], []
    for seed in range(RUNS):
        scene = drawn(plots(12, seed=seed), rng)
        a, b = scene.ships
        ships = (replace(a, velocity_mps=(8.0, -3.0)), replace(b, velocity_mps=(-5.0, 9.0)))
        scene = replace(scene, ships=ships)
        _, outputs = scene.run(20, rng)
        found, truth = correction(outputs[-1]), scene.truth("b", 20)
        scores.append(own_axes_score(found, truth))
        before.append(distance(correction(outputs[3]), scene, 4))
        after.append(distance(found, scene, 20))
    low, high = mean_interval(3, RUNS, 0.999)
    assert 0.8 * low < np.mean(scores) < high
    assert np.sqrt(np.mean(np.square(after))) < 0.7 * np.sqrt(np.mean(np.square(before)))


def distance(found: Correction, scene: Scene, step: int) -> float:
    axes, truth = found.own_axes, scene.truth("b", step)
    assert axes is not None
    return math.dist((axes.east_m, axes.north_m), truth.q_m)


def test_targets_that_the_own_carrier_does_not_see_help_too() -> None:
    """The own ship and c share two; eight that c shares with b tie it down all the same."""
    c = Ship("c", at_m=(12_000.0, -4000.0), position_error_m=(900.0, -300.0), north_error_rad=0.01)
    scene = two_ships(12, seed=4)
    scene = replace(scene, ships=(*scene.ships, c))
    seen = {"a": range(4), "b": range(12), "c": range(2, 12)}

    def run(shared: bool) -> tuple[State, list[Outputs]]:
        state, outputs, noise = scene.initial(), [], np.random.default_rng(9)
        for step in range(1, 7):
            said = [
                only(m, seen[m.carrier] if shared or m.carrier != "c" else range(2, 4))
                for m in scene.said(step, noise)
            ]
            state, out = pipeline.step(state, closed(step, said), said)
            outputs.append(out)
        return state, outputs

    together, outputs = run(shared=True)
    apart, _ = run(shared=False)
    assert len(association(outputs[-1]).targets) == 12
    sigma = [math.sqrt(s.frames.covariance[14, 14]) for s in (together, apart) if s.frames]
    assert sigma[0] < 0.8 * sigma[1]


@pytest.mark.parametrize("names", [True, False])
def test_a_carrier_that_shares_nothing_with_the_own_one_is_found_through_another(
    names: bool,
) -> None:
    """Ship a sees six targets, c six others, b all: NEES of 3 dof over draws of everything."""
    scores, seen = [], {"a": range(7), "b": range(14), "c": range(7, 14)}
    for seed in range(12):
        rng = np.random.default_rng([3, seed])
        scene = two_ships(14, seed=seed, identities=names, tracks=names)
        c = Ship("c", at_m=(12_000.0, -4000.0))
        scene = drawn(replace(scene, ships=(*scene.ships, c)), rng)
        state = scene.initial()
        for step in range(1, 10):
            said = [only(m, seen[m.carrier]) for m in scene.said(step, rng)]
            state, out = pipeline.step(state, closed(step, said), said)
        assert correction(out, "c").state == "applied"
        scores.append(own_axes_score(correction(out, "c"), scene.truth("c", 9)))
    low, high = mean_interval(3, len(scores), 0.999)
    assert 0.6 * low < np.mean(scores) < high


def only(message: Any, which: Iterable[int]) -> Any:
    """A report of some of the targets."""
    if message.stream != "radar":
        return message
    rows = list(which)
    columns = {
        name: [getattr(message, name)[i] for i in rows]
        for name in ("bearing_rad", "range_m", "sigma_bearing_rad", "sigma_range_m", "track_id",
                     "identity", "identity_kind")
        if getattr(message, name) is not None
    }  # fmt: skip
    return changed(message, **columns)


def test_a_few_wrong_identities_do_not_spoil_the_frame() -> None:
    scene = two_ships(10)
    wrong = ["n1", "n0", *named(10)[2:]]
    state, rng = scene.initial(), np.random.default_rng(1)
    for step in range(1, 7):
        messages = [
            changed(m, identity=wrong) if m.carrier == "b" and m.stream == "radar" else m
            for m in scene.said(step, rng)
        ]
        state, outputs = pipeline.step(state, closed(step, messages), messages)
    found = correction(outputs)
    assert found.state == "applied"
    assert found.pairs == 8
    assert own_axes_score(found, scene.truth("b", 6)) < 5.4


@pytest.mark.parametrize("tracks", [True, False])
def test_a_frame_that_jumps_is_suspended_and_found_anew(tracks: bool) -> None:
    """A gyro restarts: own north of b is another by two degrees. Applied again, and right."""
    rng = np.random.default_rng(4)
    scene = two_ships(12) if tracks else plots(12)
    a, b = scene.ships
    turned = replace(scene, ships=(a, replace(b, north_error_rad=b.north_error_rad + 0.035)))
    state, outputs = scene.run(10, rng)
    assert correction(outputs[-1]).state == "applied"
    seen = []
    for step in range(11, 45):
        said = turned.said(step, rng)
        state, out = pipeline.step(state, closed(step, said), said)
        seen.append(correction(out).state)
        outputs.append(out)
    assert "suspended" in seen[:12]
    assert seen[-1] == "applied"
    assert own_axes_score(correction(outputs[-1]), turned.truth("b", 44)) < 5.4


def test_an_event_without_pairs_changes_nothing_but_doubt() -> None:
    """The frame is carried on: its covariance grows, its state stays."""
    scene = two_ships(8)
    rng = np.random.default_rng(1)
    state, outputs = scene.run(6, rng)
    held = correction(outputs[-1])
    blind = replace(scene, targets_m=np.zeros((0, 2)), identities=[])
    late = 6 + round(state.settings.logs.max_age_s) + 1
    messages = [changed(m, seq=7) if m.stream != "info" else m for m in blind.said(late)]
    _, out = pipeline.step(state, closed(7, messages, t_ns=stamp(late)), messages)
    found = correction(out)
    assert (found.state, found.pairs, found.valid_t_ns) == ("applied", 0, stamp(late))
    assert found.own_axes is not None
    assert held.own_axes is not None
    assert found.own_axes.covariance[0] > held.own_axes.covariance[0]


# operators


def test_an_operator_binds_and_forbids_tracks_in_a_search() -> None:
    scene = two_ships(6, identities=False)
    messages = scene.said(1)
    orders = [
        event(1, seq=1, kind="bind", pair=["a/radar/t0", "b/radar/t0"]),
        event(1, seq=2, kind="forbid", pair=["a/radar/t1", "b/radar/t1"]),
    ]
    _, outputs = pipeline.step(scene.initial(), closed(1, messages), [*messages, *orders])
    found = {target.logs[0].rpartition("/")[2]: target for target in association(outputs).targets}
    assert found["0"].method == "operator"
    assert "1" not in found
    assert correction(outputs).pairs == 5


def test_a_pair_forbidden_later_is_left_out_from_then_on() -> None:
    rng = np.random.default_rng(1)
    scene = two_ships(6)
    state, outputs = scene.run(4, rng)
    assert correction(outputs[-1]).pairs == 6
    said = scene.said(5, rng)
    order = event(5, kind="forbid", pair=["a/radar/t3", "b/radar/t3"])
    _, out = pipeline.step(state, closed(5, said), [*said, order])
    assert correction(out).pairs == 5


# events


def test_reports_that_alternate_are_fused_with_their_neighbours_each_once() -> None:
    """Ship b looks 0.3 s before a: one event a step, when a has reported."""
    scene = two_ships(8)
    a, b = scene.ships
    scene = replace(scene, ships=(a, replace(b, looks_before_s=0.3)))
    _, outputs = scene.run(5, np.random.default_rng(1))
    found = [correction(out) for out in outputs[1:]]
    assert [c.valid_t_ns for c in found] == [stamp(step) for step in range(2, 6)]
    assert {c.pairs for c in found} == {8}


def test_a_source_that_has_fallen_silent_is_not_waited_for() -> None:
    """c is heard once; a and b go on, an event a step when it is overdue."""
    rng = np.random.default_rng(1)
    c = Ship("c", at_m=(-7000.0, 5000.0), looks_before_s=0.2)
    scene = two_ships(8)
    scene = replace(scene, ships=(*scene.ships, c))
    state, times = scene.initial(), []
    for step in range(1, 8):
        said = [m for m in scene.said(step, rng) if m.carrier != "c" or step == 1]
        state, out = pipeline.step(state, closed(step, said), said)
        times.append(correction(out).valid_t_ns)
    assert times[4:] == [stamp(5), stamp(6), stamp(7)]


def test_tracks_without_a_filter_make_a_frame_no_surer_than_their_memory() -> None:
    """A source that sends tracks, and does not say more: T seconds are few independent looks."""
    scene, steps = two_ships(8), 19
    sigmas = []
    for tracks in (False, True):
        state, rng = scene.initial(), np.random.default_rng(1)
        for step in range(1, steps + 1):
            said = [
                changed(m, properties=changed(m.properties, sends_tracks=tracks, filter_memory_s=4))
                if m.stream == "info" and m.carrier == "b"
                else m
                for m in scene.said(step, rng)
            ]
            state, out = pipeline.step(state, closed(step, said), said)
        axes = correction(out).own_axes
        assert axes is not None
        sigmas.append(np.sqrt(axes.covariance[0]))
    # both logs of a pair weigh alike: n looks of one side, 1 + T / 2 memories of the other
    looks = 1 + (steps - 1) / 8
    assert sigmas[1] / sigmas[0] == pytest.approx(np.sqrt((1 + steps / looks) / 2), rel=0.25)
