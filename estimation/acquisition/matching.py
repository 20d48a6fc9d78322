"""One frame, every pair: the best assignment, and how much of the weight all others have."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from estimation.arrays import Array, Indices

_PASSES, _SETTLED = 30, 1e-6
_LARGEST = 300.0  # of a log ratio, so that its exponential is finite


class Pairs(NamedTuple):
    """K pairs, by increasing own index."""

    own: Indices
    other: Indices


def best_assignment(log_ratio: Array, bound: Indices) -> Pairs:
    """The pairs (i, j) of largest total log ratio (N1, N2); below zero they stay alone.

    Args:
        bound: (K, 2) pairs that are taken whatever their ratio.
    """
    gain = np.maximum(log_ratio, 0.0)
    gain[bound[:, 0], bound[:, 1]] = gain.sum() + 1.0
    own, other = linear_sum_assignment(gain, maximize=True)
    paired = gain[own, other] > 0
    return Pairs(own[paired], other[paired])


def all_assignments(log_ratio: Array) -> tuple[float, Array]:
    """Log of the sum over all partial assignments, and the probability of each pair (N1, N2).

    Bethe's approximation by belief propagation: exact where the allowed pairs form a tree, as
    they nearly do when a log has a rival or two.

    Source: Williams & Lau, Approximate evaluation of marginal association probabilities with
    belief propagation, IEEE Trans. AES 50(4), 2014.
    """
    psi = np.exp(np.minimum(log_ratio, _LARGEST))
    nu = np.ones_like(psi)
    mu = psi
    for _ in range(_PASSES):
        weighed = psi * nu
        mu = psi / (1.0 + weighed.sum(axis=1, keepdims=True) - weighed)
        before, nu = nu, 1.0 / (1.0 + mu.sum(axis=0, keepdims=True) - mu)
        if np.abs(nu - before).max() < _SETTLED:
            break
    weighed = psi * nu
    rows = 1.0 + weighed.sum(axis=1)
    total = np.log(rows).sum() + np.log1p(mu.sum(axis=0)).sum() - np.log1p(mu * nu).sum()
    return float(total), weighed / rows[:, None]
