"""What a report says of the classes of its targets, as likelihoods for the picture."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.classes import by_confusion, by_set, discounted
from estimation.feature_learning import confusion_of, declared_reports
from estimation.features import UNSAID
from schemas.messages import DeclaredScenario, FeatureInfo, SourceReport

from ..sources.features import CLASS, NOTHING_LEARNED, is_word, reports
from ..state import Learned, Word

STRENGTH = float(declared_reports(1.0))
"""Reports of each class that a declared confusion is worth."""
ENOUGH = 200.0
"""Reports that have earned a source half of the trust it lacks."""
MOST_TRUST = 0.99


def classes_of(scenario: DeclaredScenario) -> tuple[str, ...]:
    """Every class that a source of the run declares; they are what a track may be."""
    return _classes(
        tuple(
            tuple(source.features[CLASS].categories)
            for carrier in scenario.carriers
            for source in carrier.sources.values()
            if CLASS in source.features
        )
    )


@cache
def _classes(told: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    return tuple(sorted({name for names in told for name in names}))


def evidence(
    report: SourceReport,
    which: NDArray[np.intp],
    classes: Sequence[str],
    told: FeatureInfo | None,
    trust: float,
    learned: Learned = NOTHING_LEARNED,
) -> Array | None:
    """Likelihoods (classes, m) of what some logs say, over that of a false log; None of nothing.

    Args:
        which: (m,) logs of the report.
        told: how the source confuses classes, where it declares that.
        trust: share of its reports that are what they claim.
        learned: of the source; what has been proved is trusted.
    """
    if report.classes is None or not classes:
        return None
    said = [report.classes[i] or [] for i in which.tolist()]
    confidence = report.class_confidence or [None] * len(report)
    sure = np.array([confidence[i] or trust for i in which.tolist()], dtype=float)
    members = np.array([[name in names for name in classes] for names in said], dtype=np.bool_)
    members = members.reshape(len(said), len(classes))
    likelihood = by_set(members, sure)
    single = _by_confusion(said, classes, told, learned)
    likelihood = np.where(np.isfinite(single), single, likelihood)
    ratio = discounted(likelihood, _proved(trust, learned)) / likelihood.mean(axis=1, keepdims=True)
    return np.where(np.asarray(members.any(axis=1))[:, None], ratio, 1.0).T


def named_classes(
    report: SourceReport, which: NDArray[np.intp], classes: Sequence[str], told: FeatureInfo | None
) -> NDArray[np.intp] | None:
    """Class (m,) that each log names alone, among the source's own, -1 = none; None of nothing."""
    if report.classes is None or told is None or not _is_of(told, classes):
        return None
    number = {name: i for i, name in enumerate(told.categories)}
    said = [report.classes[i] or [] for i in which.tolist()]
    named = [number.get(names[0], UNSAID) if len(names) == 1 else UNSAID for names in said]
    return np.array(named, dtype=np.intp)


def _is_of(told: FeatureInfo, classes: Sequence[str]) -> bool:
    """Whether a source declares how it confuses all classes of the run."""
    return is_word(told) and bool(told.confusion) and set(told.categories) == set(classes)


def _proved(trust: float, learned: Learned) -> float:
    """The trust that a source has earned."""
    taught = learned.words.get(CLASS)
    if taught is None:
        return trust
    pairs = float(taught.count.sum()) - STRENGTH * len(taught.truth)
    return trust + (MOST_TRUST - trust) * max(pairs, 0.0) / (pairs + ENOUGH)


def _by_confusion(
    said: Sequence[list[str]],
    classes: Sequence[str],
    told: FeatureInfo | None,
    learned: Learned,
) -> Array:
    """Likelihoods (m, classes) of single names by a confusion; nan where none is declared."""
    likelihood = np.full((len(said), len(classes)), np.nan)
    if told is None or not _is_of(told, classes):
        return likelihood
    confusion = confusion_of(reports(learned, Word(CLASS, tuple(classes)), told).count)
    rows = [i for i, names in enumerate(said) if len(names) == 1 and names[0] in told.categories]
    names = np.array([told.categories.index(said[i][0]) for i in rows], dtype=np.intp)
    likelihood[rows] = by_confusion(confusion, names)
    return likelihood
