"""Does a covariance tell the truth? Normalised errors and the interval they should fall in."""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array, ArrayLike


def nees(error: ArrayLike, covariance: Array) -> Array:
    """Normalised estimation error squared, e' P^-1 e; its mean is n when P is honest.

    Args:
        error: (..., n) estimate minus truth; angles already wrapped.
        covariance: (..., n, n) stated by the estimator.

    Returns:
        (...) chi-squared of n degrees of freedom when the errors are Gaussian.
    """
    column = np.asarray(error, dtype=float)[..., None]
    squared: Array = np.sum(column * np.linalg.solve(covariance, column), axis=(-2, -1))
    return squared


def nis(innovation: ArrayLike, covariance: Array) -> Array:
    """Normalised innovation squared (...): `nees` of measured minus predicted (..., n)."""
    return nees(innovation, covariance)


def mean_interval(dof: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Where the mean over `runs` of a chi-squared of `dof`, divided by `dof`, falls.

    Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and
    Navigation, section 5.4.2.
    """
    from scipy import stats  # noqa: PLC0415  (0.4 s that most importers of this module never need)

    low, high = stats.chi2(dof * runs).interval(confidence)
    return float(low) / (dof * runs), float(high) / (dof * runs)


def rms(errors: ArrayLike, axis: int | tuple[int, ...] | None = None) -> Array:
    """Root mean square over `axis` (default all); of vectors, sum their squares first."""
    root: Array = np.sqrt(np.mean(np.square(errors), axis=axis))
    return root
