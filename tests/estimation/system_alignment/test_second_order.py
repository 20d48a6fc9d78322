"""The second-order term of a range against draws from the filter's own distribution."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.system_alignment import (
    Filtered,
    dead_reckoning,
    places_of,
    prior,
    ranges,
    second_order,
    started,
)

HEIGHT_M = 100.0
BEACONS_M = [[900.0, 300.0, 0.0], [-20_000.0, 5_000.0, 400.0]]


def doubtful(sigma_place_m: float) -> Filtered:
    """A filter at its start that knows neither its place nor the beacons' well."""
    state = started(dead_reckoning([1.0], 10.0, 0.0, 0.1, 0.01), prior(BEACONS_M, 60.0))
    covariance = state.covariance.copy()
    covariance[:2, :2] = sigma_place_m**2 * np.eye(2)
    return state._replace(covariance=covariance)


def drawn_ranges(state: Filtered, beacon: int, count: int = 200_000) -> Array:
    """Ranges (count,) less the one between the means, linear part taken out."""
    rng = np.random.default_rng(1)
    mean = np.array([*state.place[:2], HEIGHT_M]) - state.theta[places_of(state.theta)[beacon]]
    spread = np.diag(np.append(np.diag(state.covariance)[:2], 0.0)) + 60.0**2 * np.eye(3)
    moved = rng.multivariate_normal(np.zeros(3), spread, count)
    length = np.linalg.norm(mean)
    bent: Array = np.linalg.norm(mean + moved, axis=1) - length - moved @ mean / length
    return bent


def test_mean_and_variance_are_those_of_draws() -> None:
    """Beyond the second order the next terms are some (150 / 950) of it: a tenth."""
    state = doubtful(100.0)
    after = second_order(state, ranges(0, [0], [1_000.0], 5.0), HEIGHT_M)
    bent = drawn_ranges(state, 0)
    assert 1_000.0 - after.value_m[0] == pytest.approx(bent.mean(), rel=0.1)
    assert after.sigma_m[0] ** 2 - 25.0 == pytest.approx(bent.var(), rel=0.2)


def test_nothing_changes_far_away() -> None:
    after = second_order(doubtful(20.0), ranges(0, [1], [20_000.0], 5.0), HEIGHT_M)
    assert after.value_m[0] == pytest.approx(20_000.0, abs=0.3)
    assert after.sigma_m[0] == pytest.approx(5.0, abs=0.02)


def test_a_difference_bends_by_both_its_ranges() -> None:
    state = doubtful(100.0)
    single = second_order(state, ranges(0, [0, 1], [1_000.0, 20_000.0], 5.0), HEIGHT_M)
    both = second_order(state, ranges(0, [0], [-19_000.0], 5.0, reference=1), HEIGHT_M)
    longer = [1_000.0, 20_000.0] - single.value_m
    assert -19_000.0 - both.value_m[0] == pytest.approx(longer[0] - longer[1])
    assert both.sigma_m[0] ** 2 - 25 == pytest.approx(np.sum(single.sigma_m**2 - 25))
