"""System alignment where the paper has not been: random tracks, beacons, priors.

Flights of 60 to 300 epochs, intervals 1 to 5 s, 5 to 60 m/s, range noise 1 to 10 m, wind 1 m/s an
axis, beacons 50 to 800 m high within .6 of the way flown.

Run `python -m bench.navigation.geometries [--seed N] [--runs N] [--json]`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_most, options, report, told
from bench.navigation.circling import DEG, Flight, Truth, aligned, truth_of
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import east_north_from_polar
from estimation.system_alignment import (
    Alignment,
    Filtered,
    dead_reckoning,
    filtered,
    prior,
    ranges,
)

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


CASES = (
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


def normalised(flown: Flight, found: Alignment | Filtered) -> float:
    """NEES by dimension."""
    free, covariance = flown.prior.free, _covariance(found)
    error = (found.theta - truth_of(flown))[free]
    return float(nees(error, covariance[np.ix_(free, free)])) / len(free)


def _covariance(found: Alignment | Filtered) -> Array:
    """(7 + 4 J, 7 + 4 J) of all constants."""
    return found.covariance if isinstance(found, Alignment) else found.theta_covariance


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """A few flights of every kind; `python -m bench.navigation.geometries` flies more."""
    yield from measured(seed, max(runs // 50, 3))


def measured(seed: int, runs: int) -> Iterator[Figure]:
    """NEES by dimension of the smoother; of every third flight that of the online filter."""
    for number, case in enumerate(CASES):
        flown = [drawn(np.random.default_rng([seed, 50, number, i]), case) for i in range(runs)]
        found = [aligned(flight) for flight in flown]
        whole = [normalised(f, a) for f, a in zip(flown, found, strict=True)]
        tangents = [_tangents(f, a) for f, a in zip(flown, found, strict=True)]
        ends = [_end(flight) for flight in flown[::3]]
        online = [normalised(f, e) for f, e in zip(flown[::3], ends, strict=True)]
        yield at_most(f"{case}: NEES by dimension, mean", float(np.mean(whole)), 1.3)
        yield told(f"{case}: NEES by dimension, median", float(np.median(whole)))
        ambiguous = [a.status == "ambiguous" for a in found]
        yield told(f"{case}: called ambiguous", 100 * float(np.mean(ambiguous)), "%")
        yield told(f"{case}: NEES by tangents, median", float(np.median(tangents)))
        yield told(f"{case}: NEES online, mean", float(np.mean(online)))
        yield told(f"{case}: NEES online, median", float(np.median(online)))


def _tangents(flown: Flight, found: Alignment) -> float:
    """By the curvature at the mode alone."""
    error = (found.theta - truth_of(flown))[flown.prior.free]
    return float(nees(error, found.solution.covariance)) / len(error)


def _end(flown: Flight) -> Filtered:
    """The filter after the last epoch."""
    *_, last = filtered(flown.path, flown.logs, flown.prior)
    return last


def main() -> None:
    """Measure, print."""
    given = options("System alignment on random tracks (flights of every kind).", runs=30)
    report(measured(given.seed, given.runs), given)


if __name__ == "__main__":
    main()
