"""Targets drawn from the family's own prior: how often intervals cover, averaged over it.

A Bayesian interval of 95 % covers .95 of the targets one believes in, not .95 of every one of them.
The cells of S and M and the random geometries are fixed or drawn by other rules.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.bearings_only.scenes import Drawn, drawn, geometry_of, heading
from bench.bearings_only.unknown import judged
from bench.figures import Figure, between, told
from estimation.arrays import Array
from estimation.bearings_only import FAMILY, Bearings, Motion, MotionPrior
from estimation.bearings_only.measurements import ComplexArray

LIMITS_ARCMIN = (10, 60)


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Both benchmarks' carriers: each motion by itself, and all by their odds."""
    odds = np.array([motion.odds for motion in FAMILY])
    count = -(-runs // 4)
    for name in ("S", "M"):
        for limit in LIMITS_ARCMIN:
            geometry = geometry_of(name, limit / 3)
            rng = np.random.default_rng([seed, 5, ord(name), limit])
            found = [judged(believed(rng, geometry, motion, count)) for motion in FAMILY]
            title = f"{name} {limit}', targets of the prior"
            shares = np.array([one.covered.mean() for one in found])
            for motion, share in zip(FAMILY, shares.tolist(), strict=True):
                yield told(f"{title}, {motion.name}: 95 % intervals cover", share)
            share = float(odds @ shares / odds.sum())
            yield between(f"{title}, all by their odds: 95 % intervals cover", share, 0.92, 0.97)


def believed(rng: np.random.Generator, geometry: Bearings, motion: Motion, count: int) -> Drawn:
    """Targets of one motion as its prior has them, seen from the carrier (N,) of a geometry."""
    prior = MotionPrior()
    half = float(geometry.t_s[-1] - geometry.t_s[0]) / 2
    sigmas = (prior.sigma_speed_mps, prior.sigma_acceleration_mps2, prior.sigma_jerk_mps3)
    derivatives = np.array([s * _normal(rng, count) for s in sigmas[: motion.degree]])
    shape = _shape(rng, motion, half, np.abs(derivatives[0]))
    range_m = prior.range_m * np.exp(prior.sigma_log_range * rng.normal(size=count))
    last = complex(*geometry.observer_m[-1]) + range_m * heading(rng.uniform(0, 360, count))
    along = motion.basis(np.ones((1, count)), shape)[0][1:, 0]
    halves = half ** np.arange(1.0, motion.degree + 1)[:, None]
    middle = last - (derivatives * halves * along).sum(axis=0)
    return drawn(rng, geometry, motion, np.array([middle, *derivatives]), shape, count)


def _normal(rng: np.random.Generator, count: int) -> ComplexArray:
    return rng.normal(size=count) + 1j * rng.normal(size=count)


def _shape(rng: np.random.Generator, motion: Motion, half: float, speed_mps: Array) -> Array:
    """The shape (P, B) of a motion, in half spans."""
    prior, count = MotionPrior(), len(speed_mps)
    normal = rng.normal(size=(3, count))
    duration = prior.turn_duration_s * np.exp(prior.sigma_log_duration * normal[2])
    by_name = {
        "kappa": prior.sigma_acceleration_mps2 * normal[0] * half / speed_mps,
        "omega": prior.sigma_turn_rate_rad_s * normal[0] * half,
        "angle": prior.sigma_turn_rad * normal[0],
        "middle": rng.uniform(-1, 1, count),
        "duration": np.log(duration / half),
    }
    return np.array([by_name[name] for name in motion.shape_names]).reshape(-1, count)
