"""One joint state of a group: derivatives, gauge, clocks, fixes, and the system demand in small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.navigation import together
from bench.navigation.together import OWN, Truth, scene
from estimation.consistency import nees, rms
from estimation.frames import rotation_clockwise
from estimation.joint_navigation import (
    CLOCK,
    CLOCK_DRIFT,
    HEADING,
    LOG_DRIFT,
    CarrierPrior,
    Group,
    anchored,
    azimuths,
    constant,
    fixes,
    ranging,
    relative,
    solve,
    target_logs,
    with_north_of,
)
from estimation.joint_navigation.filtered import filtered, source_block
from estimation.joint_navigation.online import LOG_DRIFT as SOURCE_DRIFT
from estimation.joint_navigation.rows import Factors
from estimation.system_alignment import PLAIN, dead_reckoning
from estimation.system_alignment.losses import squares


def test_the_system_demand_in_small() -> None:
    found = together.outcomes(3, 4)
    assert all(outcome.solved for outcome in found)
    # four runs of eleven errors: NEES sigma .21
    assert 0.4 < np.mean([outcome.nees for outcome in found]) < 1.7
    assert rms([outcome.place_m for outcome in found]) < 10
    assert np.degrees(rms([outcome.heading_rad for outcome in found])) < 0.1
    assert rms([outcome.log_time_s for outcome in found]) < 0.09


def small(seed: int = 0, epochs: int = 12) -> Group:
    """Two carriers, two beacons (one unknown), a target, every kind of factor, every constant."""
    rng = np.random.default_rng(seed)
    k = np.arange(epochs)
    heading = 0.1 * k
    paths = tuple(
        dead_reckoning(5.0, 40.0, heading + c, 0.4, 0.005, start_m=(3e3 * c, 500.0))
        for c in range(2)
    )
    prior = CarrierPrior(100.0, 0.02, 0.02, 0.5, 50.0, 0.1, 0.5, 0.01)
    return Group(
        paths=paths,
        priors=(prior, prior),
        beacons_m=np.array([[2e3, -2e3, 30.0], [-1e3, 3e3, 50.0]]),
        sigma_beacons_m=np.array([[0.0, 0.0, 0.0], [100.0, 100.0, 0.0]]),
        targets=1,
        ranging=ranging(
            np.tile(k, 4),
            np.repeat([0, 0, 1, 1], epochs),
            np.repeat([1, 2, 3, 3], epochs),
            3e3 + 100 * rng.standard_normal(4 * epochs),
            5.0,
            reference=np.repeat([-1, -1, -1, 2], epochs),
            clocked=np.repeat([True, True, False, False], epochs),
        ),
        logs=target_logs(np.tile(k, 2), k.repeat(2) % 2, 0, 0.3, 5e3, 0.01, 30.0),
        azimuths=azimuths(k, 1, 2, 0.5, 0.01),
        fixes=fixes([3, 7], 0, [[100.0, 800.0], [400.0, 900.0]], 50.0),
    )


def test_rows_are_derivatives() -> None:
    group = small()
    factors = Factors(group, squares)
    rng = np.random.default_rng(1)
    x = 1e3 * rng.standard_normal((12, group.block))
    free = group.mean[group.free] + 0.01 * rng.standard_normal(len(group.free))
    free[[6, 7, 14, 15]] = 0.0  # what a log is late by multiplies velocities not bent again
    at = factors(x, free)
    step = 1e-6
    for index in range(len(free)):
        moved = free.copy()
        moved[index] += step
        there = factors(x, moved)
        for now, later, by in (
            (at.observed, there.observed, at.observed.by_theta),
            (at.chain, there.chain, at.chain.by_theta),
        ):
            change = (later.residual - now.residual) / step
            scale = 1e-3 * (1 + np.abs(by[..., index]).max())
            np.testing.assert_allclose(by[..., index], change, atol=scale)
    for column in range(group.block):
        moved = x.copy()
        moved[:, column] += step
        change = (factors(moved, free).observed.residual - at.observed.residual) / step
        np.testing.assert_allclose(at.observed.by_epoch[:, column], change, atol=1e-4)


def exact_scene(clock: tuple[float, float] = (0.0, 0.0)) -> Group:
    """A group whose pseudoranges to two surveyed beacons come with a clock and no noise."""
    group = small()
    k = np.arange(12)
    places = np.stack([path.path_m for path in group.paths], axis=1)
    values = [
        np.sqrt(np.sum((places[:, 0] - beacon[:2]) ** 2, axis=1) + beacon[2] ** 2)
        for beacon in group.beacons_m
    ]
    late = clock[0] + clock[1] * group.time_s
    seen = ranging(
        np.tile(k, 2),
        0,
        np.repeat([2, 3], 12),
        np.concatenate(values) + np.tile(late, 2),
        1.0,
        clocked=True,
    )
    nothing = target_logs([], [], [], [], [], [], [])
    return replace(
        group,
        sigma_beacons_m=np.zeros((2, 3)),
        targets=0,
        ranging=seen,
        logs=nothing,
        azimuths=azimuths([], [], [], [], []),
        fixes=fixes([], [], [], []),
    )


def test_a_ranging_clock_is_found() -> None:
    found = solve(exact_scene((30.0, 0.08)))
    sigma = np.sqrt(np.diag(found.covariance))
    assert abs(found.constants[0, CLOCK] - 30) < 3 * sigma[constant(0, CLOCK)]
    assert abs(found.constants[0, CLOCK_DRIFT] - 0.08) < 3 * sigma[constant(0, CLOCK_DRIFT)]
    assert sigma[constant(0, CLOCK)] < 25
    assert "clock offset of carrier 2" in found.undetermined


DRIFT = 1e-3
"""Sigma of a clock that is so bad that five minutes show it: .3 s at the end."""


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_clock_of_the_logs_that_drifts_is_found_by_solution_and_filter(seed: int) -> None:
    group, truth = scene(np.random.default_rng([seed, 41]), DRIFT)
    found, (*_, last) = solve(group), filtered(group)
    which = [constant(c, LOG_DRIFT) for c in range(group.carriers)]
    slots = [last.first(source_block(c)) + SOURCE_DRIFT for c in range(group.carriers)]
    covariance = found.covariance[np.ix_(which, which)]
    sigma = np.sqrt(np.diag(covariance))
    assert np.all(sigma < DRIFT / 3)
    drift, online = found.constants[:, LOG_DRIFT], last.mean[slots]
    assert nees(drift - truth.log_drift, covariance) < 21.1  # of 3 dof: once in 10,000
    assert nees(online - truth.log_drift, last.of(slots)) < 21.1
    assert np.all(np.abs(online - drift) < 0.7 * sigma)
    assert np.sqrt(np.diag(last.of(slots))) == pytest.approx(sigma, rel=0.05)


def test_a_clock_that_is_said_not_to_drift_is_left_alone() -> None:
    group, _ = scene(np.random.default_rng([1, 41]))
    assert not {constant(c, LOG_DRIFT) for c in range(group.carriers)} & set(group.free.tolist())


@settings(max_examples=6, deadline=None)
@given(angle=st.floats(-3, 3), east=st.floats(-1e5, 1e5))
def test_turning_and_moving_the_scene_changes_nothing_else(angle: float, east: float) -> None:
    group, shift = exact_scene((10.0, 0.0)), np.array([east, -300.0])
    rotation = rotation_clockwise(angle)
    paths = tuple(
        path._replace(
            travel_m=path.travel_m @ rotation.T,
            covariance=rotation @ path.covariance @ rotation.T,
            start_m=path.start_m @ rotation.T + shift,
        )
        for path in group.paths
    )
    beacons = group.beacons_m.copy()
    beacons[:, :2] = beacons[:, :2] @ rotation.T + shift
    here, there = solve(group), solve(replace(group, paths=paths, beacons_m=beacons))
    back = (there.carriers_m - shift) @ rotation
    np.testing.assert_allclose(back, here.carriers_m, atol=0.05)
    np.testing.assert_allclose(
        there.constants[:, [HEADING, CLOCK]], here.constants[:, [HEADING, CLOCK]], atol=0.05
    )


def test_a_common_turn_about_the_only_beacon_is_the_gauge() -> None:
    """Without a north that is right by definition, the headings stay as the prior has them."""
    group, _ = scene(np.random.default_rng(4))
    freed = replace(group, priors=(together.PRIOR,) * together.CARRIERS)
    loose, held = (
        np.sqrt(np.diag(solve(g).covariance)[constant(1, HEADING)]) for g in (freed, group)
    )
    assert loose > 0.5 * together.SIGMA_HEADING_RAD
    assert held < 0.1 * together.SIGMA_HEADING_RAD
    assert with_north_of(freed, OWN).priors[OWN].heading_rad == 0


def test_an_anchor_is_the_whole_gauge() -> None:
    group, _ = scene(np.random.default_rng(5))
    blind = replace(anchored(group, OWN), sigma_beacons_m=np.array([[1e4, 1e4, 0.0]]))
    found = solve(blind)
    assert found.status == "solved"
    first = blind.paths[OWN].start_m
    sigma = np.sqrt(np.trace(blind.paths[OWN].covariance[0]))
    assert np.linalg.norm(found.carriers_m[0, OWN] - first - blind.paths[OWN].travel_m[0]) < (
        5 * sigma + 5
    )
    assert found.constants[OWN, HEADING] == 0
    np.testing.assert_array_equal(relative(found, OWN)[OWN], 0)


def test_relative_is_in_own_axes() -> None:
    group, _ = scene(np.random.default_rng(6))
    found = solve(group)
    turned = found._replace(constants=found.constants + 0.3)
    apart = found.carriers_m[-1] - found.carriers_m[-1, 1]
    np.testing.assert_allclose(
        relative(turned, 1) @ rotation_clockwise(turned.constants[1, HEADING]).T, apart
    )


def test_one_more_measurement_never_raises_a_sigma() -> None:
    group, _ = scene(np.random.default_rng(7))
    wide = solve(group, PLAIN)
    k = np.arange(0, 120, 10)
    place = wide.carriers_m[k, 1]
    more = solve(replace(group, fixes=fixes(k, 1, place, 20.0)), PLAIN)
    before, after = (np.diag(found.covariance)[group.free] for found in (wide, more))
    assert np.all(after <= before * (1 + 1e-4))  # the point moves a little too
    assert np.trace(more.end_covariance) < np.trace(wide.end_covariance)


def test_places_are_honest_all_along() -> None:
    rng = np.random.default_rng(8)
    told = []
    for _ in range(3):
        group, truth = scene(rng)
        told.append(_path_nees(group, truth))
    assert 0.4 < np.mean(told) < 1.9  # three runs, each a handful of independent places


def _path_nees(group: Group, truth: Truth) -> float:
    found = solve(group)
    error = (found.carriers_m - truth.places_m).reshape(len(truth.places_m), -1)
    inverse = np.linalg.inv(found.place_covariances)
    return float(np.einsum("ki,kij,kj->k", error, inverse, error).mean()) / error.shape[1]


def test_what_is_not_there_is_refused() -> None:
    group = small()
    with pytest.raises(ValueError, match="a prior of each carrier"):
        solve(replace(group, priors=group.priors[:1]))
    with pytest.raises(ValueError, match="epochs 0 to 11"):
        solve(replace(group, fixes=fixes(12, 0, [[0.0, 0.0]], 1.0)))
    with pytest.raises(ValueError, match="nodes 0 to 3"):
        solve(replace(group, azimuths=azimuths(0, 0, 4, 0.0, 0.1)))
    with pytest.raises(ValueError, match="targets 0 to 0"):
        solve(replace(group, logs=target_logs(0, 0, 1, 0.0, 1.0, 0.1, 1.0)))
    with pytest.raises(ValueError, match="carriers 0 to 1"):
        solve(replace(group, fixes=fixes(0, 2, [[0.0, 0.0]], 1.0)))


def test_nothing_measured_leaves_the_prior() -> None:
    group = replace(exact_scene(), ranging=ranging([], [], [], [], []))
    found = solve(group)
    assert found.status == "solved"
    np.testing.assert_allclose(found.carriers_m[:, 0], group.paths[0].path_m, atol=1e-6)
    assert len(found.undetermined) == len(group.free)
