"""Feature sigmas and confusions as confident pairs teach them, one report after another.

What a source declares is where it begins, worth some pairs or reports; a wrong sigma costs more
than the choice of the rule of association.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from estimation.arrays import Array, Indices
from estimation.features import UNSAID, Parametric, parametric_log_ratio

_STRENGTH = 8.0  # of a declared sigma, in pairs; of a declared confusion, in reports a row


class LearnedVariance(NamedTuple):
    """What confident pairs have taught of the variance of a feature's difference.

    Attributes:
        weight: pairs it rests on, those of the declared value included.
        squares: sum of their squared differences.
    """

    weight: float
    squares: float


def declared_variance(variance: float, strength: float = _STRENGTH) -> LearnedVariance:
    """The variance a source declares, worth as much as `strength` confident pairs."""
    return LearnedVariance(strength, strength * variance)


def taught_variance(
    learned: LearnedVariance,
    feature: Parametric,
    difference: Array,
    probability: Array,
    forgetting: float = 1.0,
) -> LearnedVariance:
    """What pairs add to what is known of the variance of a feature's difference.

    A pair counts as far as it is one target, by all else that is known of it and by how well the
    difference fits: pairs chosen by agreement of this very feature would only teach what was
    believed before.

    Args:
        learned: so far.
        feature: with the variance in use now.
        difference: (n,) own less other value; nan is passed over.
        probability: (n,) that it is one target, by all but this feature.
        forgetting: share of what was known that is kept; below 1 a variance may change.
    """
    said = np.isfinite(difference)
    values, prior = difference[said], probability[said]
    with np.errstate(divide="ignore"):
        odds = np.log(prior) - np.log1p(-prior)
    alike = 1.0 - feature.wrong * np.exp(-parametric_log_ratio(feature, values, 0.0))
    weight = alike / (1.0 + np.exp(-odds - parametric_log_ratio(feature, values, 0.0)))
    return LearnedVariance(
        forgetting * learned.weight + float(weight.sum()),
        forgetting * learned.squares + float(weight @ values**2),
    )


def taught_scale(
    learned: LearnedVariance,
    apart: Array,
    known_variance: Array,
    stated_variance: Array,
    weight: Array,
    most: float,
) -> LearnedVariance:
    """What values teach of the scale of a source's variance: what it truly is over what it states.

    The noise behind a value is told from what was not known of the target by the scale so far,
    which is one step of EM; `learned` begins as `declared_variance(1.0)`.

    Args:
        learned: so far, of scaled squares.
        apart: (n,) values less what was expected of their targets.
        known_variance: (n,) of what was expected.
        stated_variance: (n,) of the values, as the source states it.
        weight: (n,) probability that each value is of its target and right.
        most: pairs remembered; what is older fades.
    """
    noise = learned.squares / learned.weight * stated_variance
    gain = noise / (noise + known_variance)
    squares = gain**2 * apart**2 + gain * known_variance
    total = learned.weight + float(weight.sum())
    kept = min(1.0, most / total)
    return LearnedVariance(
        kept * total, kept * (learned.squares + float(weight @ (squares / stated_variance)))
    )


def with_learned(feature: Parametric, learned: LearnedVariance, least: float = 0.1) -> Parametric:
    """The feature with what was learned of its variance.

    Args:
        feature: as in use.
        learned: of the squared differences, which the tolerance is part of.
        least: share of the mean square that is noise at least, whatever the tolerance.
    """
    square = learned.squares / learned.weight
    return feature._replace(variance=max(square - feature.tolerance**2 / 3, least * square))


def declared_reports(confusion: ArrayLike, strength: float = _STRENGTH) -> Array:
    """Counts (K, M) of imagined reports that say what a source declares of its confusion."""
    return strength * np.asarray(confusion, dtype=float)


def confusion_of(reports: Array) -> Array:
    """The confusion (K, M) that counts of reports amount to."""
    return np.asarray(reports / reports.sum(axis=1, keepdims=True), dtype=float)


def taught_reports(
    reports: Array, truth: Array, reported: Indices, forgetting: float = 1.0
) -> Array:
    """Counts (K, M) with reports of targets whose class others have told, added softly.

    Args:
        reports: counts so far, those declared included.
        truth: (n, K) probability of each category by all but these reports.
        reported: (n,) what the source said; -1 is passed over.
        forgetting: share of the counts that is kept.
    """
    said = reported != UNSAID
    share = truth[said] * confusion_of(reports)[:, reported[said]].T
    share /= share.sum(axis=1, keepdims=True)
    counts = forgetting * reports
    np.add.at(counts.T, reported[said], share)
    return counts
