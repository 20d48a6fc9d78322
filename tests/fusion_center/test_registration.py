"""The frame of one instant: exact where there is no noise, honest where there is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from estimation.consistency import mean_interval
from estimation.frames import target_from_source, yaw_rad
from fusion_center.relative_frames.corrections import poses
from fusion_center.relative_frames.registration import METHODS, in_own_plane
from fusion_center.sources.sightings import Sightings
from schemas.messages import Pose, Quality
from tests.fusion_center.scenes import (
    CLOSED_FORM,
    Scene,
    Ship,
    correction,
    drawn,
    matrix,
    named,
    own_axes_score,
    stamp,
    targets_around,
    two_ships,
)

RUNS = 200


def test_without_noise_the_frame_is_found() -> None:
    """To a hundredth of the claimed sigma with the prior wide, the linearisation done at truth."""
    scene = two_ships(12)
    sure = [replace(s, north_error_rad=0.0, position_error_m=(0.0, 0.0)) for s in scene.ships]
    scene = replace(scene, ships=tuple(sure))
    _, outputs = scene.run(1)
    axes, truth = correction(outputs[0]).own_axes, scene.truth("b", 1)
    assert axes is not None
    sigmas = np.sqrt(np.diag(matrix(axes.covariance, 3)))
    error = np.array([*truth.q_m - [axes.east_m, axes.north_m], truth.D_rad - axes.rotation_rad])
    assert np.all(np.abs(error) < 0.01 * sigmas)


@pytest.mark.parametrize("at_m", [(0.0, 80_000.0), (100_000.0, 0.0), (-70_000.0, -70_000.0)])
def test_the_known_part_of_the_frames_is_taken_out(at_m: tuple[float, float]) -> None:
    """Norths that differ by up to half a degree, and no error: nothing is left to correct."""
    rng = np.random.default_rng(1)
    targets = np.array(at_m) / 2 + targets_around(rng, 10, 60_000.0)
    scene = Scene((Ship("a"), Ship("b", at_m=at_m)), targets, identities=named(10))
    _, outputs = scene.run(1)
    found = correction(outputs[0])
    assert found.fixed_axes is not None
    assert found.pairs == 10
    assert found.chi2 < 1e-6
    assert abs(found.fixed_axes.c1_rad) < 1e-7
    assert abs(found.fixed_axes.c2_rad) < 1e-7
    assert math.hypot(found.fixed_axes.offset_east_m, found.fixed_axes.offset_north_m) < 0.01
    a, b = scene.ships
    between = target_from_source(scene.reported_site(a, 1), scene.reported_site(b, 1))
    if at_m[0] > 0:
        assert abs(math.degrees(yaw_rad(between))) > 0.5


def test_covariances_turn_with_their_places() -> None:
    """At 80 deg N, 100 km apart, the norths differ by 5 deg; 20,000 draws, 4 * sqrt(2 / 20000)."""
    here, there = (Pose(latitude_rad=1.4, longitude_rad=longitude) for longitude in (0.2, 0.29))
    between = poses(0, here, there)
    assert abs(math.degrees(yaw_rad(between.own_from_other))) > 5
    covariance = np.array([[900.0, 500.0], [500.0, 400.0]])
    rng = np.random.default_rng(1)
    points = rng.multivariate_normal([3000.0, 9000.0], covariance, 20_000)
    n = len(points)
    names = ("",) * n
    copies = np.tile(covariance, (n, 1, 1))
    seen = Sightings(names, names, (True,) * n, names, names, points, copies, *np.zeros((2, n)))
    turned = in_own_plane(seen, between)
    whitened = np.linalg.solve(turned.covariance[0], np.cov(turned.east_north_m.T))
    np.testing.assert_allclose(whitened, np.eye(2), atol=0.05)


@pytest.mark.parametrize(
    "count", [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(8, marks=pytest.mark.slow)]
)
def test_misclosures_after_correction_have_the_size_they_claim(count: int) -> None:
    """2 dof a pair, however many pairs the correction was made of.

    Pairs of one run share its correction, so runs are taken for what is independent.
    """
    rng = np.random.default_rng(count)
    scores = []
    for seed in range(RUNS):
        _, outputs = drawn(two_ships(count, seed=seed, fusion=CLOSED_FORM), rng).run(1, rng)
        quality = outputs[0][-1].message
        assert isinstance(quality, Quality)
        assert quality.sources[0].nis_dof == 2 * count
        scores.append(quality.sources[0].nis)
    low, high = mean_interval(2, RUNS, 0.999)
    assert low < np.mean(scores) < high


@pytest.mark.parametrize(
    "count", [pytest.param(1, marks=pytest.mark.slow), 3, pytest.param(15, marks=pytest.mark.slow)]
)
def test_errors_of_corrections_are_within_their_covariance_and_chi2_has_its_dof(count: int) -> None:
    rng = np.random.default_rng(100 + count)
    scores, chi2 = [], []
    for seed in range(RUNS):
        scene = drawn(two_ships(count, seed=seed), rng)
        found = correction(scene.run(1, rng)[1][0])
        assert found.dof == 2 * count
        scores.append(own_axes_score(found, scene.truth("b", 1)))
        chi2.append(found.chi2 / found.dof)
    for dof, told in ((3, scores), (2 * count, chi2)):
        low, high = mean_interval(dof, RUNS, 0.999)
        assert low < np.mean(told) < high


@pytest.mark.slow
def test_logs_of_unlike_instants_stay_honest() -> None:
    """Ship b looks 0.4 s before ship a, all move: carried on over the last two logs."""
    rng = np.random.default_rng(9)
    scores = []
    for seed in range(RUNS // 2):
        scene = drawn(two_ships(10, seed=seed), rng)
        a, b = scene.ships
        a = replace(a, velocity_mps=(8.0, -3.0))
        b = replace(b, velocity_mps=(-5.0, 9.0), looks_before_s=0.4)
        scene = replace(scene, ships=(a, b), velocities_mps=rng.normal(0, 9, (10, 2)))
        _, outputs = scene.run(2, rng)
        found = correction(outputs[-1])
        assert found.pairs == 10
        assert found.valid_t_ns == stamp(2)
        scores.append(own_axes_score(found, scene.truth("b", 2)))
    low, high = mean_interval(3, RUNS // 2, 0.999)
    assert low < np.mean(scores) < high


def test_targets_carried_on_cost_sigma_and_not_truth() -> None:
    """Noiseless, all moving: the frame at the later instant is that of the truth there."""
    scene = two_ships(10, seed=2, fusion=CLOSED_FORM)
    a, b = (replace(s, north_error_rad=0.0, position_error_m=(0.0, 0.0)) for s in scene.ships)
    b = replace(b, looks_before_s=0.4, velocity_mps=(-5.0, 9.0))
    moving = np.tile([200.0, -150.0], (10, 1))
    late = replace(scene, ships=(a, b), velocities_mps=moving)
    found = correction(late.run(2)[1][-1])
    at_once = correction(replace(late, ships=(a, replace(b, looks_before_s=0.0))).run(2)[1][-1])
    for c in (found, at_once):
        assert own_axes_score(c, late.truth("b", 2)) < 1e-3
    assert found.own_axes is not None
    assert at_once.own_axes is not None
    assert found.own_axes.covariance[0] > 1.2 * at_once.own_axes.covariance[0]


def test_the_exact_adjustment_is_a_setting_and_honest_at_any_heading() -> None:
    """Ten degrees of heading error: NEES of the two methods on the same 100 draws."""
    scores: dict[str, list[float]] = {method: [] for method in METHODS}
    for method, found in scores.items():
        rng = np.random.default_rng(11)
        for seed in range(RUNS // 2):
            scene = two_ships(10, seed=seed)
            wild = (replace(ship, sigma_north_rad=math.radians(10.0)) for ship in scene.ships)
            scene = replace(scene, ships=tuple(wild), fusion={"registration": {"method": method}})
            scene = drawn(scene, rng)
            _, outputs = scene.run(1, rng)
            assert correction(outputs[0]).method == method
            found.append(own_axes_score(correction(outputs[0]), scene.truth("b", 1)))
    low, high = mean_interval(3, RUNS // 2, 0.999)
    assert low < np.mean(scores["adjustment"]) < high
    assert np.mean(scores["closed_form"]) > high
