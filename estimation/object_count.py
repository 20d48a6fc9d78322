"""How many objects there are: a posterior, not the length of a list."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array

_TAIL_SIGMAS = 12.0  # of a Poisson number, beyond which nothing is left


class Count(NamedTuple):
    """A number of objects with one sigma."""

    mean: float
    sigma: float


def object_count(existence: Array, unseen: float = 0.0) -> Count:
    """Number of objects, each of the tracks (n,) existing with its probability.

    Args:
        existence: of each track, independent of the others.
        unseen: expected number of objects that have no track yet, Poisson.
    """
    variance = float(np.sum(existence * (1.0 - existence))) + unseen
    return Count(float(np.sum(existence)) + unseen, variance**0.5)


def count_of_pairs(own: int, other: int, probability: Array, seen: tuple[float, float]) -> Count:
    """Number of objects that two sides report, and of those that neither does.

    Each object is seen by either side by itself with its share; a pair is one object instead of
    two, as far as it is one.

    Args:
        own, other: numbers of logs, clutter taken out.
        probability: (K,) of the pairs being one object.
        seen: share of all objects that each side sees.
    """
    first, second = seen
    caught = first + second - first * second
    reported = own + other - float(np.sum(probability))
    unseen = reported * (1.0 - caught) / caught
    variance = float(np.sum(probability * (1.0 - probability))) / caught**2 + unseen / caught
    return Count(reported + unseen, variance**0.5)


def count_distribution(existence: Array, unseen: float = 0.0) -> Array:
    """Probability of 0, 1, 2, ... objects; the tracks' part is exact (Poisson-binomial)."""
    known = np.ones(1)
    for share in np.asarray(existence, dtype=float).tolist():
        known = np.convolve(known, [1.0 - share, share])
    most = int(np.ceil(unseen + _TAIL_SIGMAS * np.sqrt(unseen))) + 1 if unseen else 0
    number = np.arange(most + 1)
    log_factorial = np.concatenate([[0.0], np.cumsum(np.log(number[1:]))])
    poisson = np.exp(number * np.log(unseen) - unseen - log_factorial) if unseen else np.ones(1)
    whole = np.convolve(known, poisson)
    return np.asarray(whole / whole.sum(), dtype=float)
