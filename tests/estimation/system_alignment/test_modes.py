"""Several places where a beacon may as well lie: the covariance knows of all of them."""

from __future__ import annotations

import numpy as np
import pytest

from bench.navigation.circling import aligned, flight
from estimation.arrays import Array
from estimation.system_alignment import Alignment, align, dead_reckoning, prior, ranges


def beside_the_track(believed_m: Array) -> Alignment:
    """Ranges along a straight track east to one beacon 300 m north of it, known to 400 m."""
    rng = np.random.default_rng(2)
    path = dead_reckoning(np.ones(40), 20.0, np.pi / 2, 0.1, 0.001)
    beacon = np.array([400.0, 300.0])
    exact = np.hypot(*(path.path_m - beacon).T)
    known = prior([[*believed_m, 0.0]], [400.0, 400.0, 0.0])
    return align(path, ranges(np.arange(40), 0, exact + 2.0 * rng.standard_normal(40), 2.0), known)


def test_a_beacon_may_lie_on_the_other_side_of_a_straight_track() -> None:
    """Believed on the track itself, both sides are as probable: half of (600 m)^2 is the doubt."""
    found = beside_the_track(np.array([400.0, 1.0]))
    north = found.beacons_m[0, 1]
    assert abs(abs(north) - 300.0) < 5.0
    mates = [mode.beacons_m for mode in found.others]
    assert len(mates) == 1
    assert abs(mates[0][0, 1] + north) < 10.0
    y = 8
    assert np.sqrt(found.covariance[y, y]) == pytest.approx(600 / np.sqrt(2), rel=0.05)


def test_modes_share_by_their_probability() -> None:
    """Believed 800 m north: the other side is (1100 / 400)^2 - (500 / 400)^2 = 6 of chi2 worse."""
    found = beside_the_track(np.array([400.0, 800.0]))
    assert found.beacons_m[0, 1] == pytest.approx(300.0, abs=5.0)
    share = 1 / (1 + np.exp(3.0))
    assert found.others[0].probability == pytest.approx(share, rel=0.1)
    assert np.sqrt(found.covariance[8, 8]) == pytest.approx(600 * np.sqrt(share), rel=0.1)


def test_a_prior_that_leaves_no_side_open_is_not_searched() -> None:
    assert aligned(flight(np.random.default_rng(1), 60)).others == ()
