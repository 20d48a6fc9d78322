"""Frames that navigation knows better than a plot would tell are used, targets in common or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion_center import pipeline
from fusion_center.published import Outputs
from fusion_center.state import State
from schemas.messages import Tracks
from tests.fusion_center.scenes import Scene, closed, correction, drawn, own_axes_score, two_ships
from tests.fusion_center.test_joint import only, plots, states

APART_M, REACH_M = 40_000.0, 15_000.0
STEPS = 40


def navigating(scene: Scene, sigma_m: float, sigma_north_rad: float) -> Scene:
    """With errors drawn from these sigmas."""
    ships = tuple(
        replace(ship, sigma_position_m=sigma_m, sigma_north_rad=sigma_north_rad)
        for ship in scene.ships
    )
    return drawn(replace(scene, ships=ships), np.random.default_rng(8))


def apart(sigma_m: float, sigma_north_rad: float, apart_m: float = APART_M) -> Scene:
    """Two ships, each with six targets of its own about it."""
    near = np.random.default_rng(4).uniform(-9_000, 9_000, (12, 2))
    near[6:] += [0.0, apart_m]
    scene = two_ships(12, identities=False, tracks=False)
    a, b = (replace(ship, range_max_m=REACH_M) for ship in scene.ships)
    ships = (a, replace(b, at_m=(0.0, apart_m)))
    reckoning = {"navigation": {"sigma_speed_mps": 5.0}}  # what a frame drifts by unseen
    scene = replace(scene, ships=ships, targets_m=near, fusion=reckoning)
    return navigating(scene, sigma_m, sigma_north_rad)


def own_targets_only(scene: Scene) -> tuple[State, list[Outputs]]:
    """Each ship reports its own six."""
    state, outputs, rng = scene.initial(), [], np.random.default_rng(9)
    for step in range(1, STEPS + 1):
        said = [
            only(m, range(6) if m.carrier == "a" else range(6, 12)) for m in scene.said(step, rng)
        ]
        state, out = pipeline.step(state, closed(step, said), said)
        outputs.append(out)
    return state, outputs


def shown(outputs: Outputs) -> int:
    return next(len(out.message.tracks) for out in outputs if isinstance(out.message, Tracks))


def test_carriers_that_know_where_they_are_use_common_targets_from_the_start() -> None:
    """Data of a few events cannot halve 5 m and .02 deg of a prior; they need not."""
    scene = navigating(plots(), 5.0, np.radians(0.02))
    _, outputs = scene.run(8, np.random.default_rng(1))
    assert states(outputs)[-1] == "applied"
    found = correction(outputs[-1])
    assert found.directions[0].ratio > 0.5
    assert own_axes_score(found, scene.truth("b", 8)) < 5.4  # 0.1 % of chi2 3


@pytest.mark.parametrize(("sigma_m", "sigma_north_rad"), [(0.0, 0.0), (10.0, np.radians(0.05))])
def test_carriers_that_know_where_they_are_need_no_common_target(
    sigma_m: float, sigma_north_rad: float
) -> None:
    """And stay known as navigation goes on, though nobody measures how the frame drifts."""
    scene = apart(sigma_m, sigma_north_rad)
    _, outputs = own_targets_only(scene)
    assert states(outputs)[-1] == "applied"
    assert shown(outputs[-1]) == 12
    if sigma_m:
        assert own_axes_score(correction(outputs[-1]), scene.truth("b", STEPS)) < 5.4


def test_what_a_plot_would_notice_is_not_taken_on_trust() -> None:
    """100 m of plots of 100 m are noticed: the frame waits for common targets."""
    _, outputs = own_targets_only(apart(100.0, np.radians(0.05)))
    assert set(states(outputs)) == {"observing"}
    assert shown(outputs[-1]) == 6


def test_navigation_is_not_trusted_against_targets_that_both_should_see() -> None:
    """Twelve targets within reach of both, six in each one's eyes: somebody is elsewhere."""
    _, outputs = own_targets_only(apart(10.0, np.radians(0.05), apart_m=0.0))
    assert set(states(outputs)) == {"observing"}


def test_a_frame_taken_on_trust_is_given_up_when_targets_contradict_it() -> None:
    """Ship b is 2 km from where it says, to 10 m; from step 25 on both see the same six targets."""
    scene = apart(10.0, np.radians(0.05), apart_m=20_000.0)
    a, b = scene.ships
    apart_m = np.array([[0.0, -8_000.0 + 500.0 * k] for k in range(3)])
    lens_m = np.array([[-4_000.0 + 1_500.0 * k, 9_000.0 + 400.0 * (k % 3)] for k in range(6)])
    targets = np.vstack([apart_m, np.add(apart_m, (0.0, 36_000.0)), lens_m])
    astray = replace(b, position_error_m=(2_000.0, 0.0))
    scene = replace(scene, ships=(a, astray), targets_m=targets)
    state, rng, said_of = scene.initial(), np.random.default_rng(9), []
    for step in range(1, 45):
        lens = range(6, 12 if step >= 25 else 6)
        mine = {"a": (*range(3), *lens), "b": (*range(3, 6), *lens)}
        said = [only(m, mine[m.carrier]) for m in scene.said(step, rng)]
        state, out = pipeline.step(state, closed(step, said), said)
        said_of.append(correction(out).state)
    assert said_of[23] == "applied"
    assert "applied" not in said_of[30:]
