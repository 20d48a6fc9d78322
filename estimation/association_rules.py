"""Two rules to compare with: the paper's rule (3), coordinate by coordinate, and Mahalanobis'.

Each says of every pair yes or no; of the pairs accepted, the nearest are taken one to one.

Source: Klimov, paper 002, rule after eq. 3. H2 displaced by +-alpha has the likelihood ratio
exp(alpha^2 / 2 s^2) / (exp(alpha d / s^2) + exp(-alpha d / s^2)); the printed rule has a minus
between the exponentials, by which every d < 0 is accepted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike, Indices
from estimation.assignment import assignment
from estimation.consistency import nis


class Ruled(NamedTuple):
    """What a rule says of differences.

    Attributes:
        accepted: (...) whether it takes them for one target.
        status: `selective`, or why it accepts nothing at all.
    """

    accepted: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    status: str


class RuledPairs(NamedTuple):
    """One-to-one pairs among those a rule accepts."""

    own: Indices
    other: Indices
    status: str


def paper_rule(
    difference: ArrayLike, sigma: ArrayLike, displaced: ArrayLike, gamma: ArrayLike = 1.0
) -> Ruled:
    """The paper's rule (3) with its misprint corrected, for each component by itself.

    Args:
        difference: (..., r) of coordinates or parametric features.
        sigma: (..., r) one sigma of a difference of one target's.
        displaced: (r,) least difference of two targets: alpha of a coordinate, beta of a feature.
        gamma: (r,) threshold.
    """
    d, s = np.asarray(difference, dtype=float), np.asarray(sigma, dtype=float)
    apart, threshold = np.asarray(displaced, dtype=float), np.asarray(gamma, dtype=float)
    pull = np.abs(apart * d) / s**2
    left = pull + np.log1p(np.exp(-2.0 * pull))
    right = apart**2 / (2.0 * s**2) - np.log(threshold)
    blind = np.any(apart <= blind_below(threshold) * s, axis=-1)
    status = "accepts nothing: targets may be too near for these sigmas and threshold"
    return Ruled(np.all(left <= right, axis=-1), status if blind.all() else "selective")


def blind_below(gamma: ArrayLike) -> Array:
    """The displacement, in sigmas, up to which the paper's rule accepts nothing: sqrt(2 ln 2g)."""
    least: Array = np.sqrt(2.0 * np.log(np.maximum(2.0 * np.asarray(gamma, dtype=float), 1.0)))
    return least


def mahalanobis_rule(difference: ArrayLike, covariance: Array, gate: float) -> Ruled:
    """Accept where the normalised square of a difference (..., r) is within a chi-squared gate."""
    return Ruled(nis(difference, covariance) <= gate, "selective")


def ruled_pairs(
    own: Indices, other: Indices, difference: Array, covariance: Array, ruled: Ruled
) -> RuledPairs:
    """Of the accepted pairs (K,), the one-to-one set of most pairs and least squared distance."""
    distance2 = nis(difference, covariance)
    worst = float(distance2.max(initial=0.0))
    gain = np.where(ruled.accepted, 1.0 + len(own) * worst - distance2, 0.0)
    chosen = assignment(own, other, gain)
    return RuledPairs(own[chosen], other[chosen], ruled.status)
