"""The system demand: three carriers, six targets, one known beacon, five minutes, all unknown.

The page gives the sigmas; who goes where is ours, and stays: three carriers at 60 m/s turn half
about within 6 km of the origin, six targets pass within 5 km of it at 120 to 220 m/s. Dead
reckoning errs as in benchmark G; two-way ranges come every 2.5 s, logs every 5 s. Errors are drawn.

The page's limit leaves the geometry open, so random ones are measured too, and each solution
against the posterior bound: all factors linearised at the truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_most, between, scaled_seconds, told
from estimation.arrays import Array
from estimation.bordered import Solution, factor, last_covariance, normal_equations
from estimation.consistency import nees, rms
from estimation.frames import polar_from_east_north, wrap_pi
from estimation.joint_navigation import (
    CONSTANTS,
    CURRENT,
    HEADING,
    LOG_DRIFT,
    LOG_TIME,
    CarrierPrior,
    Group,
    Ranging,
    Solved,
    TargetLogs,
    constant,
    ranging,
    solve,
    target_logs,
    with_north_of,
)
from estimation.joint_navigation.rows import Factors
from estimation.system_alignment import DeadReckoning, dead_reckoning
from estimation.system_alignment.losses import squares

DEG = np.pi / 180
OWN, CARRIERS, TARGETS = 0, 3, 6
DURATION_S, LOGS_EVERY_S = 300.0, 5.0
SIGMA_START_M, SIGMA_HEADING_RAD, SIGMA_LOG_TIME_S, SIGMA_CURRENT_MPS = 200.0, 1 * DEG, 0.5, 0.5
SIGMA_RANGE_M, SIGMA_LOG_M, SIGMA_LOG_RAD = 5.0, 30.0, 0.5 * DEG
AGILITY = 0.3  # of the targets, m/s^1.5
SIGMA_SPEED_MPS, SIGMA_COURSE_RAD = 0.63, 0.32 * DEG  # benchmark G's, of the mean of 2.5 s
PRIOR = CarrierPrior(
    start_m=SIGMA_START_M,
    heading_rad=SIGMA_HEADING_RAD,
    current_mps=SIGMA_CURRENT_MPS,
    log_time_s=SIGMA_LOG_TIME_S,
)


class Pace(NamedTuple):
    """How fast carriers go, and how often they range; reckoning errs alike whatever is chosen."""

    speed_mps: float = 60.0
    interval_s: float = 2.5

    @property
    def epochs(self) -> int:
        """Of the whole run."""
        return round(DURATION_S / self.interval_s)

    @property
    def sigmas(self) -> tuple[float, float]:
        """Of log [m/s] and compass [rad], each the mean of one interval."""
        longer = np.sqrt(2.5 / self.interval_s)
        return float(SIGMA_SPEED_MPS * longer), float(SIGMA_COURSE_RAD * longer)


class Geometry(NamedTuple):
    """Who goes where.

    Attributes:
        starts_m: (C, 2) of the carriers.
        courses_rad: (C,) at the start.
        turns: (C,) half turns on the way, clockwise.
        beacon_m: (3,).
        turned_rad: of the targets' pattern.
    """

    starts_m: Array
    courses_rad: Array
    turns: Array
    beacon_m: Array
    turned_rad: float = 0.0


OUR_PACE = Pace()
OURS = Geometry(
    np.array([[-4e3, -3e3], [4e3, -2e3], [0.0, 4e3]]),
    np.radians([30.0, 300.0, 150.0]),
    np.array([1.0, -1.0, 1.0]),
    np.array([2000.0, -1000.0, 0.0]),
)


def any_geometry(rng: np.random.Generator) -> Geometry:
    """Starts and beacon within 6 km of the origin, any courses, at most half a turn."""
    return Geometry(
        rng.uniform(-6e3, 6e3, (CARRIERS, 2)),
        rng.uniform(0, 2 * np.pi, CARRIERS),
        rng.uniform(-1, 1, CARRIERS),
        np.array([*rng.uniform(-6e3, 6e3, 2), 0.0]),
        rng.uniform(0, 2 * np.pi),
    )


class Truth(NamedTuple):
    """What is to be found.

    Attributes:
        places_m: (n, C, 2).
        targets: (n, M, 4) places and velocities.
        heading_rad: (C,).
        log_time_s: (C,) at time 0; log_drift: (C,) by how much more in every second.
        current_mps: (C, 2).
    """

    places_m: Array
    targets: Array
    heading_rad: Array
    log_time_s: Array
    log_drift: Array
    current_mps: Array


def scene(
    rng: np.random.Generator,
    sigma_log_drift: float = 0.0,
    where: Geometry = OURS,
    pace: Pace = OUR_PACE,
) -> tuple[Group, Truth]:
    """One draw of all but the geometry; clocks of logs drift where a sigma of that is given."""
    heading = SIGMA_HEADING_RAD * rng.standard_normal(CARRIERS)
    heading[OWN] = 0.0  # the gauge: with one beacon, any turn about it changes no measurement
    late = SIGMA_LOG_TIME_S * rng.standard_normal(CARRIERS)
    flown = [_carrier(rng, where, pace, c, heading[c]) for c in range(CARRIERS)]
    paths = tuple(path for path, *_ in flown)
    places = np.stack([true for _, true, *_ in flown], axis=1)
    velocity = np.stack([speed for *_, speed, _ in flown], axis=1)
    drift = sigma_log_drift * rng.standard_normal(CARRIERS) if sigma_log_drift else np.zeros(3)
    heard = _ranging(rng, places, where.beacon_m[:2])
    targets = np.stack([_target(rng, m, where.turned_rad, pace) for m in range(TARGETS)], axis=1)
    current = np.array([drawn for *_, drawn in flown])
    truth = Truth(places, targets, heading, late, drift, current)
    group = Group(
        paths=paths,
        priors=(PRIOR._replace(log_drift=sigma_log_drift),) * CARRIERS,
        beacons_m=where.beacon_m[None],
        sigma_beacons_m=np.zeros((1, 3)),
        targets=TARGETS,
        agility=AGILITY,
        ranging=heard,
        logs=_logs(rng, truth, velocity, pace),
    )
    return with_north_of(group, OWN), truth


def _carrier(
    rng: np.random.Generator, where: Geometry, pace: Pace, carrier: int, bias: float
) -> tuple[DeadReckoning, Array, Array, Array]:
    """Dead reckoning of a carrier, its true places and velocities over ground (n, 2), current."""
    epochs, (sigma_speed_mps, sigma_course_rad) = pace.epochs, pace.sigmas
    course = where.courses_rad[carrier] + where.turns[carrier] * np.linspace(0, np.pi, epochs)
    start = where.starts_m[carrier]
    current = SIGMA_CURRENT_MPS * rng.standard_normal(2)
    velocity = pace.speed_mps * np.column_stack([np.sin(course), np.cos(course)]) + current
    places = start + np.cumsum(pace.interval_s * velocity, axis=0)
    path = dead_reckoning(
        pace.interval_s,
        pace.speed_mps + sigma_speed_mps * rng.standard_normal(epochs),
        course - bias + sigma_course_rad * rng.standard_normal(epochs),
        sigma_speed_mps,
        sigma_course_rad,
        start_m=start + SIGMA_START_M * rng.standard_normal(2),
    )
    return path, places, velocity, current


def _ranging(rng: np.random.Generator, places: Array, beacon_m: Array) -> Ranging:
    """Two-way ranges of every pair, and to the beacon, at every epoch."""
    columns, epochs = [], len(places)
    nodes = np.concatenate([places, np.broadcast_to(beacon_m, (epochs, 1, 2))], axis=1)
    for own in range(CARRIERS):
        for peer in range(own + 1, CARRIERS + 1):
            exact = np.linalg.norm(nodes[:, own] - nodes[:, peer], axis=1)
            value = exact + SIGMA_RANGE_M * rng.standard_normal(epochs)
            full = np.full(epochs, own), np.full(epochs, peer)
            columns.append(np.column_stack([np.arange(epochs), *full, value]))
    epoch, own, peer, value = np.vstack(columns).T
    return ranging(epoch, own, peer, value, SIGMA_RANGE_M)


def _logs(rng: np.random.Generator, truth: Truth, velocity: Array, pace: Pace) -> TargetLogs:
    """Logs of every target by every carrier at every epoch, stamped late."""
    epoch, own, target = (
        index.ravel()
        for index in np.meshgrid(
            np.arange(0, pace.epochs, round(LOGS_EVERY_S / pace.interval_s)),
            np.arange(CARRIERS),
            np.arange(TARGETS),
            indexing="ij",
        )
    )
    closing = truth.targets[epoch, target, 2:] - velocity[epoch, own]
    apart = truth.targets[epoch, target, :2] - truth.places_m[epoch, own]
    late_s = truth.log_time_s[own] + truth.log_drift[own] * pace.interval_s * (epoch + 1)
    apart = apart - late_s[:, None] * closing
    bearing, distance = polar_from_east_north(apart)
    return target_logs(
        epoch,
        own,
        target,
        bearing - truth.heading_rad[own] + SIGMA_LOG_RAD * rng.standard_normal(len(own)),
        distance + SIGMA_LOG_M * rng.standard_normal(len(own)),
        SIGMA_LOG_RAD,
        SIGMA_LOG_M,
    )


def _target(rng: np.random.Generator, target: int, turned_rad: float, pace: Pace) -> Array:
    """(n, 4) a target that wanders about a straight line through the middle of the scene."""
    course = np.pi / 3 * target + 0.2 + turned_rad
    aside = np.pi / 3 * target * 2 + 1.0 + turned_rad
    velocity = (120 + 20 * target) * np.array([np.sin(course), np.cos(course)])
    middle = 5e3 * np.array([np.sin(aside), np.cos(aside)])
    dt = pace.interval_s
    root = AGILITY * np.linalg.cholesky(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]))
    state = np.array([middle - velocity * pace.epochs * dt / 2, velocity])
    states = []
    for _ in range(pace.epochs):
        state = np.array([state[0] + dt * state[1], state[1]]) + root @ rng.standard_normal((2, 2))
        states.append(state.ravel())
    return np.array(states)


class Outcome(NamedTuple):
    """Errors of one solution at the last epoch, and how honest it is.

    Attributes:
        place_m: (C, 2) absolute.
        relative_m: (C - 1, 2) from the own carrier.
        smoothed_m: (n, C - 1, 2) the same at every epoch.
        heading_rad: (C - 1,) of the others.
        log_time_s: (C,).
        nees: of the last places, headings and log times together, by dimension.
        solved: whether the iteration settled.
    """

    place_m: Array
    relative_m: Array
    smoothed_m: Array
    heading_rad: Array
    log_time_s: Array
    nees: float
    solved: bool


def outcome(found: Solved, truth: Truth) -> Outcome:
    """A solution against the truth."""
    places = found.carriers_m - truth.places_m
    place, apart = places[-1], places[:, 1:] - places[:, OWN, None]
    heading = wrap_pi(found.constants[:, HEADING] - truth.heading_rad)
    late = found.constants[:, LOG_TIME] - truth.log_time_s
    which = [constant(c, i) for i in (HEADING, LOG_TIME) for c in range(CARRIERS)]
    which.remove(constant(OWN, HEADING))
    free = [int(np.flatnonzero(found.group.free == i)[0]) for i in which]
    covariance = last_covariance(found.solution)
    index = np.concatenate([np.arange(2 * CARRIERS), found.group.block + np.array(free)])
    error = np.concatenate([place.ravel(), heading[1:], late])
    normalised = float(nees(error, covariance[np.ix_(index, index)])) / len(error)
    settled = found.status == "solved"
    return Outcome(place, apart[-1], apart, heading[1:], late, normalised, settled)


def bound_of(group: Group, truth: Truth) -> float:
    """Posterior bound of the relative position at the last epoch: sigma of a coordinate."""
    theta = group.mean.copy()
    for carrier in range(CARRIERS):
        theta[constant(carrier, HEADING)] = truth.heading_rad[carrier]
        theta[constant(carrier, LOG_TIME)] = truth.log_time_s[carrier]
        theta[constant(carrier, LOG_DRIFT)] = truth.log_drift[carrier]
        theta[CONSTANTS * carrier :][CURRENT] = truth.current_mps[carrier]
    free = theta[group.free]
    x = np.column_stack([part.reshape(len(part), -1) for part in (truth.places_m, truth.targets)])
    factored = factor(normal_equations(Factors(group, squares)(x, free)))
    known = Solution(x, free, factored, 0.0, converged=True, steps=0)
    return relative_sigma_m(last_covariance(known))


def relative_sigma_m(covariance: Array) -> float:
    """Of a coordinate of the others from the own carrier, by a covariance of all places first."""
    apart = np.kron(np.eye(CARRIERS)[1:] - np.eye(CARRIERS)[OWN], np.eye(2))
    size = 2 * CARRIERS
    return float(np.sqrt(np.trace(apart @ covariance[:size, :size] @ apart.T) / len(apart)))


def outcomes(seed: int, runs: int) -> list[Outcome]:
    """Many draws solved."""
    rng = np.random.default_rng([seed, 20])
    scenes = (scene(rng) for _ in range(runs))
    return [outcome(solve(group), truth) for group, truth in scenes]


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The system demand."""
    rng = np.random.default_rng([seed, 20])
    scenes = [scene(rng) for _ in range(max(runs // 4, 5))]
    found = [outcome(solve(group), truth) for group, truth in scenes]
    relative = float(rms([o.relative_m for o in found]))
    heading = float(np.degrees(rms([o.heading_rad for o in found])))
    late = float(rms([o.log_time_s for o in found]))
    own = float(rms([o.place_m for o in found]))
    yield at_most("system: relative position, per axis", relative, 6, "m")
    bound = float(rms([bound_of(*one) for one in scenes]))
    yield told("system: relative position, per axis, posterior bound", bound, "m")
    smoothed = float(rms([o.smoothed_m for o in found]))
    yield told("system: relative position over the whole run, smoothed", smoothed, "m")
    yield at_most("system: heading", heading, 0.05, "deg")
    yield at_most("system: log clock", late, 0.045, "s")
    yield at_most("system: own position, per axis", own, 6.5, "m")
    normalised = float(np.mean([o.nees for o in found]))
    yield between("system: NEES by dimension", normalised, 0.85, 1.25)
    yield at_most("system: failures", sum(not o.solved for o in found), 0)
    yield from _anywhere(seed, max(runs // 5, 5))
    group, _ = scene(np.random.default_rng([seed, 21]))
    yield told(
        "system: solve, 120 epochs of 30 unknowns", scaled_seconds(lambda: solve(group), 3), "s"
    )


def random_scenes(seed: int, geometries: int) -> list[tuple[Geometry, Group, Truth]]:
    """Random geometries, one draw each."""
    rng, found = np.random.default_rng([seed, 22]), []
    for _ in range(geometries):
        where = any_geometry(rng)
        found.append((where, *scene(rng, where=where)))
    return found


def _anywhere(seed: int, geometries: int) -> Iterator[Figure]:
    """Random geometries: what the posterior bound leaves, and what is reached."""
    scenes = [(group, truth) for _, group, truth in random_scenes(seed, geometries)]
    bounds = np.array([bound_of(*one) for one in scenes])
    for share in (0.1, 0.5, 0.9):
        name = f"random geometries: bound of the relative position, quantile {share}"
        yield told(name, float(np.quantile(bounds, share)), "m")
    errors = [outcome(solve(group), truth).relative_m for group, truth in scenes]
    ratio = float(rms(errors)) / float(rms(bounds))
    yield told("random geometries: relative position, RMSE / bound", ratio)
