"""Ridges that bend: the covariance knows the arc, not only its tangent."""

from __future__ import annotations

import numpy as np
import pytest

from bench.navigation.circling import aligned, flight
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.system_alignment import Alignment, Prior, align, dead_reckoning, prior, ranges

RANGE_M, SIGMA_RANGE_M, SIGMA_BEACON_M = 400.0, 2.0, 150.0


def hovering() -> tuple[Alignment, Prior]:
    """Twenty ranges to one beacon from one place: a ring, of which the prior leaves an arc."""
    path = dead_reckoning(np.ones(20), 0.0, 0.0, 1e-3, 1e-3)
    known = prior([[0.0, 450.0, 0.0]], [SIGMA_BEACON_M, SIGMA_BEACON_M, 0.0])
    logs = ranges(np.arange(20), 0, RANGE_M, SIGMA_RANGE_M)
    return align(path, logs, known), known


def ring() -> Array:
    """(2, 2) mean square distance from the mode by quadrature over angle and distance."""
    angle = np.linspace(-np.pi, np.pi, 2001)[:-1, None]
    sigma = SIGMA_RANGE_M / np.sqrt(20)
    far = RANGE_M + sigma * np.linspace(-6, 6, 121)
    east, north = far * np.sin(angle), far * np.cos(angle)
    chi2 = (east**2 + (north - 450.0) ** 2) / SIGMA_BEACON_M**2 + ((far - RANGE_M) / sigma) ** 2
    share = far * np.exp(-chi2 / 2)
    share /= share.sum()
    best = np.unravel_index(np.argmin(chi2), chi2.shape)
    away = np.stack([east - east[best], north - north[best]])
    found: Array = np.einsum("ijk,ljk,jk->il", away, away, share)
    return found


def test_an_arc_is_as_wide_as_it_is() -> None:
    """The walk ends at chi2 9 and strides by .75 sigma: 8 %.

    The tangent is right along the arc, and knows half a metre across it instead of 45.
    """
    found, known = hovering()
    which = np.ix_(known.free, known.free)
    exact = ring()
    np.testing.assert_allclose(
        np.sqrt(np.diag(found.covariance[which])), np.sqrt(np.diag(exact)), rtol=0.08
    )
    assert found.solution.covariance[1, 1] < exact[1, 1] / 1000


def test_nothing_changes_where_nothing_bends() -> None:
    """Four hundred ranges of benchmark G: the parabola is the cost, and its covariance stays."""
    found = aligned(flight(np.random.default_rng(1), 400))
    free = found.prior.free
    np.testing.assert_array_equal(found.covariance[np.ix_(free, free)], found.solution.covariance)


def straight(rng: np.random.Generator) -> float:
    """NEES by dimension of a straight flight past two beacons."""
    heading, speed, wind = 0.3, 20.0, rng.standard_normal(2)
    beacons = np.array([[900.0, 500.0, 200.0], [-300.0, 1500.0, 350.0]])
    known = prior(beacons + 80.0 * rng.standard_normal((2, 3)), 80.0, sigma_wind_mps=1.0)
    way = 20.0 * np.array([np.sin(heading), np.cos(heading)]) + wind
    places = np.cumsum(np.tile(2.0 * way, (60, 1)), axis=0)
    path = dead_reckoning(
        np.full(60, 2.0),
        speed + 0.5 * rng.standard_normal(60),
        heading + 0.005 * rng.standard_normal(60),
        0.5,
        0.005,
    )
    apart = np.concatenate([places[:, None] - beacons[:, :2], np.zeros((60, 2, 1))], axis=2)
    apart[..., 2] = beacons[:, 2]
    exact = np.linalg.norm(apart, axis=2) + 3.0 * rng.standard_normal((60, 2))
    epoch, beacon = np.arange(60).repeat(2), np.tile([0, 1], 60)
    found = align(path, ranges(epoch, beacon, exact.ravel(), 3.0), known)
    free = known.free
    error = (found.theta - np.concatenate([wind, np.zeros(5), beacons.ravel(), np.zeros(2)]))[free]
    return float(nees(error, found.covariance[np.ix_(free, free)])) / len(free)


@pytest.mark.parametrize("flights", [2, pytest.param(15, marks=pytest.mark.slow)])
def test_a_straight_flight_is_honest(flights: int) -> None:
    """The mean of NEES by 8; the tangents alone have 30.

    Ridges that bend each other are sampled by half their contrast (`ridges`), which widens: about
    .4 is what such flights have, and what the lower limit is for.
    """
    rng = np.random.default_rng(5)
    assert 0.3 < np.mean([straight(rng) for _ in range(flights)]) < 2.5
