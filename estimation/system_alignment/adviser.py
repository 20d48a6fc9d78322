"""Which way to go next, so that the beacons come out best: legs ranked by predicted bound."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike, Indices
from estimation.system_alignment.logs import DeadReckoning, Ranges, dead_reckoning, ranges
from estimation.system_alignment.losses import squares
from estimation.system_alignment.model import predicted_ranges
from estimation.system_alignment.online import Filtered, predicted, updated
from estimation.system_alignment.parameters import places_of


class Leg(NamedTuple):
    """A way to go on.

    Attributes:
        name: for the report.
        path: its steps; the start is where the object is.
    """

    name: str
    path: DeadReckoning


class Advice(NamedTuple):
    """A leg and what it would leave.

    Attributes:
        leg: as given.
        bound: the figure of merit at its end, by default the beacons' sigma [m].
        after: the filter at its end, its covariance the predicted bound.
    """

    leg: Leg
    bound: float
    after: Filtered


Merit = Callable[[Filtered], float]


def beacon_sigma_m(state: Filtered) -> float:
    """Root mean square sigma [m] of the beacons' coordinates."""
    where = places_of(state.theta)
    return float(np.sqrt(np.diag(state.theta_covariance)[where].mean()))


def advise(
    now: Filtered, legs: Sequence[Leg], sigma_range_m: float, merit: Merit = beacon_sigma_m
) -> list[Advice]:
    """The legs, best first.

    Args:
        now: what is known (`resumed` makes it of an alignment).
        legs: to choose from.
        sigma_range_m: of the ranges, one to each beacon at each epoch.
        merit: what is to become small.
    """
    ends = [(leg, _flown(now, leg.path, sigma_range_m)) for leg in legs]
    told = [Advice(leg, merit(after), after) for leg, after in ends]
    return sorted(told, key=lambda advice: advice.bound)


def straight_legs(
    headings_rad: ArrayLike,
    speed_mps: float,
    duration_s: float,
    interval_s: float,
    sigma_speed_mps: float,
    sigma_heading_rad: float,
) -> list[Leg]:
    """A straight leg for each heading, named by it in degrees."""
    steps = max(round(duration_s / interval_s), 1)
    return [
        Leg(
            f"{round(np.degrees(heading)) % 360:03d} deg",
            dead_reckoning(
                np.full(steps, interval_s), speed_mps, heading, sigma_speed_mps, sigma_heading_rad
            ),
        )
        for heading in np.atleast_1d(np.asarray(headings_rad, dtype=float))
    ]


def _flown(state: Filtered, path: DeadReckoning, sigma_m: float) -> Filtered:
    """The filter along a leg with every range as it expects it: only the covariance learns."""
    beacons = np.arange(len(places_of(state.theta)))
    for epoch in range(len(path.interval_s)):
        state = predicted(state, path, epoch)
        height = float(path.height_m[epoch])
        logs = ranges(epoch, beacons, _expected(state, beacons, height), sigma_m)
        state = updated(state, logs, height, squares)
    return state


def _expected(state: Filtered, beacons: Indices, height_m: float) -> Array:
    """Ranges (J,) as predicted."""
    places = np.tile([*state.place[:2], height_m], (len(beacons), 1))
    blank: Ranges = ranges(0, beacons, 0.0, 1.0)
    return predicted_ranges(state.theta, blank, places, np.full(len(beacons), state.time_s))[0]
