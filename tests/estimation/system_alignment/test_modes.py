"""Several places where a beacon may as well lie: the covariance knows of all of them."""

from __future__ import annotations

import numpy as np
import pytest

from bench.navigation.circling import aligned, flight
from bench.navigation.geometries import CASES, drawn, normalised
from estimation.arrays import Array
from estimation.system_alignment import (
    Alignment,
    DeadReckoning,
    Prior,
    Ranges,
    align,
    dead_reckoning,
    filtered,
    prior,
    ranges,
)


def ranged(believed_m: Array) -> tuple[DeadReckoning, Ranges, Prior]:
    """Ranges along a straight track east to one beacon 300 m north of it, known to 400 m."""
    rng = np.random.default_rng(2)
    path = dead_reckoning(np.ones(40), 20.0, np.pi / 2, 0.1, 0.001)
    beacon = np.array([400.0, 300.0])
    exact = np.hypot(*(path.path_m - beacon).T)
    known = prior([[*believed_m, 0.0]], [400.0, 400.0, 0.0])
    return path, ranges(np.arange(40), 0, exact + 2.0 * rng.standard_normal(40), 2.0), known


def beside_the_track(believed_m: Array) -> Alignment:
    return align(*ranged(believed_m))


def test_a_beacon_may_lie_on_the_other_side_of_a_straight_track() -> None:
    """Believed on the track itself, both sides are as probable: half of (600 m)^2 is the doubt."""
    found = beside_the_track(np.array([400.0, 1.0]))
    north = found.beacons_m[0, 1]
    assert abs(abs(north) - 300.0) < 5.0
    mates = [mode.beacons_m for mode in found.others]
    assert len(mates) == 1
    assert abs(mates[0][0, 1] + north) < 10.0
    y = 8
    side = ("left", "right") if north < 0 else ("right", "left")
    assert found.status == "ambiguous"
    assert found.doubts[0].startswith(f"beacon 1 on the {side[0]} of the track instead of the")
    assert found.others[0].probability == pytest.approx(0.5, abs=0.05)
    assert np.sqrt(found.covariance[y, y]) == pytest.approx(600 / np.sqrt(2), rel=0.05)


def test_modes_share_by_their_probability() -> None:
    """Believed 800 m north: the other side is (1100 / 400)^2 - (500 / 400)^2 = 6 of chi2 worse."""
    found = beside_the_track(np.array([400.0, 800.0]))
    assert found.beacons_m[0, 1] == pytest.approx(300.0, abs=5.0)
    share = 1 / (1 + np.exp(3.0))
    assert found.others[0].probability == pytest.approx(share, rel=0.1)
    assert np.sqrt(found.covariance[8, 8]) == pytest.approx(600 * np.sqrt(share), rel=0.1)


def test_the_filter_carries_the_doubt() -> None:
    """At epoch 40 other modes were last looked for at epoch 27: either side is still as likely."""
    *_, last = filtered(*ranged(np.array([400.0, 1.0])))
    assert last.ambiguous
    sigma = np.sqrt(last.theta_covariance[8, 8])
    assert sigma == pytest.approx(600 / np.sqrt(2), rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("track", ["straight, 3 of 300 m", "hover, 2 of 50 m"])
def test_ridges_that_bend_each_other_are_honest(track: str) -> None:
    """NEES by dimension of 8 flights: by arcs walked one by one it is 6 and more."""
    case = next(c for c in CASES if str(c) == track)
    flown = [drawn(np.random.default_rng([5, i]), case) for i in range(8)]
    assert np.mean([normalised(f, aligned(f)) for f in flown]) < 1.5


def test_a_prior_that_leaves_no_side_open_is_not_searched() -> None:
    found = aligned(flight(np.random.default_rng(1), 60))
    assert found.others == ()
    assert found.status == "solved"
