"""What features say of two logs being one target: parametric, behavioural, declared or learned.

A log-likelihood ratio of a feature is log p(both values | one target) - log p(both | two targets).
A value that is missing, or a feature only one source knows, says nothing: its ratio is 0.

Source: Klimov, paper 002, eq. 3. There |dx| <= beta for one target touches |dx| > beta for two, so
that no density of the second exists; here it is the population's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from estimation.arrays import Array, ArrayLike, Indices

UNSAID = -1
"""The category of a log that names none."""

_FAR = 1e6  # sigmas, beyond which nothing changes
_WRONG = 1e-3  # share of values that have nothing to do with their target


class Parametric(NamedTuple):
    """A property with a number, such as a length, as two sources report it.

    Attributes:
        name: under which both dictionaries have it.
        least, greatest: of all targets.
        variance: of the difference of the two reports of one target, but for `tolerance`.
        tolerance: by which the two may differ by definition (beta), such as length over all and
            length of the waterline; 0 = they mean the same.
        wrong: share of the pairs of reports of which one has nothing to do with the target.
    """

    name: str
    least: float
    greatest: float
    variance: float
    tolerance: float = 0.0
    wrong: float = _WRONG


class Behavioural(NamedTuple):
    """A feature with categories, such as a manner of motion or a class, as two sources report it.

    Attributes:
        name: under which both dictionaries have it.
        population: (K,) share of each category among all targets.
        own, other: (K, M1) and (K, M2) confusion: row k = probabilities of the reports when k is
            true. The two may report in words of their own.
    """

    name: str
    population: Array
    own: Array
    other: Array


class Declared(NamedTuple):
    """An entry of a source's feature dictionary: a number with a sigma, or a word of a list.

    Attributes:
        name: what two sources mean by the same name is the same.
        sigma: of a number; nan for words.
        least, greatest: of a number, over all targets.
        categories: the words; empty for a number.
        confusion: (M, M) row i = probabilities of each word when i is true; None for a number.
    """

    name: str
    sigma: float = float("nan")
    least: float = float("nan")
    greatest: float = float("nan")
    categories: tuple[str, ...] = ()
    confusion: Array | None = None


def shared(
    own: Sequence[Declared], other: Sequence[Declared]
) -> tuple[list[Parametric], list[Behavioural]]:
    """What two dictionaries have in common; what one alone knows, or means otherwise, is left out.

    Numbers may range as widely as either source says. Words need not agree: each is compared by
    what it says of the categories of both.
    """
    named = {entry.name: entry for entry in other}
    both = [(entry, named[entry.name]) for entry in own if entry.name in named]
    parametric = [_parametric(a, b) for a, b in both if a.sigma + b.sigma > 0]
    return parametric, [_behavioural(a, b) for a, b in both if a.categories and b.categories]


def parametric_log_ratio(
    feature: Parametric, own: ArrayLike, other: ArrayLike, variance: ArrayLike | None = None
) -> Array:
    """Log-likelihood ratio of values that are compared one to one; nan in either says nothing.

    One target: uniform on [-beta, beta] convolved with the noise; two targets: the population.

    Args:
        feature: what it is.
        own, other: (...) values.
        variance: (...) of each difference, where the logs bring sigmas; default the feature's.
    """
    difference = np.asarray(own, dtype=float) - np.asarray(other, dtype=float)
    unsaid = np.isnan(difference)
    sigma = np.sqrt(np.asarray(feature.variance if variance is None else variance, dtype=float))
    blurred = _log_blurred_uniform(np.where(unsaid, 0.0, difference), sigma, feature.tolerance)
    alike = np.log1p(-feature.wrong) + np.log(feature.greatest - feature.least) + blurred
    return np.where(unsaid, 0.0, np.logaddexp(alike, np.log(feature.wrong)))


def behavioural_log_ratio(feature: Behavioural, own: Indices, other: Indices) -> Array:
    """Log-likelihood ratio (...) of reported categories; -1 in either says nothing."""
    apart = (feature.population @ feature.own)[:, None] * (feature.population @ feature.other)
    together = (feature.own * feature.population[:, None]).T @ feature.other
    ratio = np.log(np.maximum(together, _WRONG * apart)) - np.log(apart)
    unsaid = (own == UNSAID) | (other == UNSAID)
    return np.where(unsaid, 0.0, ratio[own, other])


def common_confusion(
    truth: Sequence[str], categories: Sequence[str], confusion: ArrayLike
) -> Array:
    """A source's confusion (K, M) over the categories of everyone, such as `every_category`.

    Of a category that it does not know, its reports say nothing: they are as likely as they are
    on the average of those it knows.

    Args:
        truth: K names.
        categories: the source's own M names.
        confusion: (M, M) row i = probabilities of reporting each when i is true.
    """
    known = np.asarray(confusion, dtype=float)
    rows = np.broadcast_to(known.mean(axis=0), (len(truth), len(categories))).copy()
    for row, name in enumerate(truth):
        if name in categories:
            rows[row] = known[categories.index(name)]
    return rows


def every_category(*dictionaries: Sequence[str]) -> tuple[str, ...]:
    """The categories of several dictionaries, each once, in the order of their first mention."""
    return tuple(dict.fromkeys(name for names in dictionaries for name in names))


def _parametric(own: Declared, other: Declared) -> Parametric:
    return Parametric(
        own.name,
        min(own.least, other.least),
        max(own.greatest, other.greatest),
        own.sigma**2 + other.sigma**2,
    )


def _behavioural(own: Declared, other: Declared) -> Behavioural:
    truth = every_category(own.categories, other.categories)
    rows = [
        common_confusion(truth, entry.categories, np.asarray(entry.confusion))
        for entry in (own, other)
    ]
    return Behavioural(own.name, np.full(len(truth), 1.0 / len(truth)), *rows)


def _log_blurred_uniform(difference: Array, sigma: Array, half: float) -> Array:
    """Log density of uniform on [-half, half] plus noise; `half` = 0: of the noise alone."""
    ratio = np.minimum(np.abs(difference) / sigma, _FAR)
    if half == 0:
        return np.asarray(-0.5 * (ratio**2 + np.log(2 * np.pi)) - np.log(sigma), dtype=float)
    outer = log_ndtr(half / sigma - ratio)
    inner = log_ndtr(-half / sigma - ratio)
    return np.asarray(outer + np.log(-np.expm1(inner - outer)) - np.log(2 * half), dtype=float)
