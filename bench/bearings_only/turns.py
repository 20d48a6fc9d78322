"""Motions that turn: one finite turn, two, and motions that no model has, which must alarm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.bearings_only.scenes import (
    BENCHMARKS,
    Drawn,
    drawn,
    drawn_places,
    geometry_of,
    heading,
    one_turn,
)
from bench.bearings_only.unknown import Judged, judged
from bench.figures import Figure, at_least, at_most, told
from estimation.arrays import Array
from estimation.bearings_only import FINITE_TURN, THREE_LEGS, Motion

SIGMA_ARCMIN = 10 / 3


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """On both benchmarks, limit 10'."""
    for name in BENCHMARKS:
        rng = np.random.default_rng([seed, 4, ord(name)])
        once = judged(turning(rng, name, FINITE_TURN, runs))
        yield at_most(f"{name} 10': one finite turn, 95th percentile", once.percentile(95), 25, "%")
        yield told(f"{name} 10': one finite turn, median", once.percentile(50), "%")
        yield told(f"{name} 10': one finite turn, median bound x .6745", once.median_bound, "%")
        twice = judged(turning(rng, name, THREE_LEGS, -(-runs // 4)))
        yield at_most(f"{name} 10': two turns, median", twice.percentile(50), 10, "%")
        yield told(f"{name} 10': two turns, 95th percentile", twice.percentile(95), "%")
        yield told(f"{name} 10': two turns, median bound x .6745", twice.median_bound, "%")
        alarms = unmodelled_alarms(rng, name, -(-runs // 4))
        for kind, share in alarms.items():
            yield told(f"{name} 10': alarm, {kind}", share)
        every = float(np.mean(list(alarms.values())))
        yield at_least(f"{name} 10': alarm on unmodelled motions", every, 0.9)
        yield told(f"{name} 10': false alarms, one finite turn", once.alarms)


def turning(rng: np.random.Generator, name: str, motion: Motion, runs: int) -> Drawn:
    """The benchmark's uniform target, but turning 1 deg/s for 30 to 120 s, once or twice."""
    chosen = BENCHMARKS[name]
    given = geometry_of(name, SIGMA_ARCMIN)
    half = np.full(runs, given.t_s[-1] / 2)
    if motion is FINITE_TURN:
        shape = one_turn(rng, half, runs, (-0.5, 0.5))
    else:
        first, second = (
            one_turn(rng, half, runs, (-0.7, -0.25)),
            one_turn(rng, half, runs, (0.2, 0.6)),
        )
        shape = np.concatenate([first, second])
    v = chosen.speed_mps * heading(chosen.course_deg)
    coefficients = np.stack([3000j + v * half, v + 0 * half])
    return drawn(rng, given, motion, coefficients, shape, runs)


def unmodelled_alarms(rng: np.random.Generator, name: str, runs: int) -> dict[str, float]:
    """Share of alarms by kind of motion."""
    found: dict[str, Judged] = {}
    for kind in ("weave", "zigzag of five legs", "figures of eight"):
        found[kind] = judged(unmodelled(rng, name, kind, runs))
    return {kind: result.alarms for kind, result in found.items()}


def unmodelled(rng: np.random.Generator, name: str, kind: str, runs: int) -> Drawn:
    """A target of constant speed whose course is none of the family's functions of time."""
    chosen = BENCHMARKS[name]
    given = geometry_of(name, SIGMA_ARCMIN)
    t = np.arange(0.0, given.t_s[-1] + 0.5)
    course = np.radians(chosen.course_deg) + _wandering(rng, kind, t, runs)
    velocity = chosen.speed_mps * (np.sin(course) + 1j * np.cos(course))
    steps = np.concatenate([np.zeros((runs, 1)), np.cumsum(velocity[:, :-1], axis=1)], axis=1)
    places = 3000j + steps[:, np.round(given.t_s).astype(int)]
    return drawn_places(rng, given, places)


def _wandering(rng: np.random.Generator, kind: str, t: Array, runs: int) -> Array:
    """Courses (runs, seconds) about the mean one [rad]."""
    phase = rng.uniform(0, 2 * np.pi, (runs, 1))
    if kind == "weave":
        amplitude = np.radians(rng.uniform(45, 80, (runs, 1)))
        return np.asarray(
            amplitude * np.sin(2 * np.pi * t / rng.uniform(150, 250, (runs, 1)) + phase)
        )
    if kind == "figures of eight":  # a circle to one side, the next to the other
        circles = t / rng.uniform(180, 300, (runs, 1)) + rng.uniform(0, 2, (runs, 1))
        return np.asarray(phase + 2 * np.pi * np.abs(circles % 2 - 1))
    leg = rng.uniform(100, 140, (runs, 1))
    number = np.floor(t / leg + phase / (2 * np.pi)).astype(int)
    side = np.where(number % 2 == 0, 1.0, -1.0)
    return np.asarray(side * np.radians(rng.uniform(35, 70, (runs, 1))))
