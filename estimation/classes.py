"""Which class a target is of: Bayes over all that sources say, as far as each may be believed.

Every report becomes a row of likelihoods, one a class: a confusion matrix is data, a coarse report
is a likelihood over a set, a source that has proved nothing is discounted towards saying nothing,
and a report that only repeats another is left out (`estimation.ledger`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike, Indices

TRUST = np.linspace(0.0, 1.0, 51)
"""Shares of a source's reports that may be what it claims; the others say nothing of the target."""

_TINY = float(np.finfo(float).tiny)
_LEAST = 1e-6  # of a likelihood, by the largest of its row: nobody is infallible


def unproven(sources: int) -> Array:
    """Trust in sources of which nothing is known yet: (S, G) probability of each of `TRUST`.

    Most deserve it and nobody is sure to: a share of .8 on the average.
    """
    weight = TRUST**3
    return np.tile(weight / weight.sum(), (sources, 1))


def expected_trust(trust: Array) -> Array:
    """The share (S,) of each source's reports that are what it claims."""
    return np.asarray(trust @ TRUST, dtype=float)


def by_confusion(confusion: Array, said: Indices) -> Array:
    """Likelihoods (n, K) of reports of a source with a confusion (K, M), by category said (n,)."""
    return np.asarray(confusion.T[said], dtype=float)


def by_set(members: NDArray[np.bool_], confidence: ArrayLike) -> Array:
    """Likelihoods (n, K) of coarse reports: the class is one of a set, with a confidence.

    The source is right as often as it says and tells no class of a set from another. A set of all
    classes, or of none, says nothing.

    Args:
        members: (n, K).
        confidence: (n,) probability that the set holds the class.
    """
    confident = np.broadcast_to(np.asarray(confidence, dtype=float), len(members))[:, None]
    size = members.sum(axis=1, keepdims=True)
    outside = members.shape[1] - size
    inner, outer = confident / np.maximum(size, 1), (1.0 - confident) / np.maximum(outside, 1)
    return np.where((size == 0) | (outside == 0), 1.0, np.where(members, inner, outer))


def discounted(likelihood: Array, trust: ArrayLike) -> Array:
    """Likelihoods (n, K) of reports that are what they claim with probability `trust` (n,).

    Otherwise the report has nothing to do with the target, and all classes are alike to it.
    """
    share = np.broadcast_to(np.asarray(trust, dtype=float), len(likelihood))[:, None]
    mixed: Array = share * likelihood + (1.0 - share) * likelihood.mean(axis=1, keepdims=True)
    return mixed


def class_posterior(prior: Array, target: Indices, likelihood: Array) -> Array:
    """Posterior (N, K) of targets after independent reports.

    Args:
        prior: (N, K), such as the posterior so far.
        target: (n,) row of the target that each report is of.
        likelihood: (n, K).
    """
    log = np.log(np.maximum(prior, _TINY))
    floor = _LEAST * likelihood.max(axis=1, keepdims=True, initial=_TINY)
    np.add.at(log, target, np.log(np.maximum(likelihood, floor)))
    posterior = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(posterior / posterior.sum(axis=1, keepdims=True), dtype=float)


def without_each(posterior: Array, target: Indices, likelihood: Array) -> Array:
    """For each report (n,), the posterior (n, K) of its target as all others have it."""
    floor = _LEAST * likelihood.max(axis=1, keepdims=True, initial=_TINY)
    others = posterior[target] / np.maximum(likelihood, floor)
    return np.asarray(others / others.sum(axis=1, keepdims=True), dtype=float)


def taught_trust(
    trust: Array, source: Indices, likelihood: Array, others: Array, forgetting: float = 1.0
) -> Array:
    """Trust (S, G) after reports, by how well they fit what all others say.

    Args:
        trust: so far.
        source: (n,) row of each report's source.
        likelihood: (n, K) of the reports as claimed.
        others: (n, K) class probabilities without the report (`without_each`).
        forgetting: share of what was proved that is kept; below 1 a source may change.
    """
    claimed = np.sum(likelihood * others, axis=1, keepdims=True)
    chance = likelihood.mean(axis=1, keepdims=True)
    log = forgetting * np.log(np.maximum(trust, _TINY))
    np.add.at(log, source, np.log(np.maximum(TRUST * claimed + (1.0 - TRUST) * chance, _TINY)))
    after = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(after / after.sum(axis=1, keepdims=True), dtype=float)


def log_loss(posterior: Array, truth: Indices) -> float:
    """Mean of -ln p(true class), classes (N,) against a posterior (N, K); sure and wrong = inf."""
    given = posterior[np.arange(len(truth)), truth]
    with np.errstate(divide="ignore"):
        return float(-np.mean(np.log(given)))
