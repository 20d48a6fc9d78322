"""Nameless bearings: told apart by their carrier, and paired between two."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.bearings_only.scenes import MINUTE, Own, heading, own_track
from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_ACCELERATION,
    CONSTANT_VELOCITY,
    Bearings,
    FramePrior,
    bearings,
    followed,
    log_odds_of_one,
    no_tracks,
    spline,
)
from estimation.bearings_only.measurements import ComplexArray
from estimation.frames import wrap_pi

T_S: Array = 15.0 * np.arange(1.0, 25.0)
SIGMA = 10 / 3 * MINUTE
TURNING = own_track(Own(10, (90, 280, 95), (150, 300)), T_S)
STEADY = 5200 - 900j + 4 * heading(20) * T_S
TARGETS = (
    3000j + 6 * heading(200) * T_S,
    -1500 + 4200j + 5 * heading(160) * T_S,
    3600 + 3900j + 6 * heading(230) * T_S,
    1200 + 5200j + 6 * heading(175) * T_S,
    -4800 + 2600j + 5 * heading(80) * T_S,
)


def looked(
    rng: np.random.Generator, own: ComplexArray, targets: Sequence[ComplexArray]
) -> Bearings:
    """All of them, by the row."""
    apart = np.array(targets) - own
    noisy = np.arctan2(apart.real, apart.imag) + rng.normal(size=apart.shape) * SIGMA
    return bearings(T_S, np.stack([own.real, own.imag], axis=-1), noisy, SIGMA)


def told_apart(given: Bearings, order: NDArray[np.int64], turn_rad: float = 0.0) -> Array:
    """The number that each bearing gets (targets, looks), the rows of each look in some order."""
    tracks, before = no_tracks(), given.observer_m[0]
    found = np.empty(given.bearing_rad.shape)
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    for look, here in enumerate(given.observer_m):
        bearing = wrap_pi(given.bearing_rad[order, look] + turn_rad)
        sigma = np.full(len(bearing), SIGMA)
        moved = turn @ (here - before)
        tracks, found[order, look] = followed(tracks, 15.0 * (look > 0), moved, bearing, sigma)
        before = here
    return found


@pytest.mark.parametrize("seed", range(5))
def test_no_number_is_of_two_targets_though_the_carrier_turns(seed: int) -> None:
    """Two of them meet just as it turns: there they are open, and begin anew."""
    found = told_apart(looked(np.random.default_rng(seed), TURNING, TARGETS), np.arange(5))
    owners = [np.flatnonzero((found == number).any(axis=1)) for number in np.unique(found)[1:]]
    assert all(len(rows) == 1 for rows in owners)
    assert (found[2:] == found[2:, :1]).all()
    assert (found == -1).mean() < 0.1
    assert len(owners) <= 7


def test_numbers_depend_neither_on_rows_nor_on_north() -> None:
    """As sets: which targets are one; the numbers themselves are given row by row."""
    given = looked(np.random.default_rng(2), TURNING, TARGETS)
    straight = told_apart(given, np.arange(5))
    for order, turn in ((np.array([3, 1, 4, 0, 2]), 0.0), (np.arange(5), 2.0)):
        other = told_apart(given, order, turn)
        for look in range(len(T_S)):
            same = straight[:, look, None] == straight[None, :, 0]
            assert (same == (other[:, look, None] == other[None, :, 0])).all()


def test_where_two_meet_neither_is_taken_for_the_other() -> None:
    """Two targets on one bearing for some looks: open there, each itself again behind it."""
    meeting = (
        -900 + 6000j + 5 * heading(90) * T_S + TURNING * 0,
        900 + 6000j + 5 * heading(270) * T_S + TURNING * 0,
    )
    found = told_apart(looked(np.random.default_rng(3), 0 * TURNING, meeting), np.arange(2))
    first, last = found[:, 3], found[:, -1]
    assert (found == -1).any()
    assert first[0] != first[1]
    assert last[0] != first[1]
    assert last[1] != first[0]


def test_what_is_silent_for_long_is_another() -> None:
    tracks, one = followed(no_tracks(), 0.0, np.zeros(2), np.array([1.0]), np.array([SIGMA]))
    for _ in range(20):
        tracks, _ = followed(tracks, 15.0, np.zeros(2), np.zeros(0), np.zeros(0))
    assert not len(tracks.number)
    tracks, other = followed(tracks, 15.0, np.zeros(2), np.array([1.0]), np.array([SIGMA]))
    assert other[0] > one[0]


MOTIONS = (CONSTANT_VELOCITY, CONSTANT_ACCELERATION, spline(4))
PRIOR = FramePrior(np.radians(1), 70)


def odds(own: Bearings, other: Bearings) -> Array:
    """Of all pairs, (own, other)."""
    n, m = len(own.bearing_rad), len(other.bearing_rad)
    i, j = np.divmod(np.arange(n * m), m)
    return log_odds_of_one(own, other, PRIOR, MOTIONS, (i, j)).reshape(n, m)


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_one_target_is_far_likelier_than_two(seed: int) -> None:
    """Though the other carrier is turned by .8 deg, and each sees one that the other does not."""
    rng = np.random.default_rng(seed)
    own = looked(rng, TURNING, TARGETS[:4])
    other = looked(rng, STEADY, TARGETS[1:])
    other = other._replace(bearing_rad=other.bearing_rad + np.radians(0.8))
    found = odds(own, other)
    is_one = np.eye(4, k=-1, dtype=bool)
    assert found[is_one].min() > -3
    assert found[~is_one].max() < -8


def test_odds_do_not_depend_on_who_else_is_asked_of() -> None:
    rng = np.random.default_rng(7)
    own, other = looked(rng, TURNING, TARGETS), looked(rng, STEADY, TARGETS)
    all_of_them = odds(own, other)
    alone = odds(
        own._replace(bearing_rad=own.bearing_rad[[2]]),
        other._replace(bearing_rad=other.bearing_rad[[4]]),
    )
    assert alone[0, 0] == pytest.approx(all_of_them[2, 4], rel=1e-6)
