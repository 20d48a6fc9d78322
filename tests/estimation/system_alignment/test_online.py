"""The filter online: where the doubt of places bends ranges, it does not feign to learn."""

from __future__ import annotations

import numpy as np
import pytest

from bench.navigation.circling import flight, truth_of
from estimation.consistency import nees
from estimation.system_alignment import align, filtered, resumed


def end_nees(rng: np.random.Generator, sigma_beacon_m: float) -> float:
    """NEES by dimension of the filter after 60 epochs of benchmark G with a vague prior.

    The beacons err by 50 m whatever the prior says: a filter that learns nothing is far below 1.
    """
    flown = flight(rng, 60, sigma_beacon_m=sigma_beacon_m)
    *_, last = filtered(flown.path, flown.logs, flown.prior)
    error = (last.theta - truth_of(flown))[last.free]
    spread = last.theta_covariance[np.ix_(last.free, last.free)]
    return float(nees(error, spread)) / len(error)


@pytest.mark.parametrize("flights", [1, pytest.param(6, marks=pytest.mark.slow)])
def test_a_vague_prior_makes_no_false_certainty(flights: int) -> None:
    """Median of the flights; without new alignments it is 3 to 6."""
    rng = np.random.default_rng(4)
    assert np.median([end_nees(rng, 400.0) for _ in range(flights)]) < 1.5


def test_it_goes_on_where_the_smoother_ended() -> None:
    flown = flight(np.random.default_rng(3), 20)
    found = align(flown.path, flown.logs, flown.prior)
    state = resumed(found, 60.0)
    free = flown.prior.free
    np.testing.assert_array_equal(
        state.theta_covariance[np.ix_(free, free)], found.covariance[np.ix_(free, free)]
    )
    assert np.linalg.eigvalsh(state.covariance).min() > 0
