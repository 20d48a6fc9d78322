"""Gross errors: losses that bear them, begun from the subset of bearings that agrees best."""

from __future__ import annotations

from functools import partial

import numpy as np

from estimation.arrays import Array
from estimation.bearings_only.criterion import Criterion, criterion
from estimation.bearings_only.levenberg_marquardt import minimised
from estimation.bearings_only.measurements import Scene
from estimation.bearings_only.motions import CONSTANT_ACCELERATION
from estimation.bearings_only.normal_equations import Loss, residuals
from estimation.bearings_only.starts import lines_of, taubin

_SUBSETS, _SHARE = 30, 0.3
_GOLDEN = 0.6180339887498949
_GROSS = 6.0  # sigmas, or of the spread where the polynomial does not fit
_MAD = 1.4826  # sigma of a Gaussian by the median of its absolute values
_KEPT_SQUARED = 16.0
_KEPT_SHARE = 0.7
_SMALL = 1e-300


def student_t(dof: float = 4.0) -> Loss:
    """The loss of errors with Student's distribution: (dof + 1) log(1 + r^2 / dof).

    All errors are then spread wider than their sigmas say, so of Gaussian ones among which some
    are gross the intervals are too wide: those want `gross_errors`.
    """
    return partial(_student_t, dof)


def gross_errors(share: float = 0.05) -> Loss:
    """The loss of Gaussian errors, of which a share are gross: any direction is as likely.

    With g = share / (1 - share) sqrt(2 pi) sigma / (2 pi), the odds of a gross error where a
    Gaussian one is likeliest, the cost is -2 log((exp(-r^2 / 2) + g) / (1 + g)), and the weight is
    the probability that the bearing is none.

    Raises:
        ValueError: the share is not between 0 and 1.

    Source: D. Hogg, J. Bovy & D. Lang, arXiv:1008.4686 (2010), section 3.
    """
    if not 0 < share < 1:
        raise ValueError(f"need a share of gross errors between 0 and 1, got {share}")
    return partial(_gross_errors, share / (1 - share) / np.sqrt(2 * np.pi))


def _gross_errors(odds: float, squared: Array, by_sigma: Array) -> tuple[Array, Array]:
    gross = odds * (by_sigma > 0) / np.maximum(by_sigma, _SMALL)
    good = np.exp(-squared / 2)
    return -2 * np.log((good + gross) / (1 + gross)), good / (good + gross)


def borne(problem: Criterion) -> Criterion:
    """The criterion by which a search begins: a loss that also draws from far away.

    What `gross_errors` takes for one pulls no more, so far from the minimum nothing does.
    """
    return problem._replace(loss=student_t()) if problem.loss else problem


def _student_t(dof: float, squared: Array, _by_sigma: Array) -> tuple[Array, Array]:
    return (dof + 1) * np.log1p(squared / dof), (dof + 1) / (dof + squared)


def screened(scene: Scene, loss: Loss | None) -> Scene:
    """The scene without gross errors, to begin a search in; the search itself has all bearings.

    Constant acceleration is fitted in closed form to thirty subsets of a third of the bearings;
    the fit with the least loss is improved, and what is far from it is left out.
    """
    if loss is None:
        return scene
    motion = CONSTANT_ACCELERATION
    problem = criterion(scene, motion, loss=student_t())
    parts = scene.take(np.tile(np.arange(scene.targets), _SUBSETS))
    masks = np.repeat(_subsets(len(scene.weight)), scene.targets, axis=1)
    parts = parts._replace(weight=parts.weight * masks)
    starts = taubin(lines_of(parts, motion, np.zeros((0, 1, 1))))
    wide = problem.take(np.tile(np.arange(scene.targets), _SUBSETS))
    cost = wide.evaluate(wide.admissible(starts)).cost.reshape(_SUBSETS, -1)
    best = np.nan_to_num(cost, nan=np.inf).argmin(axis=0) * scene.targets + np.arange(scene.targets)
    end = minimised(problem, starts[:, best])
    far = np.abs(residuals(scene, motion, end.p)[0])
    spread = np.maximum(_MAD * np.median(far, axis=0), 1.0)
    return scene._replace(weight=np.where(far < _GROSS * spread, scene.weight, 0.0))


def _subsets(count: int) -> Array:
    """Masks (N, S): each an evenly scattered part of the bearings."""
    i, k = np.arange(count)[:, None] + 0.5, np.arange(_SUBSETS) + 1.0
    scattered = np.modf(i * np.modf(_GOLDEN * k)[0] + k * _GOLDEN**2)[0]
    masks: Array = (scattered < _SHARE).astype(float)
    return masks


def kept(residual: Array, weight: Array) -> tuple[Array, Array]:
    """Chi-squared (B,) of the bearings that are no gross errors, and their number.

    A motion that calls more than 30 % of the bearings gross errors explains nothing: its
    chi-squared is that of all.

    Args:
        residual: (N, B) standardised.
        weight: (N, B); 0 = not seen.
    """
    squared, seen = residual**2, weight > 0
    good = seen & (squared < _KEPT_SQUARED)
    enough = good.sum(axis=0) >= _KEPT_SHARE * seen.sum(axis=0)
    chosen = np.where(enough, good, seen)
    return (squared * chosen).sum(axis=0), chosen.sum(axis=0).astype(float)
