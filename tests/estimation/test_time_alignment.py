"""Logs at one instant: the paper's formula, honest covariances, stamps that err."""

from __future__ import annotations

import numpy as np
import pytest

from bench.joint_fusion import instants
from estimation.consistency import nees
from estimation.time_alignment import (
    Carried,
    at_last,
    at_tick,
    carried,
    fused_logs,
    sigma_at_last,
    sigma_of_fused,
    time_offset,
)


def test_the_papers_formula_is_the_general_one_of_two() -> None:
    carrying = np.linspace(0, 20, 50)
    both = sigma_of_fused(np.full((50, 2), 3.0), np.column_stack([carrying, np.zeros(50)]))
    np.testing.assert_allclose(sigma_at_last(3.0, carrying), both, rtol=1e-12)


def test_its_limits() -> None:
    assert sigma_at_last(1.0, 0.0) == pytest.approx(np.sqrt(0.5))  # printed .705
    assert sigma_at_last(1.0, 1e6) == pytest.approx(1.0)


def test_instants() -> None:
    times = np.array([[1.0, 3.0], [9.0, 10.0]])
    np.testing.assert_array_equal(at_last(times, 5.0), [3.0, 10.0])
    np.testing.assert_array_equal(at_tick(times, 5.0), [5.0, 10.0])


def test_one_dimension_of_fusion_is_the_formula() -> None:
    logs = Carried(np.zeros((2, 1)), np.array([[[9.0 + 4.0]], [[9.0]]]))
    assert fused_logs(logs).covariance[0, 0] == pytest.approx(sigma_at_last(3.0, 2.0) ** 2)


def test_carrying_is_honest_with_all_that_is_unknown() -> None:
    """The log, the velocity, the manoeuvre and the stamp err; the covariance says by how much."""
    rng = np.random.default_rng(1)
    runs, passed, q = 8000, 4.0, 0.5
    spread = np.array([[25.0, 5.0], [5.0, 16.0]])
    speed_spread = np.array([[1.0, 0.3], [0.3, 2.0]])
    velocity = rng.normal(0, 30.0, (runs, 2))
    believed = velocity + rng.multivariate_normal([0, 0], speed_spread, runs)
    late = rng.normal(0, 0.4, (runs, 1))
    manoeuvre = rng.normal(0, np.sqrt(q * passed**3 / 3), (runs, 2))
    truth = passed * velocity + manoeuvre
    place = rng.multivariate_normal([0, 0], spread, runs) + late * velocity
    log = Carried(place, np.broadcast_to(spread, (runs, 2, 2)))
    speeds = np.broadcast_to(speed_spread, (runs, 2, 2))
    found = carried(log, believed, speeds, np.full(runs, passed), np.full(runs, 0.4), q)
    # 16 000 degrees of freedom: sigma .011
    assert nees(found.place_m - truth, found.covariance).mean() / 2 == pytest.approx(1, abs=0.05)


def test_there_and_back_only_doubt_is_left() -> None:
    log = Carried(np.array([1.0, 2.0]), np.eye(2))
    there = carried(log, np.array([3.0, 4.0]), np.zeros((2, 2)), 2.0)
    np.testing.assert_array_equal(there.place_m, [7.0, 10.0])
    back = carried(there, np.array([3.0, 4.0]), np.zeros((2, 2)), -2.0)
    np.testing.assert_array_equal(back.place_m, log.place_m)
    np.testing.assert_array_equal(back.covariance, log.covariance)


def test_a_stamp_blurs_along_the_way_only() -> None:
    log = Carried(np.zeros(2), np.eye(2))
    found = carried(log, np.array([100.0, 0.0]), np.zeros((2, 2)), 0.0, 0.1)
    np.testing.assert_allclose(found.covariance, [[101.0, 0.0], [0.0, 1.0]])


def test_offsets_are_found_with_an_honest_sigma() -> None:
    rng = np.random.default_rng(2)
    truth = rng.normal(0, 0.5, 4000)
    velocity = rng.normal(0, 60.0, (4000, 2))
    velocity[:100] = 0.0
    misclosure = truth[:, None] * velocity + rng.normal(0, 20.0, (4000, 2))
    spread = np.broadcast_to(400.0 * np.eye(2), (4000, 2, 2))
    found, sigma = time_offset(misclosure, spread, velocity, 0.5)
    assert np.mean(((found - truth) / sigma) ** 2) == pytest.approx(1, abs=0.09)  # sigma .022
    np.testing.assert_array_equal(sigma[:100], 0.5)
    np.testing.assert_array_equal(found[:100], 0.0)
    assert np.median(sigma[100:]) < 0.3


def test_known_sigmas_of_stamps_keep_the_logs_honest() -> None:
    with_it, without = instants.blurred_clocks(3, 4000)
    assert 0.9 < with_it < 1.1
    assert without > 1.5
