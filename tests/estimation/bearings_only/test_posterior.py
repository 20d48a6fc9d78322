"""Intervals of one motion against its posterior, integrated by other means."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import multivariate_t

from bench.bearings_only.scenes import MOTIONS, benchmark
from estimation.arrays import Array
from estimation.bearings_only import Bearings, MotionPrior, solve_many

PRIOR = MotionPrior()
SIGMAS = np.repeat([PRIOR.sigma_speed_mps, PRIOR.sigma_acceleration_mps2], 2)
UNITS = np.array([1.0, 1e-3, 1e-3, 1e-3, 1e-6, 1e-6])


@pytest.mark.parametrize(("name", "kind"), [("S", "A"), ("M", "C")])
def test_an_interval_is_that_of_the_posterior(name: str, kind: str) -> None:
    """2.5 % are beyond either end, to .05 % by chance and .1 % by Laplace's method.

    Profiles, which forget how many velocities fit a range, have 2.1 % below.
    """
    scene = benchmark(np.random.default_rng(12), name, kind, 60, 3)
    solutions = solve_many(scene.given, motions=(MOTIONS[kind],))
    for found, row in zip(solutions, scene.given.bearing_rad, strict=True):
        given = scene.given._replace(bearing_rad=row)
        ranges, weights = sampled(given, MOTIONS[kind].degree)
        assert 1 / (weights**2).sum() > 10_000
        assert weights @ (ranges < found.interval.low_m) == pytest.approx(0.025, abs=0.002)
        assert weights @ (ranges > found.interval.high_m) == pytest.approx(0.025, abs=0.002)


def sampled(given: Bearings, degree: int) -> tuple[Array, Array]:
    """Ranges (K,) at the last bearing and their weights (K,): importance sampling of a polynomial.

    Samples are of the last bearing, 1 / range and the derivatives in the middle by range, the
    velocity less the carrier's: in these, bearings are nearly linear.
    """
    start = np.array([given.bearing_rad[-1], 0.25, *np.zeros(2 * degree)])
    least = [-np.inf, 0.02, *np.full(2 * degree, -np.inf)]
    best = least_squares(lambda u: residuals(u[None], given)[0], start, bounds=(least, np.inf))
    spread = np.linalg.inv(best.jac.T @ best.jac)
    proposal = multivariate_t(best.x, 1.5 * spread, df=5, seed=1)
    u = proposal.rvs(100_000)
    u = u[u[:, 1] > 0]
    by_volume = -(1 + 2 * degree) * np.log(u[:, 1])  # of log range and derivatives by u
    log_weight = by_volume - (residuals(u, given) ** 2).sum(axis=1) / 2 - proposal.logpdf(u)
    weights = np.exp(log_weight - log_weight.max())
    return 1 / (u[:, 1] * UNITS[1]), weights / weights.sum()


def residuals(u: Array, given: Bearings) -> Array:
    """Of the bearings and of the prior, standardised (K, N + 1 + 2 degree), of samples (K, M)."""
    x = u * UNITS[: u.shape[1]]
    t, own = given.t_s - given.t_s.mean(), given.observer_m @ [1, 1j]
    range_m = 1 / x[:, 1]
    derivatives = range_m[:, None] * (x[:, 2::2] + 1j * x[:, 3::2])
    derivatives[:, 0] += np.polyfit(t, own, 1)[0]
    powers = np.stack([t, t**2 / 2])[: derivatives.shape[1]]
    last = own[-1] + range_m * 1j * np.exp(-1j * x[:, 0])
    place = last[:, None] + derivatives @ (powers - powers[:, -1:])
    off = np.angle((place - own) * np.exp(1j * given.bearing_rad) / 1j) / given.sigma_rad
    before = np.log(range_m / PRIOR.range_m) / PRIOR.sigma_log_range
    parts = np.stack([derivatives.real, derivatives.imag], axis=2).reshape(len(u), -1)
    return np.concatenate([off, before[:, None], parts / SIGMAS[: parts.shape[1]]], axis=1)
