"""Maximum likelihood of a known motion: symmetries, the bound, honest sigmas, batches."""

from __future__ import annotations

import numpy as np
import pytest

from bench.bearings_only.scenes import MOTIONS, Drawn, benchmark, ensemble
from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_ACCELERATION,
    CONSTANT_VELOCITY,
    Bearings,
    Estimate,
    cramer_rao,
    maximum_likelihood,
    polynomial,
)
from estimation.consistency import mean_interval, nees

RUNS = 300


def relative(found: Estimate, scene: Drawn) -> Array:
    return np.asarray(1 / found.inverse_range().value / scene.range_m - 1)


@pytest.mark.parametrize("kind", "ABCD")
@pytest.mark.parametrize("name", ["S", "M"])
def test_exact_without_noise(name: str, kind: str) -> None:
    scene = benchmark(np.random.default_rng(1), name, kind, 1e-3, 2)
    found = maximum_likelihood(scene.given, MOTIONS[kind])
    np.testing.assert_allclose(relative(found, scene), 0, atol=2e-5)
    state = found.state(600.0)
    np.testing.assert_allclose(state.position_m, scene.place_m, atol=1)
    speed = np.linalg.norm(state.velocity_mps, axis=1)
    np.testing.assert_allclose(speed, scene.speed_mps, rtol=1e-3)


@pytest.mark.parametrize(
    ("name", "kind"), [("S", "A"), ("S", "B"), ("M", "A"), ("M", "B"), ("M", "C")]
)
def test_attains_the_bound(name: str, kind: str) -> None:
    scene = benchmark(np.random.default_rng(2), name, kind, 60, RUNS)
    z = relative(maximum_likelihood(scene.given, MOTIONS[kind]), scene) / scene.bound
    assert np.sqrt(np.mean(z**2)) < 1.05 + 2 / np.sqrt(2 * RUNS)  # two sigmas of an RMS


@pytest.mark.parametrize("kind", "AC")
def test_covariance_is_honest(kind: str) -> None:
    scene = benchmark(np.random.default_rng(3), "S", kind, 10, RUNS)
    found = maximum_likelihood(scene.given, MOTIONS[kind])
    state = found.state(600.0)
    squared = nees(state.position_m - scene.place_m, state.covariance[:, :2, :2]) / 2
    low, high = mean_interval(2, RUNS, 0.999)
    assert low < squared.mean() < high * 1.1  # C is curved: a tenth
    inverse = found.inverse_range()
    inside = np.abs(inverse.value - 1 / scene.range_m) < 1.96 * inverse.sigma
    assert 0.91 < inside.mean() < 0.985  # 300 runs: sigma .013
    assert found.chi2.mean() == pytest.approx(41 - MOTIONS[kind].size + 1, rel=0.04)


def test_a_random_ensemble_attains_the_bound() -> None:
    scene = ensemble(np.random.default_rng(4), "uniform", 200)
    z = relative(maximum_likelihood(scene.given, CONSTANT_VELOCITY), scene) / scene.bound
    assert np.sqrt(np.mean(z[scene.bound < 0.1] ** 2)) < 1.15


def moved(given: Bearings, angle: float, shift: Array, later_s: float) -> Bearings:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return given._replace(
        t_s=given.t_s + later_s,
        observer_m=given.observer_m @ turn.T + shift,
        bearing_rad=given.bearing_rad + angle,
    )


@pytest.mark.parametrize("kind", "ABCD")
def test_turning_and_moving_the_scene_changes_nothing_else(kind: str) -> None:
    scene = benchmark(np.random.default_rng(5), "M", kind, 10, 5)
    other = moved(scene.given, 2.1, np.array([1e5, -3e4]), 5e3)
    one, two = (maximum_likelihood(g, MOTIONS[kind]) for g in (scene.given, other))
    np.testing.assert_allclose(one.inverse_range().value, two.inverse_range().value, rtol=1e-3)
    np.testing.assert_allclose(one.inverse_range().sigma, two.inverse_range().sigma, rtol=1e-2)
    np.testing.assert_allclose(one.chi2, two.chi2, atol=1e-3)


def test_scale() -> None:
    """Everything twice as large, at the same bearings."""
    scene = benchmark(np.random.default_rng(6), "S", "C", 10, 3)
    double = scene.given._replace(observer_m=2 * scene.given.observer_m)
    one, two = (maximum_likelihood(g, CONSTANT_ACCELERATION) for g in (scene.given, double))
    np.testing.assert_allclose(one.inverse_range().value, 2 * two.inverse_range().value, rtol=1e-6)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_batch_is_its_targets_one_by_one(degree: int) -> None:
    scene = benchmark(np.random.default_rng(7), "S", "A", 10, 6)
    batch = maximum_likelihood(scene.given, polynomial(degree)).inverse_range()
    for i in range(6):
        one = scene.given._replace(bearing_rad=scene.given.bearing_rad[i])
        alone = maximum_likelihood(one, polynomial(degree)).inverse_range()
        np.testing.assert_allclose(alone.value[0], batch.value[i], rtol=1e-8)
        np.testing.assert_allclose(alone.sigma[0], batch.sigma[i], rtol=1e-8)


def test_times_and_places_of_each_target_give_the_same_as_shared_ones() -> None:
    given = benchmark(np.random.default_rng(8), "S", "C", 10, 4).given
    apart = Bearings(
        np.tile(given.t_s, (4, 1)),
        np.tile(given.observer_m, (4, 1, 1)),
        given.bearing_rad,
        np.tile(given.sigma_rad, (4, 1)),
    )
    one, two = (maximum_likelihood(g, CONSTANT_ACCELERATION) for g in (given, apart))
    np.testing.assert_allclose(one.inverse_range().value, two.inverse_range().value, rtol=1e-6)


def test_an_infinite_range_is_regular() -> None:
    """Bearings in which the carrier's turns leave no trace: the target is infinitely far."""
    given = benchmark(np.random.default_rng(9), "S", "A", 10, 1).given
    rng = np.random.default_rng(10)
    line = 1.0 + np.arctan(0.5 * (given.t_s / 300 - 1))
    far = given._replace(bearing_rad=line + rng.normal(0, given.sigma_rad, (50, 41)))
    found = maximum_likelihood(far, CONSTANT_VELOCITY)
    inverse = found.inverse_range()
    assert found.converged.all()
    z = inverse.value / inverse.sigma
    assert abs(z.mean()) < 0.5
    assert 0.75 < z.std() < 1.25


def test_velocity_is_the_derivative_of_the_place() -> None:
    scene = benchmark(np.random.default_rng(11), "S", "D", 10, 2)
    found = maximum_likelihood(scene.given, MOTIONS["D"])
    ahead, behind = found.state(401.0), found.state(399.0)
    slope = (ahead.position_m - behind.position_m) / 2
    np.testing.assert_allclose(found.state(400.0).velocity_mps, slope, atol=1e-3)


def test_the_bound_needs_no_bearings() -> None:
    scene = benchmark(np.random.default_rng(12), "S", "A", 10, 1)
    coefficients = np.array([-1060.7 + 1939.3j, -3.5355 - 3.5355j])
    blind = scene.given._replace(bearing_rad=np.zeros(41))
    truth = cramer_rao(blind, CONSTANT_VELOCITY, coefficients).inverse_range()
    np.testing.assert_allclose(truth.sigma / truth.value, scene.bound, rtol=1e-3)


def test_line_of_sight_against_the_truth() -> None:
    scene = benchmark(np.random.default_rng(13), "S", "A", 10, RUNS)
    line = maximum_likelihood(scene.given, CONSTANT_VELOCITY).line_of_sight()
    own = 5 * np.array([np.sin(np.radians(210)), np.cos(np.radians(210))])
    target = 5 * np.array([np.sin(np.radians(225)), np.cos(np.radians(225))])
    apart = scene.place_m[0] - scene.given.observer_m[-1]
    toward, right = apart / scene.range_m[0], np.array([apart[1], -apart[0]]) / scene.range_m[0]
    truth = np.array(
        [
            np.arctan2(apart[0], apart[1]),
            (target - own) @ right / scene.range_m[0],
            (target - own) @ toward / scene.range_m[0],
        ]
    )
    seen = np.stack([line.bearing_rad, line.bearing_rate_rad_s, line.range_rate_over_range], axis=1)
    low, high = mean_interval(3, RUNS, 0.999)
    assert low < nees(seen - truth, line.covariance).mean() / 3 < high
