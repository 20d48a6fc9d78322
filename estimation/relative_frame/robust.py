"""Adjustment when some pairs are wrong: a truncated loss, reached by degrees.

A pair costs min(chi2, c2), c2 = 13.8, the .999 quantile of its two degrees of freedom: a wrong
pair stops pulling. That loss has a minimum for every handful of pairs that agree by chance, so it
is approached from least squares, which has one: weights sharpen step by step (graduated
non-convexity) while the frame follows. Twice: from the pairs that the prior allows, and from all
of them, for a prior that is wrong itself; the lower loss is kept.

Source: Yang, Antonante, Tzoumas & Carlone, "Graduated non-convexity for robust spatial
perception", IEEE RA-L 5, 2020, eqs 12-14 (truncated least squares).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.consistency import nees
from estimation.relative_frame.adjustment import Registration, batch_of, registration, rigid_fit
from estimation.relative_frame.gauge import Gauge, gauge
from estimation.relative_frame.gauss_helmert import Measured, linearise, measured
from estimation.relative_frame.iteration import Solution, iterate
from estimation.relative_frame.logs import PolarLogs, RelativeFramePrior

TRUNCATION = 13.8
_SHARPER = 2.0  # each stage's factor of mu
_SHARP = 100.0  # mu from which the surrogate is the truncated loss
_STAGES = 40
_GATE = 25.0  # misclosure squared, in sigmas of pair and prior together


class RobustRegistration(NamedTuple):
    """A registration and which pairs it rests on.

    Attributes:
        found: from the kept pairs; its `fixed.dof` and `fixed.pairs` count all, its chi2 does not.
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
    everyone = np.ones(given.range_m.shape[1:], dtype=bool)
    nowhere = np.zeros((len(navigation.root), 4))
    ends = [
        _graduated(given, navigation, nowhere, _near_prior(given, navigation), truncation),
        _graduated(given, navigation, rigid_fit(given, navigation), everyone, truncation),
    ]
    costs = np.stack([_truncated_cost(end, truncation) for end, _ in ends])
    second = costs[1] < costs[0] - 1e-6
    best = Solution(
        *(
            np.where(second.reshape(-1, *[1] * (a.ndim - 1)), b, a)
            for a, b in zip(ends[0][0], ends[1][0], strict=True)
        )
    )
    kept = np.where(second[:, None], ends[1][1], ends[0][1]) > 0.5
    chi2 = np.where(kept, best.pair_chi2, 0.0).sum(axis=1) + np.square(best.z).sum(axis=1)
    found = registration(best, navigation, prior, batch, own.count)
    return RobustRegistration(
        found._replace(fixed=found.fixed._replace(chi2=chi2.reshape(batch))),
        kept.reshape(*batch, own.count),
        chi2.reshape(batch),
        2 * kept.sum(axis=1).reshape(batch),
    )


def _near_prior(given: Measured, navigation: Gauge) -> NDArray[np.bool_]:
    """Pairs (N, L) that the prior does not rule out: misclosure against S + H P0 H'."""
    point, tangent = navigation.at(np.zeros((len(navigation.root), 4)))
    white = linearise(given, np.zeros((2, *given.range_m.shape)), point).white
    rows = np.moveaxis(white, -1, 1)  # (N, L, 2, K + 1)
    by_z = rows[..., :-1] @ tangent[:, None]
    spread = np.eye(2) + by_z @ transposed(by_z)
    squared: Array = nees(rows[..., -1], spread)
    return squared < _GATE


def _graduated(
    given: Measured,
    navigation: Gauge,
    start: Array,
    admitted: NDArray[np.bool_],
    truncation: float,
) -> tuple[Solution, Array]:
    """The end of the graduation and the weights (N, L), 1 or 0.

    Pairs not `admitted` (N, L) stay out until the loss is sharp, and then may come back.
    """
    weights = np.where(admitted, 1.0, 0.0)
    end = iterate(given._replace(weights=weights), navigation, start)
    chi2 = end.pair_chi2
    worst = np.where(admitted, chi2, 0.0).max(axis=1, initial=0)
    mu = truncation / np.maximum(2 * worst - truncation, 1e-3 * truncation)
    for _ in range(_STAGES):
        gate = admitted | np.isinf(mu)[:, None]
        sharp = np.where(gate, _weights(chi2, mu[:, None], truncation), 0.0)
        on = np.flatnonzero((sharp != weights).any(axis=1) | np.isfinite(mu))
        if on.size == 0:
            break
        weights = sharp
        part = iterate(given.of(on)._replace(weights=weights[on]), navigation.of(on), end.z[on])
        for whole, fresh in zip(end, part, strict=True):
            whole[on] = fresh
        chi2 = end.pair_chi2
        mu = np.where(mu < _SHARP, mu * _SHARPER, np.inf)
    return end, weights


def _weights(chi2: Array, mu: Array, truncation: float) -> Array:
    """Eq. 14: 1 for small residuals, 0 for large ones, in between the surrogate's slope."""
    with np.errstate(invalid="ignore", divide="ignore"):  # mu is infinite in the end
        between = np.sqrt(truncation * mu * (mu + 1) / chi2) - mu
    weights = np.where(chi2 <= truncation / (1 + 1 / mu), 1.0, between)
    return np.where(chi2 >= truncation * (1 + 1 / mu), 0.0, weights)


def _truncated_cost(end: Solution, truncation: float) -> Array:
    """(N,) the loss itself."""
    pairs = np.minimum(end.pair_chi2, truncation).sum(axis=1)
    cost: Array = pairs + np.square(end.z).sum(axis=1)
    return cost
