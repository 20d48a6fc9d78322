"""The paper's own filter, labelled baselines.

Equations 8 and 9 are right and equal the Kalman update with correlated noise. The correlation that
the paper feeds them, r = cos of the angle between the lines of sight (12, 13), holds only where the
errors come from an isotropic error of the controller and from nothing else; with three sources in
the plane (four in space) it makes the noise singular, and it says nothing of correlation in time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array


class Scalar(NamedTuple):
    """A scalar state and its variance."""

    mean: float
    variance: float


class Pair(NamedTuple):
    """Two observations X1, X2 of a scalar: coefficients H, variances D, correlation r12."""

    value: tuple[float, float]
    coefficient: tuple[float, float]
    variance: tuple[float, float]
    correlation: float


def modified_update(known: Scalar, seen: Pair) -> Scalar:
    """Eqs 8 and 9, `known` being the prediction b A and b^2 R + D.

    Raises:
        ValueError: the correlation is not between -1 and 1.
    """
    r = seen.correlation
    if not -1 < r < 1:
        raise ValueError(f"need a correlation between -1 and 1: got {r}")
    (x1, x2), (h1, h2), (d1, d2) = seen.value, seen.coefficient, seen.variance
    free = 1 - r**2
    both = np.sqrt(d1 * d2)
    inverse = 1 / known.variance  # eq. 9
    inverse += h1**2 / (free * d1) + h2**2 / (free * d2) - 2 * r * h1 * h2 / (free * both)
    variance = 1 / inverse
    first, second = x1 - h1 * known.mean, x2 - h2 * known.mean
    mean = known.mean  # eq. 8
    mean += variance * (h1 / d1 - r * h2 / both) / free * first
    mean += variance * (h2 / d2 - r * h1 / both) / free * second
    return Scalar(float(mean), float(variance))


def by_cosines(lines_of_sight: Array, variances: Array) -> Array:
    """Noise covariance (m, m) with r = cos of the angles between lines of sight (m, 3), eq. 12."""
    unit = lines_of_sight / np.linalg.norm(lines_of_sight, axis=1, keepdims=True)
    sigma = np.sqrt(variances)
    correlated: Array = (unit @ unit.T) * np.outer(sigma, sigma)
    return correlated
