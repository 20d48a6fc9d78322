"""Several carriers with doubtful norths and places, and bearings with elevations."""

from __future__ import annotations

import numpy as np
import pytest

from bench.bearings_only.carriers import SIGMA, pair
from bench.bearings_only.scenes import BENCHMARKS, MINUTE, Own, heading, own_track
from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_VELOCITY,
    Bearings,
    Elevations,
    FramePrior,
    bearings,
    in_space,
    jointly,
    maximum_likelihood,
)
from estimation.consistency import mean_interval, nees

DEG = np.pi / 180


def ranges(found: object, given: Bearings) -> Array:
    places = found.targets.state(given.t_s[-1]).position_m  # type: ignore[attr-defined]
    return np.asarray(np.linalg.norm(places - given.observer_m[-1], axis=1))


def test_demand_in_small() -> None:
    rng, yaws, errors, squared = np.random.default_rng(1), [], [], []
    for _ in range(40):
        truth = pair(rng)
        found = jointly(truth.carriers, [FramePrior(1 * DEG)])
        assert found.converged
        yaws.append(found.yaw_rad[1] - truth.yaw_rad)
        errors.append(ranges(found, truth.carriers[0]) / truth.ranges_m - 1)
        squared.append(yaws[-1] ** 2 / found.covariance[0, 0])
        assert found.chi2 / found.dof == pytest.approx(1, abs=0.15)
    assert np.median(np.abs(errors)) < 0.006
    assert np.sqrt(np.mean(np.square(yaws))) / MINUTE < 6
    low, high = mean_interval(1, 40, 0.999)
    assert low < np.mean(squared) < high


def test_a_known_north_ignored_is_worse() -> None:
    rng, free, held = np.random.default_rng(2), [], []
    for _ in range(15):
        truth = pair(rng)
        for prior, into in ((1 * DEG, free), (1e-9, held)):
            found = jointly(truth.carriers, [FramePrior(prior)])
            into.append(np.abs(ranges(found, truth.carriers[0]) / truth.ranges_m - 1))
    assert np.median(held) > 3 * np.median(free)


def test_the_other_carrier_s_place_may_be_in_doubt() -> None:
    rng, squared = np.random.default_rng(3), []
    for _ in range(25):
        truth = pair(rng)
        own, other = truth.carriers
        shift = rng.normal(0, 200, 2)
        moved = other._replace(observer_m=other.observer_m - shift)
        found = jointly((own, moved), [FramePrior(1 * DEG, 200.0)])
        error = np.concatenate([[found.yaw_rad[1] - truth.yaw_rad], found.offset_m[1] - shift])
        squared.append(nees(error, found.covariance))
    low, high = mean_interval(3, 25, 0.999)
    assert low < np.mean(squared) / 3 < high


def test_alone_it_is_maximum_likelihood() -> None:
    own = pair(np.random.default_rng(4)).carriers[0]
    joint = jointly([own], [])
    alone = maximum_likelihood(own, CONSTANT_VELOCITY)
    np.testing.assert_allclose(
        joint.targets.inverse_range().value, alone.inverse_range().value, rtol=1e-3, atol=1e-9
    )


def test_a_target_that_one_carrier_does_not_see() -> None:
    own, other = pair(np.random.default_rng(5)).carriers
    hidden = other.bearing_rad.copy()
    hidden[3] = np.nan
    found = jointly((own, other._replace(bearing_rad=hidden)), [FramePrior(1 * DEG)])
    assert found.converged
    alone = jointly([own], []).targets.inverse_range()
    np.testing.assert_allclose(found.targets.inverse_range().value[3], alone.value[3], rtol=0.01)


def test_turning_the_whole_scene_changes_no_yaw() -> None:
    truth = pair(np.random.default_rng(6))
    angle = 1.3
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned = [
        c._replace(observer_m=c.observer_m @ turn.T, bearing_rad=c.bearing_rad + angle)
        for c in truth.carriers
    ]
    prior = [FramePrior(1 * DEG)]
    one, two = jointly(truth.carriers, prior), jointly(turned, prior)
    assert one.yaw_rad[1] == pytest.approx(two.yaw_rad[1], abs=1e-6)


def test_what_does_not_fit_is_refused() -> None:
    own, other = pair(np.random.default_rng(7)).carriers
    with pytest.raises(ValueError, match="prior of each"):
        jointly((own, other), [])
    with pytest.raises(ValueError, match="same targets"):
        jointly((own, other._replace(bearing_rad=other.bearing_rad[:3])), [FramePrior(0.1)])


def low_target(own: Own, runs: int, seed: int) -> tuple[Bearings, Elevations, float]:
    """A ship seen from 300 m."""
    t, rng = 15.0 * np.arange(41), np.random.default_rng(seed)
    track = own_track(own, t)
    d = 3000j + 5 * heading(225) * t - track
    noisy = np.arctan2(d.real, d.imag) + rng.normal(0, SIGMA, (runs, 41))
    up = np.arctan2(-300.0, np.abs(d)) + rng.normal(0, SIGMA, (runs, 41))
    given = bearings(t, np.stack([track.real, track.imag], axis=1), noisy, SIGMA)
    return given, Elevations(up, np.full(41, SIGMA), np.full(41, 300.0)), float(np.abs(d[-1]))


def test_a_known_altitude_gives_the_range_without_a_manoeuvre() -> None:
    given, angles, true_m = low_target(Own(5, (210.0,), ()), 200, 8)
    found = in_space(given, angles, 0.0, 1.0).horizontal.inverse_range()
    z = (found.value - 1 / true_m) / found.sigma
    assert 0.85 < np.sqrt(np.mean(z**2)) < 1.15
    assert np.std(found.value) * true_m < 0.03
    blind = in_space(given, angles).horizontal.inverse_range()
    assert np.median(blind.sigma / np.abs(blind.value)) > 1


def test_altitude_is_found_with_a_manoeuvre() -> None:
    given, angles, _ = low_target(BENCHMARKS["S"].own, 200, 9)
    found = in_space(given, angles)
    z = found.altitude_m / found.sigma_altitude_m
    assert abs(np.mean(z)) < 0.4  # 200 runs, and the range is curved
    assert 0.8 < np.std(z) < 1.25
    alone = maximum_likelihood(given, CONSTANT_VELOCITY).inverse_range()
    assert (found.horizontal.inverse_range().sigma < alone.sigma * 1.3).mean() > 0.9


def test_without_elevations_it_is_the_plane() -> None:
    given, angles, _ = low_target(BENCHMARKS["S"].own, 5, 10)
    nothing = angles._replace(elevation_rad=np.full((5, 41), np.nan))
    flat = maximum_likelihood(given, CONSTANT_VELOCITY).inverse_range()
    found = in_space(given, nothing).horizontal.inverse_range()
    np.testing.assert_allclose(found.value, flat.value, rtol=1e-3)
    np.testing.assert_allclose(found.sigma, flat.sigma, rtol=1e-2)
