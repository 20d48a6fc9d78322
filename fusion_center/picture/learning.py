"""What pairs teach of features: how unsure a source's numbers truly are, how it confuses words.

A pair counts when it is sure by all but the feature that it teaches. Who reports otherwise than
declared is believed as learnt, and named in `quality`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from estimation.arrays import Array, Indices
from estimation.feature_learning import (
    LearnedVariance,
    confusion_of,
    declared_variance,
    taught_reports,
    taught_scale,
)
from estimation.features import UNSAID
from estimation.tracking.features import Features, number_ratios, right, word_ratios
from estimation.tracking.tracker import Association, Picture
from schemas.messages import FeatureInfo, FeatureQuality, SourceProperties

from ..sources.features import CLASS, Heard, dictionary, fitted, is_number, is_word, reports, rows
from ..state import Dictionary, Learned, Reports, Scale, State, Word

SURE = 0.9
"""Probability by all else from which a pair teaches."""
WORTH = declared_variance(1.0)
"""What is declared of a sigma, as pairs."""
ENOUGH = 60.0
"""Pairs on which a verdict rests."""
FACTOR = 1.5
"""By which a sigma may be wrong before it is told."""
SHARE = 0.1
"""By which the share of right words may be."""
MOST_SCALE = 1e12
MOST_SURE = 1.0 - 1e-12


def with_dictionary(state: State) -> State:
    """The state whose tracks know all features that sources declare by now."""
    now = dictionary(state) if state.settings.features.enabled else Dictionary()
    drawn = state.picture
    if now == drawn.dictionary:
        return state
    picture = drawn.picture
    if picture is not None:
        known = fitted(picture.tracks.features, drawn.dictionary, now)
        picture = picture._replace(tracks=picture.tracks._replace(features=known))
    return replace(state, picture=replace(drawn, picture=picture, dictionary=now))


def taught(
    learned: Learned,
    before: Picture,
    heard: Heard,
    done: Association,
    known: Dictionary,
    source: SourceProperties,
    most: float,
) -> Learned:
    """What is known of a source's features after one more of its reports.

    Args:
        before: the picture that the report met.
        done: which of its plots were taken for which tracks.
        most: pairs remembered.
    """
    track = _rows(before, done)
    pairs = _Pairs(before.tracks.features, heard, track, done.plot, done.probability)
    numbers, words = dict(learned.numbers), dict(learned.words)
    for row, name in enumerate(known.numbers):
        if np.isfinite(heard.said.value[row]).any():
            numbers[name] = _scale(learned.numbers.get(name), pairs, row, most)
    for row, (block, word) in enumerate(zip(rows(known), known.words, strict=True)):
        if (heard.words[row] != UNSAID).any():
            so_far = reports(learned, word, source.features[word.name])
            sure = pairs.sure(word_ratios(*pairs.ends)[row])
            truth = pairs.known.shares[block, pairs.track[sure]].T
            count = taught_reports(so_far.count, truth, heard.words[row, pairs.plot[sure]])
            words[word.name] = _bounded(so_far, count, most)
    return Learned(numbers=numbers, words=words)


def taught_classes(
    learned: Learned,
    before: Picture,
    evidence: Array,
    named: NDArray[np.intp],
    done: Association,
    so_far: Reports,
    most: float,
) -> Learned:
    """What is known of a source after one more report of classes.

    Args:
        evidence: (classes, m) as the tracker had it.
        named: (m,) class that each plot names, among the source's own; -1 = none.
        so_far: its reports.
    """
    track = _rows(before, done)
    joint = before.tracks.classes[:, track] * evidence[:, done.plot]
    sure = _sure(np.clip(done.probability, 0.0, MOST_SURE), joint.sum(axis=0))
    truth = before.tracks.classes[:, track[sure]].T
    count = taught_reports(so_far.count, truth, named[done.plot[sure]])
    return replace(learned, words={**learned.words, CLASS: _bounded(so_far, count, most)})


def _rows(before: Picture, done: Association) -> Indices:
    """Rows of the tracks of all pairs."""
    order = np.argsort(before.tracks.identity, kind="stable")
    at = np.searchsorted(before.tracks.identity, done.identity, sorter=order)
    return np.asarray(order[at], dtype=np.intp)


def _bounded(so_far: Reports, count: Array, most: float) -> Reports:
    kept = np.minimum(1.0, most / count.sum(axis=1, keepdims=True))
    return replace(so_far, count=kept * count)


def _sure(probability: Array, ratio: Array) -> Indices:
    """Pairs that are sure but for one feature, whose likelihood ratio (k,) is given."""
    p = probability
    return np.flatnonzero(p > SURE * (p + (1.0 - p) * np.maximum(ratio, 1e-300)))


class _Pairs:
    """Pairs of tracks and plots, and how sure they are."""

    def __init__(
        self, known: Features, heard: Heard, track: Indices, plot: Indices, probability: Array
    ) -> None:
        self.known, self.said, self.track, self.plot = known, heard.said, track, plot
        self.ends = known, heard.said, track, plot
        self.probability = np.clip(probability, 0.0, MOST_SURE)

    def sure(self, ratio: Array) -> Indices:
        """Those that are sure but for one feature, whose likelihood ratio (k,) is given."""
        return _sure(self.probability, ratio)


def _scale(so_far: Scale | None, pairs: _Pairs, row: int, most: float) -> Scale:
    """The scale of a number's variance after some pairs."""
    before = LearnedVariance(so_far.weight, so_far.squares) if so_far else WORTH
    fits = right(*pairs.ends)[row] * pairs.probability
    sure = pairs.sure(number_ratios(*pairs.ends)[row])
    sure = sure[fits[sure] > 0]
    track, plot, said = pairs.track[sure], pairs.plot[sure], pairs.said
    scale = before.squares / before.weight
    after = taught_scale(
        before,
        said.value[row, plot] - pairs.known.mean[row, track],
        pairs.known.variance[row, track],
        said.variance[row, plot] / scale,
        fits[sure],
        most,
    )
    bounded = min(max(after.squares / after.weight, 1.0 / MOST_SCALE), MOST_SCALE)
    stated = np.nanmean(np.where(np.isnan(said.value[row]), np.nan, said.variance[row] / scale))
    return Scale(weight=after.weight, squares=bounded * after.weight, stated=float(np.sqrt(stated)))


def quality(learned: Learned, source: SourceProperties) -> dict[str, FeatureQuality]:
    """How well a source reports each of its features, declared and learnt."""
    told = {}
    for name, info in sorted(source.features.items()):
        if name in learned.numbers and is_number(info):
            told[name] = _of_number(learned.numbers[name])
        elif name in learned.words and is_word(info):
            told[name] = _of_word(learned.words[name], name, info)
    return told


def flags(found: Mapping[str, FeatureQuality]) -> Iterator[str]:
    """What is not as it is declared, as sentences; the figures are coarse so that they last."""
    for name, how in found.items():
        if how.pairs < ENOUGH:
            continue
        factor = how.learned_sigma / how.declared_sigma if how.declared_sigma else 1.0
        if not 1.0 / FACTOR < factor < FACTOR:
            yield f"{name} errs {factor:.2g} times as much as its sigma says"
        if abs(how.learned_right - how.declared_right) > SHARE:
            yield f"{name} is right in {how.learned_right:.1g}, not {how.declared_right:.2g}"


def _of_number(taught: Scale) -> FeatureQuality:
    factor = float(np.sqrt(taught.squares / taught.weight))
    return FeatureQuality(
        pairs=max(taught.weight - WORTH.weight, 0.0),
        declared_sigma=taught.stated,
        learned_sigma=factor * taught.stated,
    )


def _of_word(taught: Reports, name: str, info: FeatureInfo) -> FeatureQuality:
    """By the share of right words, where every category is as frequent."""
    declared = reports(Learned(), Word(name, taught.truth), info)
    return FeatureQuality(
        pairs=max(float(taught.count.sum() - declared.count.sum()), 0.0),
        declared_right=_right(declared),
        learned_right=_right(taught),
    )


def _right(taught: Reports) -> float:
    """Share of right reports over the categories that the source knows."""
    share = confusion_of(taught.count)
    own = [(i, taught.words.index(n)) for i, n in enumerate(taught.truth) if n in taught.words]
    return min(float(np.mean([share[at] for at in own])), 1.0)
