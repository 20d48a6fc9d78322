"""Features in reports: which there are in a run, and what the logs of a report say of them.

A source reports a feature as it declares it, as a number or as a word; what it does not declare is
not used. Sigmas and confusions are those that have been learnt, where pairs have taught any.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices
from estimation.feature_learning import confusion_of, declared_reports
from estimation.features import UNSAID, common_confusion, every_category
from estimation.tracking import features
from estimation.tracking.features import Features, Layout, Said
from schemas.messages import FeatureColumn, FeatureInfo, SourceProperties, SourceReport

from ..state import Dictionary, Learned, Reports, State, Word

CLASS = "class"
"""Feature under which a source declares the classes it tells, and how it confuses them."""
MOST = 16
"""Numbers of a run, and words, the first by name; more are not used."""
MOST_CATEGORIES = 64
LEAST_SIGMA = 1e-4
"""Of a number, by the width of its population: no source is surer."""
BEYOND = 5.0
"""Sigmas out of its population at which a value is none."""
UNDECLARED_RIGHT = 0.8
"""Share of a source's words that are right where it declares no confusion."""
NOTHING_LEARNED = Learned()


class Heard(NamedTuple):
    """What the m logs of a report say of features.

    Attributes:
        said: as likelihoods.
        words: (F, m) category that each names, among the source's own; -1 = none.
    """

    said: Said
    words: NDArray[np.intp]


def dictionary(state: State) -> Dictionary:
    """The features that sources of the run declare, with all their categories."""
    carriers = {carrier.name for carrier in state.scenario.carriers} | set(state.carriers)
    declared = [
        (name, info)
        for carrier in sorted(carriers)
        for _, source in sorted(state.sources(carrier).items())
        for name, info in source.features.items()
        if name != CLASS
    ]
    numbers = sorted({name for name, info in declared if is_number(info)})
    told: dict[str, list[list[str]]] = {}
    for name, info in declared:
        if is_word(info):
            told.setdefault(name, []).append(info.categories)
    words = [Word(name, every_category(*told[name])[:MOST_CATEGORIES]) for name in sorted(told)]
    return Dictionary(tuple(numbers[:MOST]), tuple(words[:MOST]))


def is_number(info: FeatureInfo) -> bool:
    """Whether a feature is a number that can be weighed: its population must be declared."""
    return not info.categories and info.population is not None and _width(info) > 0


def is_word(info: FeatureInfo) -> bool:
    """Whether a feature is one of some words, two or more."""
    return len(set(info.categories)) > 1 and len(info.categories) <= MOST_CATEGORIES


def layout(known: Dictionary) -> Layout:
    """The rows of its features."""
    return Layout(len(known.numbers), tuple(len(word.categories) for word in known.words))


def fitted(old: Features, before: Dictionary, now: Dictionary) -> Features:
    """What is known of n tracks in the rows of another dictionary; nothing of what is new."""
    if before == now:
        return old
    n = old.shares.shape[-1]
    blank = features.unknown(layout(now), n)
    for row, name in enumerate(now.numbers):
        if name in before.numbers:
            for part, kept in zip(blank[:3], old[:3], strict=True):
                part[row] = kept[before.numbers.index(name)]
    for to, word in zip(rows(now), now.words, strict=True):
        if word in before.words:
            blank.shares[to] = old.shares[rows(before)[before.words.index(word)]]
    return blank


def rows(known: Dictionary) -> list[slice]:
    """Rows of the categories of each word."""
    ends = np.cumsum([0, *(len(word.categories) for word in known.words)]).tolist()
    return [slice(*ends[i : i + 2]) for i in range(len(known.words))]


def heard(
    report: SourceReport,
    which: Indices,
    source: SourceProperties,
    known: Dictionary,
    learned: Learned = NOTHING_LEARNED,
) -> Heard | None:
    """What some logs of a report say of features; None where that is nothing.

    Args:
        which: (m,) logs of the report.
        source: what its source declares.
        learned: of the source.
    """
    told = {name: c for name, c in report.features.items() if name in source.features}
    if not told or not which.size:
        return None
    here = which.tolist()
    value, variance = np.full((2, len(known.numbers), len(here)), np.nan)
    variance[:], width = 1.0, np.ones(len(known.numbers))
    for row, name in enumerate(known.numbers):
        if name in told and is_number(source.features[name]):
            info, scale = source.features[name], scale_of(learned, name)
            value[row], variance[row] = _numbers(told[name], here, info, scale)
            width[row] = _width(info)
    likelihood = np.ones((sum(len(word.categories) for word in known.words), len(here)))
    words = np.full((len(known.words), len(here)), UNSAID, dtype=np.intp)
    for row, (to, word) in enumerate(zip(rows(known), known.words, strict=True)):
        if word.name in told and is_word(source.features[word.name]):
            words[row] = _words(told[word.name], here, source.features[word.name])
            confusion = confusion_of(reports(learned, word, source.features[word.name]).count)
            likelihood[to] = _likelihood(confusion, words[row])
    if np.isnan(value).all() and (words == UNSAID).all():
        return None
    return Heard(Said(value, variance, likelihood, width, layout(known)), words)


def scale_of(learned: Learned, name: str) -> float:
    """Variance of a number over what its source states."""
    taught = learned.numbers.get(name)
    return taught.squares / taught.weight if taught else 1.0


def reports(learned: Learned, word: Word, info: FeatureInfo) -> Reports:
    """The reports of a word so far, or those that are as good as what its source declares."""
    own = tuple(info.categories)
    taught = learned.words.get(word.name)
    if taught and taught.truth == word.categories and taught.words == own:
        return taught
    confusion = common_confusion(word.categories, own, _declared_confusion(info))
    return Reports(truth=word.categories, words=own, count=declared_reports(confusion))


def _declared_confusion(info: FeatureInfo) -> Array:
    """(M, M) as declared, every row a distribution; the usual one where it is none."""
    size = len(info.categories)
    usual = np.full((size, size), (1.0 - UNDECLARED_RIGHT) / (size - 1))
    np.fill_diagonal(usual, UNDECLARED_RIGHT)
    if len(info.confusion) != size or any(len(row) != size for row in info.confusion):
        return usual
    given = np.maximum(np.array(info.confusion, dtype=float), 1e-6)
    return np.asarray(given / given.sum(axis=1, keepdims=True), dtype=float)


def _numbers(
    column: FeatureColumn, which: Sequence[int], info: FeatureInfo, scale: float
) -> tuple[Array, Array]:
    """Values and variances (m,) of a number; nan where it is missing or cannot be one."""
    least, greatest = info.population or (0.0, 0.0)
    value = _floats(column.values, which)
    sigma = _floats(column.sigmas or [None] * len(column.values), which)
    sigma = np.where(np.isnan(sigma), info.sigma or np.nan, sigma)
    sigma = np.maximum(sigma, LEAST_SIGMA * (greatest - least)) * np.sqrt(scale)
    out = (value < least - BEYOND * sigma) | (value > greatest + BEYOND * sigma)
    unsaid = out | np.isnan(sigma)
    return np.where(unsaid, np.nan, value), np.where(unsaid, 1.0, sigma**2)


def _floats(values: Sequence[float | str | None], which: Sequence[int]) -> Array:
    picked = (values[i] for i in which)
    return np.array([np.nan if isinstance(v, str | None) else v for v in picked], dtype=float)


def _words(column: FeatureColumn, which: Sequence[int], info: FeatureInfo) -> NDArray[np.intp]:
    """Categories (m,) that are named, among the source's own."""
    number = {name: i for i, name in enumerate(info.categories)}
    named: Iterable[float | str | None] = (column.values[i] for i in which)
    found = [number.get(v, UNSAID) if isinstance(v, str) else UNSAID for v in named]
    return np.array(found, dtype=np.intp)


def _likelihood(confusion: Array, named: NDArray[np.intp]) -> Array:
    """Likelihoods (K, m) of words, over those of a false plot; one in a thousand is plain wrong."""
    ratio = confusion / np.maximum(confusion.mean(axis=0), 1e-300)
    robust = features.WRONG + (1.0 - features.WRONG) * ratio
    return np.where(named == UNSAID, 1.0, robust[:, named])


def _width(info: FeatureInfo) -> float:
    least, greatest = info.population or (0.0, 0.0)
    return float(greatest - least)
