"""The least error that the picture of a fleet can have: all plots of all targets, the truth known.

The posterior bound by recursion, linear at the truth, along the axes of the picture: frames (q, D),
the drifts of their reckoning and all range errors beside all targets, by the priors that carriers
declare. Whose each plot is counts as known, and for each target how it moves.

Known frames are the same estimate where the truth has no errors. It does not know that: what the
data leave open is right all the same, since what is declared is right beforehand.

Source: Tichavsky, Muravchik & Nehorai, IEEE Trans. Signal Processing 46(5), 1998.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import radians
from typing import Any, NamedTuple

import numpy as np

from estimation.arrays import Array
from sim_world.scenario import Scenario
from sim_world.world import World

FRAME, RANGES, TARGET = 5, 2, 4
"""Numbers of an other carrier's frame (q, D, drift), of ranges (b, s), of a target."""
STRAIGHT_M2PS3, TURNING_RAD2PS, WANDERING_M2PS = 0.01, 0.005, 0.0025
ANYWHERE_M, ANY_SPEED_MPS = 1e5, 25.0
SHOWN_M = 500.0
"""Targets known worse are not in a picture."""
QUARTER = np.array([[0.0, 1.0], [-1.0, 0.0]])  # clockwise


class Bound(NamedTuple):
    """Root mean square errors of places, over the targets seen and the second half of a run.

    Attributes:
        error_m: with errors as they are declared; known_m: with none.
    """

    error_m: float
    known_m: float


class _Course(NamedTuple):
    """The truth: places and velocities of carriers (steps, N, 2) and of targets (steps, T, 2)."""

    seconds: Array
    carriers: Array
    carrier_rates: Array
    targets: Array
    target_rates: Array

    def at(self, t: float) -> tuple[Array, Array]:
        """Places of carriers and targets at an instant."""
        k = min(int(np.searchsorted(self.seconds, t)), len(self.seconds) - 1)
        passed = t - self.seconds[k]
        here = self.carriers[k] + passed * self.carrier_rates[k]
        return here, self.targets[k] + passed * self.target_rates[k]


class _Navigation(NamedTuple):
    """Sigmas of a carrier: position, north with its sensor's azimuth, drift, north's wander."""

    position_m: float
    north_rad: float
    drift_mps: float
    wander_rad_per_root_s: float


class _Known(NamedTuple):
    """Covariances of all numbers: by the priors, and where all that carriers declare is right."""

    erring: Array
    exact: Array

    def carried(self, forward: Array, unseen: Array, of_targets: Array) -> _Known:
        """Both, later; errors of navigation grow in the first alone."""
        return _Known(
            forward @ self.erring @ forward.T + unseen + of_targets,
            forward @ self.exact @ forward.T + of_targets,
        )

    def improved(self, by: Array, variance: Array) -> _Known:
        """Both after readings, with the gain of the first."""
        pushed = self.erring @ by.T
        gain = np.linalg.solve(by @ pushed + np.diag(variance), pushed.T).T
        left = np.eye(len(gain)) - gain @ by
        noise = (gain * variance) @ gain.T
        return _Known(left @ self.erring @ left.T + noise, left @ self.exact @ left.T + noise)


def bound(scenario: Scenario) -> Bound:
    """The least errors of a fleet's picture.

    Args:
        scenario: one radar a carrier, each with a phase; all targets there all the time.
    """
    carriers: list[Any] = scenario.tree["carriers"]
    course, draw = _course(scenario), np.random.default_rng(0)
    navigation = [_navigation(carrier) for carrier in carriers]
    known = _beforehand(navigation, carriers, course)
    looks = list(_looks(carriers, course.seconds[-1]))
    seen = np.zeros(course.targets.shape[1], dtype=int)
    now, squares = 0.0, []
    for t, carrier in sorted([*looks, *((t, -1) for t in course.seconds)]):
        known = _carried(known, navigation, course, (now, t))
        now = t
        if carrier >= 0:
            known = _looked(known, carriers, carrier, course.at(t), (seen, draw))
        elif t > course.seconds[-1] / 2:
            squares.append(_of_places(known, len(carriers), seen))
    pooled = np.sqrt(np.nanmean(squares, axis=0))
    return Bound(float(pooled[0]), float(pooled[1]))


def _course(scenario: Scenario) -> _Course:
    world, told = World(scenario), []
    for step in range(1, scenario.declared.steps + 1):
        targets, carriers = world.step(step)
        moves = carriers.position_m, carriers.velocity_mps, targets.position_m, targets.velocity_mps
        told.append([np.array(values)[:, :2] for values in moves])
    seconds = np.arange(1, len(told) + 1) * scenario.declared.step_ns * 1e-9
    return _Course(seconds, *(np.array(values) for values in zip(*told, strict=True)))


def _navigation(carrier: Any) -> _Navigation:
    prior, radar = carrier["navigation"], carrier["sensors"][0]
    moves = carrier["motion"].get("speed_mps", 0.0) > 0
    azimuth = radar.get("sigma_azimuth_bias_deg", 0.0)
    return _Navigation(
        prior["sigma_position_m"],
        radians(np.hypot(prior["sigma_north_deg"], azimuth)),
        float(np.hypot(prior["sigma_speed_mps"] * moves, prior["sigma_current_mps"])),
        radians(prior["sigma_north_drift_deg_per_sqrt_h"]) / 60.0,
    )


def _looks(carriers: list[Any], end_s: float) -> Iterator[tuple[float, int]]:
    for number, carrier in enumerate(carriers):
        radar = carrier["sensors"][0]
        for t in np.arange(radar["phase_s"], end_s, radar["period_s"]):
            yield float(t), number


def _beforehand(navigation: list[_Navigation], carriers: list[Any], course: _Course) -> _Known:
    """Of the frames what navigation declares, the errors of the own carrier in all of them."""
    count, targets = len(carriers), course.targets.shape[1]
    own, away = navigation[0], course.carriers[0] - course.carriers[0, 0]
    first = FRAME * (count - 1)
    erring = np.zeros((first + RANGES * count + TARGET * targets,) * 2)
    by_own = np.zeros((len(erring), FRAME))
    for number, other in enumerate(navigation[1:]):
        rows = slice(FRAME * number, FRAME * (number + 1))
        erring[rows, rows] = np.diag(_variances(other))
        by_own[rows] = np.eye(FRAME)
        by_own[rows.start : rows.start + 2, 2] = QUARTER @ away[number + 1]
    erring += by_own @ np.diag(_variances(own)) @ by_own.T
    for number, carrier in enumerate(carriers):
        radar, row = carrier["sensors"][0], first + RANGES * number
        erring[row, row] = radar.get("sigma_range_bias_m", 0.0) ** 2
        erring[row + 1, row + 1] = radar.get("sigma_range_scale", 0.0) ** 2
    wide = [0.0] * (len(erring) - TARGET * targets)
    wide += [ANYWHERE_M**2, ANYWHERE_M**2, ANY_SPEED_MPS**2, ANY_SPEED_MPS**2] * targets
    return _Known(erring + np.diag(wide), np.diag(wide))


def _variances(one: _Navigation) -> Array:
    """(5,) of (q, D, drift)."""
    sigmas = [one.position_m, one.position_m, one.north_rad, one.drift_mps, one.drift_mps]
    return np.square(sigmas)


def _carried(
    known: _Known, navigation: list[_Navigation], course: _Course, between: tuple[float, float]
) -> _Known:
    """After the time between two instants."""
    passed, (places, targets) = between[1] - between[0], course.at(between[1])
    if passed <= 0:
        return known
    count, size = len(places), len(known.erring)
    forward, unseen, moved = np.eye(size), np.zeros((size, size)), np.zeros((size, size))
    turned = np.zeros(size)
    for number in range(1, count):
        row = FRAME * (number - 1)
        forward[row, row + 3] = forward[row + 1, row + 4] = passed
        wander = navigation[number].wander_rad_per_root_s
        unseen[range(row, row + 3), range(row, row + 3)] = [
            2 * WANDERING_M2PS * passed, 2 * WANDERING_M2PS * passed, wander**2 * passed
        ]  # fmt: skip
        turned[row : row + 3] = *(QUARTER @ (places[number] - places[0])), 1.0
    first = FRAME * (count - 1) + RANGES * count
    noise = np.array([[passed**3 / 3, passed**2 / 2], [passed**2 / 2, passed]])
    for number, density in enumerate(_densities(course)):
        row = first + TARGET * number
        turned[row : row + 2] = QUARTER @ (targets[number] - places[0])
        for axis in (row, row + 1):
            forward[axis, axis + 2] = passed
            moved[np.ix_([axis, axis + 2], [axis, axis + 2])] = density * noise
    own_wander = navigation[0].wander_rad_per_root_s ** 2 * passed
    return known.carried(forward, unseen + own_wander * np.outer(turned, turned), moved)


def _densities(course: _Course) -> Array:
    """(T,) of the acceleration of each target [m^2/s^3]."""
    east, north = course.target_rates[..., 0], course.target_rates[..., 1]
    course_rad = np.unwrap(np.arctan2(east, north), axis=0)
    turns = np.ptp(course_rad, axis=0) > 0.05
    squared: Array = (east[0] ** 2 + north[0] ** 2) * TURNING_RAD2PS * turns
    return np.maximum(squared, STRAIGHT_M2PS3)


def _looked(
    known: _Known,
    carriers: list[Any],
    carrier: int,
    places: tuple[Array, Array],
    looks: tuple[Array, np.random.Generator],
) -> _Known:
    """After a report of a carrier.

    Args:
        looks: how often each target was seen, counted on; whence detections are drawn.
    """
    radar, (here, targets), (seen, draw) = carriers[carrier]["sensors"][0], places, looks
    away = targets - here[carrier]
    far = np.hypot(*away.T)
    within = (far >= radar["range_min_m"]) & (far <= radar["range_max_m"])
    told = np.flatnonzero(within & (draw.random(len(far)) < radar["detection_probability"]))
    if not len(told):
        return known
    seen[told] += 1
    first = FRAME * (len(carriers) - 1)
    ranges, rows, variances = first + RANGES * carrier, [], []
    for target in told:
        along = away[target] / far[target]
        by = np.zeros((2, len(known.erring)))
        by[:, first + RANGES * len(carriers) + TARGET * target + np.arange(2)] = np.eye(2)
        by[:, ranges], by[:, ranges + 1] = -along, -away[target]
        if carrier:
            row = FRAME * (carrier - 1)
            by[:, row : row + 2], by[:, row + 2] = -np.eye(2), -QUARTER @ away[target]
        rows.append((QUARTER @ along) @ by)
        variances.append((far[target] * radians(radar["sigma_bearing_deg"])) ** 2)
        if "sigma_range_m" in radar:
            rows.append(along @ by)
            variances.append(radar["sigma_range_m"] ** 2)
    return known.improved(np.array(rows), np.array(variances))


def _of_places(known: _Known, count: int, seen: Array) -> tuple[float, float]:
    """Mean squares of the places of targets seen twice, of both covariances."""
    first = FRAME * (count - 1) + RANGES * count
    found = []
    for covariance in known:
        diagonal = np.diag(covariance)[first:].reshape(-1, TARGET)
        found.append(diagonal[:, 0] + diagonal[:, 1])
    shown = (seen > 1) & (found[0] < SHOWN_M**2)
    if not shown.any():
        return float("nan"), float("nan")
    return float(found[0][shown].mean()), float(found[1][shown].mean())
