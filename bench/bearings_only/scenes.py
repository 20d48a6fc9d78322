"""Benchmarks S and M, and random geometries: known truths, their bearings, their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_ACCELERATION,
    CONSTANT_JERK,
    CONSTANT_VELOCITY,
    FINITE_TURN,
    STRAIGHT_ACCELERATED,
    THREE_LEGS,
    TURN_RATE,
    TWO_LEGS,
    Bearings,
    Motion,
    bearings,
    cramer_rao,
)
from estimation.bearings_only.measurements import ComplexArray

MINUTE = np.radians(1 / 60)
KINDS = "ABCD"
NAMES = {
    "A": "uniform",
    "B": "straight accelerated",
    "C": "constant acceleration",
    "D": "course change",
}
MOTIONS = {
    "A": CONSTANT_VELOCITY,
    "B": STRAIGHT_ACCELERATED,
    "C": CONSTANT_ACCELERATION,
    "D": TWO_LEGS,
}
TURN_S = 307.0  # of D
STEP_S = 15.0
COUNT = 41


class Drawn(NamedTuple):
    """Bearings of B targets and what is true of them at the last bearing.

    Attributes:
        given: noisy bearings.
        range_m: (B,).
        speed_mps: (B,).
        bound: (B,) Cramer-Rao bound of the range by the range, of the true motion.
        place_m: (B, 2).
        motion: the true one, when the family has it.
    """

    given: Bearings
    range_m: Array
    speed_mps: Array
    bound: Array
    place_m: Array
    motion: Motion | None


class Own(NamedTuple):
    """A carrier of constant speed, on a new course after each of its turns."""

    speed_mps: float
    courses_deg: tuple[float, ...]
    turns_s: tuple[float, ...]


class Benchmark(NamedTuple):
    """One of the two frozen geometries; the target starts 3 km north of the carrier."""

    own: Own
    speed_mps: float
    course_deg: float
    along_mps2: float  # of B
    across_mps2: float  # of C, to the right
    turn_deg: float  # of D


BENCHMARKS = {
    "S": Benchmark(Own(5, (210, 300, 210), (200, 400)), 5, 225, 0.015, 0.02, -90),
    "M": Benchmark(Own(10, (90, 270, 90), (200, 400)), 6, 200, 0.01, 0.015, 60),
}


def heading(course_deg: float | Array) -> ComplexArray:
    """Unit vector of a course, east + i north."""
    return np.asarray(np.exp(1j * (np.pi / 2 - np.radians(course_deg))))


def own_track(own: Own, t: Array) -> ComplexArray:
    """Places of the carrier at times t (N,), from the origin."""
    edges = np.array([0.0, *own.turns_s, np.inf])
    place = np.zeros(t.shape, dtype=complex)
    for course, begin, end in zip(own.courses_deg, edges[:-1], edges[1:], strict=True):
        place += own.speed_mps * heading(course) * np.clip(t - begin, 0, end - begin)
    return place


def benchmark(
    rng: np.random.Generator,
    name: str,
    kind: str,
    limit_arcmin: float,
    runs: int,
    count: int = COUNT,
) -> Drawn:
    """Runs of one cell; sigma is a third of the limit. Fewer bearings: the first `count`."""
    chosen = BENCHMARKS[name]
    given = geometry_of(name, limit_arcmin / 3, count)
    turned = kind == "D" and given.t_s[-1] > TURN_S
    motion = CONSTANT_VELOCITY if kind == "D" and not turned else MOTIONS[kind]
    v = chosen.speed_mps * heading(chosen.course_deg)
    a = {
        "B": chosen.along_mps2 * heading(chosen.course_deg),
        "C": chosen.across_mps2 * heading(chosen.course_deg + 90),
    }.get(kind, 0j)
    half = given.t_s[-1] / 2
    middle = 3000j + v * half + a * half**2 / 2
    coefficients = [middle, v + a * half, a][: motion.degree + 1]
    shape: list[float] = []
    if kind == "B":
        shape = [chosen.along_mps2 * half / abs(coefficients[1])]
    if turned:
        coefficients[0] = 3000j + v * half
        shape = [float(np.radians(chosen.turn_deg)), (TURN_S - half) / half]
    return drawn(rng, given, motion, np.array(coefficients), np.array(shape), runs)


def drawn(
    rng: np.random.Generator,
    geometry: Bearings,
    motion: Motion,
    coefficients: ComplexArray,
    shape: Array,
    runs: int,
) -> Drawn:
    """Noisy bearings of a known motion; `runs` of one target, or (B,) targets once."""
    truth = cramer_rao(geometry, motion, coefficients, shape)
    last = truth.state(geometry.t_s[..., -1])
    line = truth.bearings_rad()
    range_m = 1 / truth.inverse_range().value
    bound = truth.inverse_range().sigma * range_m
    count = max(runs, len(range_m))
    noise = rng.normal(size=(count, line.shape[1])) * geometry.sigma_rad
    given = geometry._replace(bearing_rad=line + noise + 0 * geometry.bearing_rad)
    everyone = np.zeros(count)
    return Drawn(
        given,
        range_m + everyone,
        np.linalg.norm(last.velocity_mps, axis=1) + everyone,
        bound + everyone,
        last.position_m + everyone[:, None],
        motion,
    )


def geometry_of(name: str, sigma_arcmin: float, count: int = COUNT) -> Bearings:
    """Times and places of a benchmark; its bearings are not yet taken."""
    t = STEP_S * np.arange(count)
    return _geometry(t, own_track(BENCHMARKS[name].own, t), sigma_arcmin * MINUTE)


def drawn_places(rng: np.random.Generator, geometry: Bearings, places: ComplexArray) -> Drawn:
    """Noisy bearings of targets at known places (B, N), which follow no motion with a bound."""
    d = places - (geometry.observer_m[:, 0] + 1j * geometry.observer_m[:, 1])
    noisy = np.arctan2(d.real, d.imag) + rng.normal(size=d.shape) * geometry.sigma_rad
    velocity = (places[:, -1] - places[:, -2]) / (geometry.t_s[-1] - geometry.t_s[-2])
    unknown = np.full(len(places), np.nan)
    last = np.stack([places[:, -1].real, places[:, -1].imag], axis=1)
    given = geometry._replace(bearing_rad=noisy)
    return Drawn(given, np.abs(d[:, -1]), np.abs(velocity), unknown, last, None)


def _geometry(t: Array, own: ComplexArray, sigma: float | Array) -> Bearings:
    return bearings(t, np.stack([own.real, own.imag], axis=-1), np.zeros(t.shape), sigma)


ENSEMBLE = {
    "uniform": CONSTANT_VELOCITY,
    "straight accelerated": STRAIGHT_ACCELERATED,
    "constant acceleration": CONSTANT_ACCELERATION,
    "constant jerk": CONSTANT_JERK,
    "turn rate": TURN_RATE,
    "course change": TWO_LEGS,
    "finite turn": FINITE_TURN,
    "three legs": THREE_LEGS,
}


def ensemble(rng: np.random.Generator, kind: str, count: int) -> Drawn:
    """Targets and carriers at random, each seen from a carrier of its own.

    Carrier: 4 to 12 m/s, two to four legs, turns of 45 to 135 deg. Target: 1.5 to 10 km, 2 to 10
    m/s. 400 to 1200 s, 25 to 60 bearings of 2' to 20', a tenth of them missing.
    """
    t, own, sigma, seen = _observations(rng, count)
    geometry = _geometry(t, own, sigma)._replace(bearing_rad=np.where(seen, 0.0, np.nan))
    half = t[:, -1] / 2
    start = np.exp(rng.uniform(np.log(1500), np.log(10_000), count)) * _any_direction(rng, count)
    v = rng.uniform(2, 10, count) * _any_direction(rng, count)
    motion = ENSEMBLE[kind]
    shape = _random_shape(rng, kind, half, np.abs(v), count)
    a = rng.uniform(0.004, 0.02, count) * _any_direction(rng, count)
    jerk = rng.uniform(2e-5, 1e-4, count) * _any_direction(rng, count)
    derivatives = np.stack([v, a, jerk])[: motion.degree]
    coefficients = np.concatenate([np.zeros((1, count)), derivatives])
    without = cramer_rao(geometry, motion, coefficients, shape).state(t[:, 0]).position_m
    coefficients[0] = start - (without[:, 0] + 1j * without[:, 1])
    return drawn(rng, geometry, motion, coefficients, shape, count)


def _observations(
    rng: np.random.Generator, count: int
) -> tuple[Array, ComplexArray, Array, np.typing.NDArray[np.bool_]]:
    """Times, carrier's places, sigmas and whether seen, (B, 60) each."""
    number = rng.integers(25, 61, count)
    duration = rng.uniform(400, 1200, count)
    index = np.arange(60)
    t = np.minimum(index / (number[:, None] - 1), 1) * duration[:, None]
    seen = (index < number[:, None] - 1) & (rng.uniform(size=t.shape) > 0.1)
    seen[:, [0, -1]] = True
    own = np.stack(
        [own_track(_random_own(rng, d), row) for d, row in zip(duration, t, strict=True)]
    )
    sigma = np.exp(rng.uniform(np.log(2), np.log(20), count)) * MINUTE
    return t, own, np.repeat(sigma[:, None], 60, axis=1), seen


def _random_own(rng: np.random.Generator, duration: float) -> Own:
    legs = int(rng.integers(2, 5))
    turns = rng.uniform(45, 135, legs - 1) * rng.choice([-1, 1], legs - 1)
    courses = rng.uniform(0, 360) + np.concatenate([[0], np.cumsum(turns)])
    times = (np.arange(1, legs) + rng.uniform(-0.3, 0.3, legs - 1)) / legs * duration
    return Own(rng.uniform(4, 12), tuple(courses), tuple(times))


def _random_shape(
    rng: np.random.Generator, kind: str, half: Array, speed: Array, count: int
) -> Array:
    """The shape (P, B) of a kind, in half spans."""
    sign = rng.choice([-1, 1], count)
    if kind == "straight accelerated":
        return np.array([sign * rng.uniform(0.004, 0.02, count) * half / speed])
    if kind == "turn rate":
        return np.array([sign * np.radians(rng.uniform(0.05, 0.25, count)) * half])
    if kind == "course change":
        return np.stack(
            [sign * np.radians(rng.uniform(30, 120, count)), rng.uniform(-0.6, 0.6, count)]
        )
    if kind == "finite turn":
        return one_turn(rng, half, count, (-0.5, 0.5))
    if kind == "three legs":
        return np.concatenate(
            [one_turn(rng, half, count, (-0.7, -0.25)), one_turn(rng, half, count, (0.2, 0.6))]
        )
    return np.zeros((0, count))


def one_turn(rng: np.random.Generator, half: Array, count: int, middles: Sequence[float]) -> Array:
    """A turn (3, B) of 1 deg/s for 30 to 120 s, its middle within some half spans."""
    duration = rng.uniform(30, 120, count)
    angle = np.radians(duration) * rng.choice([-1, 1], count)
    return np.stack([angle, rng.uniform(*middles, count), np.log(duration / half)])


def _any_direction(rng: np.random.Generator, count: int) -> ComplexArray:
    return np.asarray(np.exp(2j * np.pi * rng.uniform(size=count)))
