"""A frame found while range errors passed for noise, and what it is said to hang on."""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array
from estimation.consistency import mean_interval, nees
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.relative_frame import OwnAxesFrame, PolarLogs, RelativeFramePrior, adjustment
from estimation.relative_frame.joint import own_alone
from estimation.relative_frame.range_errors import RangeErrors, Seen, along, considered, declared

DEG = np.pi / 180
SIGMAS = np.array([60.0, 4e-3])
NOISE = 20.0**2 * np.eye(2)
OFFSET, TURN = np.array([9e3, -4e3]), 0.6 * DEG
RUNS, TARGETS = 80, 8


def truth_less_added(places_m: Array, ranges: Array) -> Array:
    """What is measured of places to which (b, s) must be added."""
    far = np.hypot(*places_m.T)[:, None]
    return np.asarray(places_m / far * (far - ranges[0]) / (1 + ranges[1]))


def found(rng: np.random.Generator) -> tuple[Array, OwnAxesFrame, Array]:
    """Errors (7,) of (q, D) and of (b, s) of both carriers, the frame, and its derivative."""
    errors = [declared(*SIGMAS), declared(*SIGMAS)]
    drawn = rng.normal(size=(2, 2)) * SIGMAS
    place = rng.uniform(-15e3, 15e3, (TARGETS, 2))
    seen = [place, (place - OFFSET) @ rotation_clockwise(-TURN).T]
    sides = []
    for true_m, ranges, known in zip(seen, drawn, errors, strict=True):
        measured = truth_less_added(true_m, ranges) + 20.0 * rng.normal(size=true_m.shape)
        sides.append(Seen(measured, NOISE + known.spread(measured), known))
    frame, by_ranges = considered(solved(*sides, OFFSET + 300.0 * rng.normal(size=2)), *sides)
    off = np.array([*(frame.q_m - OFFSET), wrap_pi(frame.D_rad - TURN)])
    return np.concatenate([off, -drawn.ravel()]), frame, by_ranges


def solved(own: Seen, other: Seen, reported_m: Array) -> OwnAxesFrame:
    """The frame for which range errors are noise of each place."""
    logs = (PolarLogs.from_east_north(side.places_m, side.covariance) for side in (own, other))
    prior = RelativeFramePrior.from_sigmas(reported_m, 3000, 3000, 3 * DEG, 3 * DEG)
    return adjustment(*logs, prior).own_axes


def whole(frame: OwnAxesFrame, by_ranges: Array) -> Array:
    """(7, 7) covariance of all of it."""
    by = np.block([[np.eye(3), by_ranges], [np.zeros((4, 3)), np.eye(4)]])
    apart = np.zeros((7, 7))
    apart[:3, :3], apart[3:, 3:] = frame.covariance, np.diag(np.tile(SIGMAS, 2) ** 2)
    return np.asarray(by @ apart @ by.T)


def test_what_a_frame_hangs_on_is_told() -> None:
    """NEES of the frame alone, of what range errors leave, and of all seven; at 99.9 %."""
    scores = []
    for run in range(RUNS):
        error, frame, by_ranges = found(np.random.default_rng([3, run]))
        covariance = whole(frame, by_ranges)
        left = error[:3] - by_ranges @ error[3:]
        scores.append(
            [
                float(nees(error[:3], covariance[:3, :3])) / 3,
                float(nees(left, frame.covariance)) / 3,
                float(nees(error, covariance)) / 7,
            ]
        )
    for mean, dof in zip(np.mean(scores, axis=0), (3, 3, 7), strict=True):
        low, high = mean_interval(dof, RUNS, 0.999)
        assert low < mean < high


def test_a_frame_moves_with_what_is_added_to_ranges() -> None:
    """To a hundredth of the largest: places move a little off the line of sight of the noise."""
    rng = np.random.default_rng(7)
    place = rng.uniform(-15e3, 15e3, (TARGETS, 2))
    known = declared(*SIGMAS)
    sides = [
        Seen(places, NOISE + known.spread(places), known)
        for places in (place, (place - OFFSET) @ rotation_clockwise(-TURN).T)
    ]
    frame, by_ranges = considered(solved(*sides, OFFSET), *sides)
    small = np.array([1.0, 1e-4])
    moved = []
    for side, number in np.ndindex(2, 2):
        added = along(sides[side].places_m)[..., number] * small[number]
        anew = list(sides)
        anew[side] = sides[side]._replace(places_m=sides[side].places_m + added)
        there = solved(*anew, OFFSET)
        moved.append([*(there.q_m - frame.q_m), wrap_pi(there.D_rad - frame.D_rad)])
    told = by_ranges * np.tile(small, 2)
    scale = np.abs(told).max(axis=1, keepdims=True)
    np.testing.assert_allclose(np.transpose(moved) / scale, told / scale, atol=0.01)


def test_a_joint_state_that_is_joined_has_these_covariances() -> None:
    _, frame, by_ranges = found(np.random.default_rng(5))
    joint = own_alone(0.0, *SIGMAS).joined_through(0, frame, 0.0, *SIGMAS, by_ranges)
    which = [7, 8, 9, 5, 6, 12, 13]
    np.testing.assert_allclose(joint.covariance[np.ix_(which, which)], whole(frame, by_ranges))


def test_range_errors_lie_along_the_line_of_sight() -> None:
    places = np.array([[3e3, 4e3], [0.0, -2e3]])
    known = RangeErrors(np.array([10.0, 0.01]), np.diag([4.0, 1e-6]))
    np.testing.assert_allclose(known.added(places), [[36.0, 48.0], [0.0, -30.0]])
    np.testing.assert_allclose(np.trace(known.spread(places), axis1=1, axis2=2), [29.0, 8.0])
    assert np.isfinite(along(np.zeros((1, 2)))).all()
