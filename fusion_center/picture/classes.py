"""What a report says of the classes of its targets, as likelihoods for the picture."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.classes import by_confusion, by_set, discounted
from schemas.messages import DeclaredScenario, FeatureInfo, SourceReport

from ..sources.features import CLASS


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
) -> Array | None:
    """Likelihoods (classes, m) of what some logs say, over that of a false log; None of nothing.

    Args:
        which: (m,) logs of the report.
        told: how the source confuses classes, where it declares that.
        trust: share of its reports that are what they claim.
    """
    if report.classes is None or not classes:
        return None
    said = [report.classes[i] or [] for i in which.tolist()]
    confidence = report.class_confidence or [None] * len(report)
    sure = np.array([confidence[i] or trust for i in which.tolist()], dtype=float)
    members = np.array([[name in names for name in classes] for names in said], dtype=np.bool_)
    members = members.reshape(len(said), len(classes))
    likelihood = by_set(members, sure)
    single = _by_confusion(said, classes, told)
    likelihood = np.where(np.isfinite(single), single, likelihood)
    ratio = discounted(likelihood, trust) / likelihood.mean(axis=1, keepdims=True)
    return np.where(np.asarray(members.any(axis=1))[:, None], ratio, 1.0).T


def _by_confusion(
    said: Sequence[list[str]], classes: Sequence[str], told: FeatureInfo | None
) -> Array:
    """Likelihoods (m, classes) of single names by a declared confusion; nan where there is none."""
    likelihood = np.full((len(said), len(classes)), np.nan)
    if told is None or not told.confusion or set(told.categories) != set(classes):
        return likelihood
    order = [told.categories.index(name) for name in classes]
    confusion = np.array(told.confusion, dtype=float)[order]
    rows = [i for i, names in enumerate(said) if len(names) == 1 and names[0] in told.categories]
    names = np.array([told.categories.index(said[i][0]) for i in rows], dtype=np.intp)
    likelihood[rows] = by_confusion(confusion, names)
    return likelihood
