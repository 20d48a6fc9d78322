"""Intervals of the range by the likelihood ratio, for a motion that is known.

1 / range is an estimate with a sigma, and where bearings are poor that sigma is itself a guess: it
grows with the range that happens to be found. The likelihood does not care how a parameter is
written. A range lies in the interval when the best fit that has it costs no more than `SIGMAS`
squared above the best of all: Wilks' theorem, which needs no Gaussian in 1 / range.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.criterion import Criterion, criterion
from estimation.bearings_only.estimate import Estimate, inverse_range_at
from estimation.bearings_only.levenberg_marquardt import minimised
from estimation.bearings_only.normal_equations import Loss, Normal

SIGMAS = 1.959964
_ROUNDS = 4
_FIRM = 0.01  # sigmas: how firmly 1 / range is held where it is asked for
_MOST = 8.0  # sigmas: beyond it nothing is looked for
_STEPS = 20


class Ranges(NamedTuple):
    """95 % intervals (B,) of the range at the last bearing; `high_m` infinite: it is open."""

    low_m: Array
    high_m: Array


class Held(NamedTuple):
    """A criterion with 1 / range held at a value (B,), as firmly as `sigma` says."""

    free: Criterion
    inverse_range: Array
    sigma: Array

    def evaluate(self, p: Array) -> Normal:
        """Cost, half gradient and J'J at p, with what holds it."""
        here = self.free.evaluate(p)
        value, by = inverse_range_at(self.free.scene, self.free.motion, p)
        off, by = (value - self.inverse_range) / self.sigma, by / self.sigma
        return Normal(
            here.cost + off**2, here.gradient + by * off, here.matrix + by[:, None] * by[None]
        )

    def admissible(self, p: Array) -> Array:
        """As of the free criterion."""
        return self.free.admissible(p)

    def gauge(self, p: Array) -> Array:
        """As of the free criterion."""
        return self.free.gauge(p)

    def take(self, columns: NDArray[np.int_]) -> Held:
        """The same for some of the targets."""
        return Held(self.free.take(columns), self.inverse_range[columns], self.sigma[columns])


def likely_ranges(found: Estimate, loss: Loss | None = None) -> Ranges:
    """95 % intervals of the range about maxima of the likelihood.

    Args:
        found: of `maximum_likelihood`, with the same loss.

    Source: S. Wilks, Annals of Mathematical Statistics 9 (1938), 60-62.
    """
    free = criterion(found.scene, found.motion, loss=loss)
    with np.errstate(all="ignore"):
        low, high = (_end(free, found, side) for side in (-1.0, 1.0))
        return Ranges(np.where(high > 0, 1 / high, np.inf), np.where(low > 0, 1 / low, np.inf))


def _end(free: Criterion, found: Estimate, side: float) -> Array:
    """1 / range [1/m] (B,) to one side, where the fit is as much worse as `SIGMAS` says.

    The root of the cost is nearly straight in 1 / range: a few steps of the secant find its value.
    """
    best, sigma = found.inverse_range()
    least = free.evaluate(found.p).cost
    before, before_root = np.zeros_like(best), np.zeros_like(best)
    away, p = np.full_like(best, SIGMAS), found.p
    for _ in range(_ROUNDS):
        at = best + side * away * sigma
        p = minimised(Held(free, at, _FIRM * sigma), p, _STEPS).p
        value = inverse_range_at(found.scene, found.motion, p)[0]
        here = side * (value - best) / sigma
        root = np.sqrt(np.maximum(free.evaluate(p).cost - least, 0.0))
        slope = (root - before_root) / (here - before)
        slope = np.where(np.isfinite(slope) & (slope > 0.1), slope, 0.1)
        before, before_root = here, root
        away = np.clip(here + (SIGMAS - root) / slope, 0.1, _MOST)
    away = np.where(away >= _MOST, np.inf, away)
    ends: Array = best + side * np.where(np.isfinite(away), away, _MOST) * sigma
    return np.where(np.isinf(away), side * np.inf, ends)
