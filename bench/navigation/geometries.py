"""System alignment where the paper has not been: random tracks, beacons, priors.

Flights of 60 to 300 epochs, intervals 1 to 5 s, 5 to 60 m/s, range noise 1 to 10 m, wind 1 m/s an
axis, beacons 50 to 800 m high within .6 of the way flown. Nothing is demanded of these figures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, told
from bench.navigation.circling import DEG, Flight, Truth, truth_of
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import east_north_from_polar
from estimation.system_alignment import align, dead_reckoning, filtered, prior, ranges

_SIGMA_HEADING_RAD, _SIGMA_SPEED = 0.5 * DEG, 0.03  # of the speed


def _circle(turns: Array) -> Array:
    return 2 * np.pi * turns


def _turn(way: Array) -> Array:
    return np.where(way < 0.5, 0.0, 1.2)


def _back(way: Array) -> Array:
    return np.where(way < 0.5, 0.0, np.pi)


_TRACKS: dict[str, Callable[[Array], Array]] = {
    "straight": np.zeros_like,
    "hover": np.zeros_like,
    "turn half-way": _turn,
    "out and back": _back,
    "circle": _circle,
}


class _Case(NamedTuple):
    """A kind of flight: track, beacons, prior sigma of these."""

    track: str
    beacons: int
    sigma_m: float

    def __str__(self) -> str:
        return f"{self.track}, {self.beacons} of {self.sigma_m:g} m"


_CASES = (
    _Case("straight", 1, 100.0),
    _Case("straight", 2, 50.0),
    _Case("straight", 3, 300.0),
    _Case("hover", 2, 50.0),
    _Case("turn half-way", 2, 50.0),
    _Case("turn half-way", 3, 300.0),
    _Case("out and back", 3, 300.0),
    _Case("circle", 3, 300.0),
)


def drawn(rng: np.random.Generator, case: _Case) -> Flight:
    """A flight of a kind, everything else drawn."""
    epochs, interval = int(rng.choice([60, 150, 300])), float(rng.choice([1.0, 3.0, 5.0]))
    speed = 0.0 if case.track == "hover" else float(rng.choice([5.0, 15.0, 30.0, 60.0]))
    way = (np.arange(epochs) + 0.5) / epochs
    heading = rng.uniform(0, 2 * np.pi) + rng.choice([-1, 1]) * _TRACKS[case.track](way)
    travel = interval * east_north_from_polar(heading, np.full(epochs, speed))
    near = rng.uniform(0.15, 0.6) * max(speed * interval * epochs, 300.0)
    beacons = np.column_stack(
        [near * rng.uniform(-1, 1, (case.beacons, 2)), rng.uniform(50, 800, case.beacons)]
    )
    beacons[:, :2] += np.cumsum(travel, axis=0)[epochs // 2]
    wind = rng.standard_normal(2)
    places = np.cumsum(travel + interval * wind, axis=0)
    sigma_speed = _SIGMA_SPEED * max(speed, 5.0)
    path = dead_reckoning(
        interval,
        speed + sigma_speed * rng.standard_normal(epochs),
        heading + _SIGMA_HEADING_RAD * rng.standard_normal(epochs),
        sigma_speed,
        _SIGMA_HEADING_RAD,
    )
    believed = beacons + case.sigma_m * rng.standard_normal(beacons.shape)
    known = prior(believed, case.sigma_m, sigma_wind_mps=1.0)
    sigma = float(rng.choice([1.0, 4.0, 10.0]))
    level = places[:, None] - beacons[:, :2]
    exact = np.sqrt(np.sum(level**2, axis=2) + beacons[:, 2] ** 2)
    value = exact + sigma * rng.standard_normal(exact.shape)
    columns = np.arange(epochs).repeat(case.beacons), np.tile(np.arange(case.beacons), epochs)
    truth = Truth(beacons, wind, np.zeros(case.beacons), places)
    return Flight(path, ranges(*columns, value.ravel(), sigma), known, truth)


def _nees(flown: Flight, theta: Array, covariance: Array) -> float:
    """By dimension."""
    free = flown.prior.free
    error = (theta - truth_of(flown))[free]
    return float(nees(error, covariance[np.ix_(free, free)])) / len(free)


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """NEES by dimension: of the smoother, of the same by its tangents, of the online filter."""
    for number, case in enumerate(_CASES):
        rng = np.random.default_rng([seed, 50, number])
        whole, tangents, online = [], [], []
        for _ in range(max(runs // 20, 4)):
            flown = drawn(rng, case)
            found = align(flown.path, flown.logs, flown.prior)
            whole.append(_nees(flown, found.theta, found.covariance))
            error = (found.theta - truth_of(flown))[flown.prior.free]
            tangents.append(float(nees(error, found.solution.covariance)) / len(error))
            *_, last = filtered(flown.path, flown.logs, flown.prior)
            online.append(_nees(flown, last.theta, last.theta_covariance))
        yield told(f"{case}: NEES by dimension, mean", float(np.mean(whole)))
        yield told(f"{case}: NEES by dimension, median", float(np.median(whole)))
        yield told(f"{case}: the same by tangents, mean", float(np.mean(tangents)))
        yield told(f"{case}: the same of the filter online, median", float(np.median(online)))
