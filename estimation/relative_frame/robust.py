"""Adjustment when some pairs are wrong: a truncated loss, reached by degrees.

A pair costs min(chi2, c2), c2 = 13.8, the .999 quantile of its two degrees of freedom: a wrong
pair stops pulling. That loss has a minimum for every handful of pairs that agree by chance, so it
is approached from least squares, which has one: weights sharpen step by step (graduated
non-convexity) while the frame follows.

Source: Yang, Antonante, Tzoumas & Carlone, "Graduated non-convexity for robust spatial
perception", IEEE RA-L 5, 2020, eqs 12-14 (truncated least squares).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.relative_frame.adjustment import Registration, batch_of, registration, rigid_fit
from estimation.relative_frame.gauge import Gauge, gauge
from estimation.relative_frame.gauss_helmert import Measured, measured
from estimation.relative_frame.iteration import Solution, iterate
from estimation.relative_frame.logs import PolarLogs, RelativeFramePrior

TRUNCATION = 13.8
_SHARPER = 2.0  # each stage's factor of mu
_SHARP = 100.0  # mu from which the surrogate is the truncated loss
_STAGES = 40
_OUT = 1e-9  # weight of a pair that is out: it stays in the arrays and counts for nothing


class RobustRegistration(NamedTuple):
    """A registration and which pairs it rests on.

    Attributes:
        found: from the kept pairs; its `fixed.dof` and `fixed.pairs` count all.
        kept: (..., L) pairs whose chi2 is below the truncation.
        chi2: (...) of the kept pairs and the prior.
        dof: (...) 2 by kept pair.
    """

    found: Registration
    kept: NDArray[np.bool_]
    chi2: Array
    dof: NDArray[np.int_]


def robust_adjustment(
    own: PolarLogs,
    other: PolarLogs,
    prior: RelativeFramePrior,
    truncation: float = TRUNCATION,
) -> RobustRegistration:
    """`adjustment` of pairs of which a third or so may be wrong.

    Args:
        own: (..., L) logs in own axes.
        other: (..., L) logs of mostly the same targets in the other carrier's axes.
        prior: reported offset and the sigmas of it and of both norths.
        truncation: chi2 of a pair beyond which it is out.

    Raises:
        ValueError: own and other differ in length.
    """
    batch = batch_of(own, other, prior)
    given, navigation = measured(own, other, batch), gauge(prior, batch)
    ends = [
        _graduated(given, navigation, start, truncation)
        for start in (np.zeros((len(navigation.root), 4)), rigid_fit(given, navigation))
    ]
    costs = np.stack([_truncated_cost(end, weights, truncation) for end, weights in ends])
    second = costs[1] < costs[0] - 1e-6
    best = Solution(
        *(
            np.where(second.reshape(-1, *[1] * (a.ndim - 1)), b, a)
            for a, b in zip(ends[0][0], ends[1][0], strict=True)
        )
    )
    kept = np.where(second[:, None], ends[1][1], ends[0][1]) > 0.5
    chi2 = best.criterion
    return RobustRegistration(
        registration(best, navigation, prior, batch, own.count),
        kept.reshape(*batch, own.count),
        chi2.reshape(batch),
        2 * kept.sum(axis=1).reshape(batch),
    )


def _graduated(
    given: Measured, navigation: Gauge, start: Array, truncation: float
) -> tuple[Solution, Array]:
    """The end of the graduation and the weights (N, L), 1 or nearly 0."""
    weights = np.ones(given.range_m.shape[1:])
    end = iterate(given, navigation, start)
    chi2 = end.pair_chi2
    worst = chi2.max(axis=1, initial=0)
    mu = truncation / np.maximum(2 * worst - truncation, 1e-3 * truncation)
    for _ in range(_STAGES):
        sharp = _weights(chi2, mu[:, None], truncation)
        if np.array_equal(sharp, weights):
            break
        weights = sharp
        end = iterate(given.weighted(weights), navigation, end.z)
        chi2 = end.pair_chi2 / weights
        mu = np.where(mu < _SHARP, mu * _SHARPER, np.inf)
    return end, weights


def _weights(chi2: Array, mu: Array, truncation: float) -> Array:
    """Eq. 14: 1 for small residuals, 0 for large ones, in between the surrogate's slope."""
    with np.errstate(invalid="ignore", divide="ignore"):  # mu is infinite in the end
        between = np.sqrt(truncation * mu * (mu + 1) / chi2) - mu
    weights = np.where(chi2 <= truncation / (1 + 1 / mu), 1.0, between)
    weights = np.where(chi2 >= truncation * (1 + 1 / mu), 0.0, weights)
    return np.maximum(weights, _OUT)


def _truncated_cost(end: Solution, weights: Array, truncation: float) -> Array:
    """(N,) the loss itself."""
    pairs = np.minimum(end.pair_chi2 / weights, truncation).sum(axis=1)
    cost: Array = pairs + np.square(end.z).sum(axis=1)
    return cost
