"""The paper's own method, a labelled baseline: least squares of the constants alone.

Dead reckoning is taken as exact, every range alike, no prior. Source: Grinyak et al., eqs 10, 12,
14, 15, iterated from the prior values (Gauss-Newton without damping, as the paper has it).
"""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array
from estimation.bordered import Factored, Solution
from estimation.system_alignment.model import Model, predicted_ranges
from estimation.system_alignment.parameters import HEADING_BIAS, SPEED_SCALE, WIND

_ITERATIONS = 30
_STILL_M = 1e-3


def least_squares(model: Model, free: Array) -> Solution:
    """Gauss-Newton from `free`; `converged` is False where it ran away."""
    converged, steps = False, 0
    design, residual = _design(model, free)
    while not converged and steps < _ITERATIONS:
        step, *_ = np.linalg.lstsq(design, -residual, rcond=None)
        free, steps = free + step, steps + 1
        design, residual = _design(model, free)
        converged = bool(np.abs(step).max() < _STILL_M)
        if not np.all(np.isfinite(residual)):
            break
    x = model.dead_reckoned(free)
    dof = max(len(residual) - len(free), 1)
    variance = float(residual @ residual) / dof
    information = design.T @ design / variance + _ridge(design)
    nothing = np.zeros((x.size, len(free)))
    factored = Factored(np.ones((2 * model.block, x.size)), nothing, information)
    return Solution(x, free, factored, float(residual @ residual), converged, steps)


def _design(model: Model, free: Array) -> tuple[Array, Array]:
    """Derivatives (m, T) of all ranges by the free constants, path included, and residuals."""
    theta, path, at = model.theta(free), model.path, model.logs.epoch
    x = model.dead_reckoned(free)
    time_s = path.time_s
    value, by_place, by_theta = predicted_ranges(theta, model.logs, model.places(x), time_s[at])
    by_theta[:, WIND] += by_place * time_s[at, None]
    reckoned = (x[:, :2] - path.start_m - theta[WIND] * time_s[:, None])[at]
    by_theta[:, SPEED_SCALE] += np.sum(by_place * reckoned, axis=1) / (1 + theta[SPEED_SCALE])
    aside = np.column_stack([reckoned[:, 1], -reckoned[:, 0]])
    by_theta[:, HEADING_BIAS] += np.sum(by_place * aside, axis=1)
    return by_theta[:, model.prior.free], value - model.logs.value_m


def _ridge(design: Array) -> Array:
    """A little of each constant's scale, so that a degenerate case still has a covariance."""
    scale = np.sum(design**2, axis=0)
    return np.diag(1e-12 * np.maximum(scale, 1e-12))
