"""Features of tracks: what is known of each, what a plot says, and what both are worth together.

A number, such as a length, is known by its mean and variance, or not at all; a word, such as the
kind of an emitter, by the probability of each category. A value that is missing says nothing. One
in a thousand is plain wrong, so that no feature can forbid a pair; what was said long ago fades.

Source: Klimov, paper 002, eq. 3; the density of two targets is the population's
(`estimation.features`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices

WRONG = 1e-3
"""Share of values that have nothing to do with their target."""
_FADES = 1.0 + 1.0 / 15.0  # of a variance at each value: sixteen of them are remembered
_SCALES = (1.0, 4.0, 16.0)  # of the variance between two sources, as likely each
_LEAST_SHARE = 1e-3  # of a category, however often others were named


class Layout(NamedTuple):
    """Which features there are; the same in all steps of a picture.

    Attributes:
        numbers: how many; P of them.
        sizes: how many categories each of the F words has; R together.
    """

    numbers: int = 0
    sizes: tuple[int, ...] = ()

    @property
    def begins(self) -> Indices:
        """(F,) first row of each word among the R."""
        return np.cumsum((0, *self.sizes), dtype=np.intp)[:-1]

    @property
    def evenly(self) -> Array:
        """(R, 1) every category of a word as likely."""
        return np.repeat([1.0 / size for size in self.sizes], self.sizes)[:, None]


class Features(NamedTuple):
    """What is known of the features of n tracks.

    Attributes:
        unsaid: (P, n) probability that nothing is known of a number.
        mean, variance: (P, n) of the number if something is.
        shares: (R, n) probabilities of the categories, word after word.
    """

    unsaid: Array
    mean: Array
    variance: Array
    shares: Array

    def take(self, which: Indices) -> Features:
        """Those of the tracks `which`, in that order."""
        return Features(*(part.take(which, axis=-1) for part in self))


class Said(NamedTuple):
    """What m plots say of features.

    Attributes:
        value, variance: (P, m) of the numbers; a value is nan where nothing is said.
        likelihood: (R, m) of the word that is said if the target is of a category, over that of a
            false plot; 1 where nothing is said.
        width: (P,) of the population of each number as the source has it, greatest less least.
        layout: of the rows.
    """

    value: Array
    variance: Array
    likelihood: Array
    width: Array
    layout: Layout


def unknown(layout: Layout, tracks: int) -> Features:
    """Nothing known of any track."""
    blank = (layout.numbers, tracks)
    return Features(
        np.ones(blank), np.zeros(blank), np.ones(blank), np.repeat(layout.evenly, tracks, axis=-1)
    )


def joined(*known: Features) -> Features:
    """Those of all, in order."""
    parts = zip(*known, strict=True)
    return Features(*(np.concatenate(part, axis=-1) for part in parts))


def number_ratios(known: Features, said: Said, track: Indices, plot: Indices) -> Array:
    """Likelihood ratios (P, k) of pairs by each number: one target over two."""
    unsaid = known.unsaid[:, track]
    density = _density(known, said, track, plot)
    ratio = WRONG + (1.0 - WRONG) * (unsaid + (1.0 - unsaid) * density)
    return np.where(np.isnan(said.value[:, plot]), 1.0, ratio)


def word_ratios(known: Features, said: Said, track: Indices, plot: Indices) -> Array:
    """Likelihood ratios (F, k) of pairs by each word."""
    return _by_word(known.shares[:, track] * said.likelihood[:, plot], said.layout)


def ratio(known: Features, said: Said, track: Indices, plot: Indices) -> Array:
    """Likelihood ratio (k,) of pairs by all features."""
    numbers = number_ratios(known, said, track, plot).prod(axis=0)
    return np.asarray(numbers * word_ratios(known, said, track, plot).prod(axis=0), dtype=float)


def after(known: Features, said: Said, track: Indices, plot: Indices) -> Features:
    """What would be known of the track of each pair (k,) if its plot is of that target."""
    numbers, layout = _numbers_after(known, said, track, plot), said.layout
    before, likelihood = known.shares[:, track], said.likelihood[:, plot]
    joint = before * likelihood
    total = np.repeat(np.maximum(_by_word(joint, layout), 1e-300), layout.sizes, axis=0)
    shares = joint / total
    shares += _LEAST_SHARE * (layout.evenly - shares)
    heard = _by_word((likelihood != 1.0).astype(float), layout) > 0
    heard = np.repeat(heard, layout.sizes, axis=0)
    return Features(*numbers, np.where(heard, shares, before))


def folded(
    known: Features, told: Features, track: Indices, share: Array, sums: Callable[[Array], Array]
) -> Features:
    """First two moments over the hypotheses of each track: a miss, and each of its pairs.

    Args:
        known: of the n tracks before.
        told: of the k pairs, as `after` has them.
        track: (k,) of each pair.
        share: (k,) probability of each pair, the rest of a track's is of a miss.
        sums: (..., k) by pair to (..., n) by track.
    """
    stay = 1.0 - sums(share)
    unsaid = known.unsaid * stay + sums(told.unsaid * share)
    heard, before = (1.0 - told.unsaid) * share, (1.0 - known.unsaid) * stay
    whole = sums(heard) + before
    total = np.where(whole > 0, whole, 1.0)
    apart = told.mean - known.mean[:, track]
    lean = sums(heard * apart) / total
    spread = sums(heard * (told.variance + apart**2)) + before * known.variance
    variance = np.where(whole > 0, spread / total - lean**2, known.variance)
    shares = known.shares * stay + sums(told.shares * share)
    return Features(np.clip(unsaid, 0.0, 1.0), known.mean + lean, variance, shares)


def right(known: Features, said: Said, track: Indices, plot: Indices) -> Array:
    """Probability (P, k) that a number was known and its value has to do with it, in each pair."""
    unsaid = known.unsaid[:, track]
    both = (1.0 - unsaid) * (1.0 - WRONG) * _density(known, said, track, plot)
    ratio = number_ratios(known, said, track, plot)
    return np.where(np.isnan(said.value[:, plot]), 0.0, both / ratio)


def agreement(
    one: Features, other: Features, width: Array, layout: Layout, i: Indices, j: Indices
) -> Array:
    """Log-likelihood ratio (k,) that tracks i of one side and j of another are of one target.

    Two sources may mean a little different things by one name, or err alike from value to value:
    how much their means differ is known to a factor only.

    Args:
        width: (P,) of the population of each number.
    """
    apart = one.mean[:, i] - other.mean[:, j]
    spread = one.variance[:, i] + other.variance[:, j]
    density = sum(_normal(apart, scale * spread) for scale in _SCALES) * width[:, None]
    density /= len(_SCALES)
    known = (1.0 - one.unsaid[:, i]) * (1.0 - other.unsaid[:, j])
    numbers = WRONG + (1.0 - WRONG) * (1.0 - known + known * density)
    joint = one.shares[:, i] * other.shares[:, j] / layout.evenly
    words = WRONG + (1.0 - WRONG) * _by_word(joint, layout)
    logarithm: Array = np.log(numbers).sum(axis=0) + np.log(words).sum(axis=0)
    return logarithm


def _numbers_after(
    known: Features, said: Said, track: Indices, plot: Indices
) -> tuple[Array, Array, Array]:
    """Unsaid, mean and variance (P, k): the value is wrong or right, the number known or not."""
    unsaid, mean = known.unsaid[:, track], known.mean[:, track]
    value, noise = said.value[:, plot], said.variance[:, plot]
    wide = known.variance[:, track] * _FADES
    gain = wide / (wide + noise)
    first, kept = unsaid * (1.0 - WRONG), (1.0 - unsaid) * WRONG
    both = (1.0 - unsaid) * (1.0 - WRONG) * _density(known, said, track, plot)
    total = first + kept + both
    apart, lean = value - mean, (first + both * gain) / total
    spread = (first * noise + (kept + both * (1.0 - gain)) * wide) / total
    spread += apart**2 * np.maximum((first + both * gain**2) / total - lean**2, 0.0)
    heard = np.isfinite(value)
    return (
        np.where(heard, unsaid * WRONG / (total + unsaid * WRONG), unsaid),
        np.where(heard, mean + lean * apart, mean),
        np.where(heard, spread, known.variance[:, track]),
    )


def _density(known: Features, said: Said, track: Indices, plot: Indices) -> Array:
    """Density (P, k) of each value if it is of the track, over the population's."""
    spread = known.variance[:, track] * _FADES + said.variance[:, plot]
    return _normal(said.value[:, plot] - known.mean[:, track], spread) * said.width[:, None]


def _normal(apart: Array, variance: Array) -> Array:
    density: Array = np.exp(-0.5 * apart**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    return density


def _by_word(joint: Array, layout: Layout) -> Array:
    """Sums (F, k) over the categories of each word of (R, k)."""
    if not layout.sizes:
        return np.empty((0, joint.shape[-1]))
    return np.asarray(np.add.reduceat(joint, layout.begins, axis=0), dtype=float)
