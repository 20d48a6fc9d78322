"""Which course the own carrier should take next so that the range is determined best."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike
from estimation.bearings_only.bound import cramer_rao
from estimation.bearings_only.measurements import Bearings
from estimation.bearings_only.motions import CONSTANT_VELOCITY
from estimation.bearings_only.solution import Solution, VelocityFamily

_RANGES_M = (1500.0, 4000.0, 10_000.0)
_COURSES = 24


class Turn(NamedTuple):
    """The best next course, and what every course would bring.

    Attributes:
        course_rad: the best, clockwise from north.
        relative_sigma: (K,) bound of sd(range) / range at the end, on each of the courses: the
            geometric mean over the ranges that are possible.
        courses_rad: (K,).
    """

    course_rad: float
    relative_sigma: Array
    courses_rad: Array


def best_turn(
    given: Bearings,
    found: Solution,
    speed_mps: float,
    duration_s: float,
    ranges_m: ArrayLike | None = None,
) -> Turn | None:
    """The course to take at once, speed kept, for the best range after some time.

    A target of constant velocity is assumed at each of the possible ranges, with the velocity
    that goes with it; the bound of past and future bearings together is what counts.

    Args:
        given: the bearings so far, of one target.
        found: their solution.
        speed_mps: of the own carrier after the turn.
        duration_s: how long bearings go on, at the mean period and sigma of those so far.
        ranges_m: to be prepared for; default: the solution's interval, or 1.5 to 10 km.

    Returns:
        None when there are no bearings to go by.
    """
    if found.velocities is None or found.line is None or len(given.t_s) < 2:
        return None
    ranges = np.atleast_1d(np.asarray(_possible(found) if ranges_m is None else ranges_m, float))
    bearing = float(found.line.bearing_rad)
    toward = np.array([np.sin(bearing), np.cos(bearing)])
    courses = 2 * np.pi * np.arange(_COURSES) / _COURSES
    with np.errstate(all="ignore"):
        each = [
            _bound(plan, found.last_s, toward, found.velocities, ranges)
            for plan in (_planned(given, course, speed_mps, duration_s) for course in courses)
        ]
    expected = np.exp(np.mean(np.log(each), axis=1))
    return Turn(float(courses[np.argmin(expected)]), expected, courses)


def _possible(found: Solution) -> Array:
    low, high = found.interval
    if low > 0 and np.isfinite(high):
        return np.array([low, np.sqrt(low * high), high])
    return np.array(_RANGES_M)


def _planned(given: Bearings, course: float, speed: float, duration: float) -> Bearings:
    """The bearings so far and those on a new course."""
    seen = np.isfinite(given.bearing_rad)
    span = float(given.t_s[-1] - given.t_s[0])
    period = max(span / (len(given.t_s) - 1), duration / 200, 1e-3)
    later = period * np.arange(1, int(duration / period) + 1)
    way = speed * later[:, None] * np.array([np.sin(course), np.cos(course)])
    sigma = float(np.median(given.sigma_rad[seen])) if seen.any() else 1.0
    return Bearings(
        np.concatenate([given.t_s, given.t_s[-1] + later]),
        np.concatenate([given.observer_m, given.observer_m[-1] + way]),
        np.concatenate([given.bearing_rad, np.zeros(len(later))]),
        np.concatenate([given.sigma_rad, np.full(len(later), sigma)]),
    )


def _bound(
    plan: Bearings, now_s: float, toward: Array, family: VelocityFamily, ranges: Array
) -> Array:
    """sd(range) / range at the end of a plan, for every range at the last bearing so far."""
    now = int(np.searchsorted(plan.t_s, now_s, side="right")) - 1
    middle = (plan.t_s[0] + plan.t_s[-1]) / 2
    velocity = family.own_mps + ranges[:, None] * family.by_range
    place = plan.observer_m[now] + ranges[:, None] * toward + velocity * (middle - now_s)
    coefficients = np.stack([place @ [1, 1j], velocity @ [1, 1j]])
    bound = cramer_rao(plan, CONSTANT_VELOCITY, coefficients).inverse_range()
    relative: Array = np.minimum(np.nan_to_num(bound.sigma / np.abs(bound.value), nan=1e3), 1e3)
    return relative
