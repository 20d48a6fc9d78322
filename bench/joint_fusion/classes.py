"""Classes from six reports: three sources, two reports each, one of which names pairs only.

The log-loss of each way beside the least that any way can reach, which knows how good each source
really is. In the second experiment the first source claims to be right in .9 and is in .6.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_most, between, told
from estimation.arrays import Array, Indices
from estimation.classes import (
    by_confusion,
    by_set,
    class_posterior,
    discounted,
    expected_trust,
    log_loss,
    taught_trust,
    unproven,
    without_each,
)
from estimation.feature_learning import confusion_of, declared_reports, taught_reports
from estimation.ledger import EMPTY_LEDGER, counted
from estimation.object_count import count_of_pairs

CLASSES, REPORTS_EACH, BATCH = 4, 2, 100
PAIRS = np.array([[True, True, False, False], [False, False, True, True]])
HONEST = ((0.75, 0.65, 0.85), (0.75, 0.65, 0.85))  # claimed, true; the last names pairs
OVERRATED = ((0.9, 0.6, 0.8), (0.6, 0.6, 0.8))
Shares = tuple[float, float, float]


class Reports(NamedTuple):
    """Targets' classes and what was said of them, as columns."""

    truth: Indices
    target: Indices
    source: Indices
    said: Indices


def likelihoods(of: Reports, share: Shares) -> Array:
    """Likelihoods (n, K) of the reports, each source right in such a share."""
    rows = np.empty((len(of.said), CLASSES))
    for source in range(2):
        which = of.source == source
        rows[which] = by_confusion(confusion(share[source]), of.said[which])
    rows[of.source == 2] = by_set(PAIRS[of.said[of.source == 2]], share[2])
    return rows


def confusion(share: float) -> Array:
    """Right in a share, else any other class."""
    wrong = (1.0 - share) / (CLASSES - 1)
    return np.full((CLASSES, CLASSES), wrong) + (share - wrong) * np.eye(CLASSES)


def reported(rng: np.random.Generator, targets: int, share: Shares) -> Reports:
    """Six reports of each target, in the order of the targets."""
    truth = rng.integers(0, CLASSES, targets)
    target = np.repeat(np.arange(targets), 3 * REPORTS_EACH)
    source = np.tile(np.repeat(np.arange(3), REPORTS_EACH), targets)
    right = rng.random(len(target)) < np.array(share)[source]
    other = (truth[target] + rng.integers(1, CLASSES, len(target))) % CLASSES
    word = np.where(right, truth[target], other)
    pair = np.where(right, truth[target] // 2, 1 - truth[target] // 2)
    return Reports(truth, target, source, np.where(source == 2, pair, word))


def flat(targets: int) -> Array:
    """Nothing known of so many targets."""
    return np.full((targets, CLASSES), 1.0 / CLASSES)


def as_claimed(of: Reports, share: Shares) -> Array:
    """Bayes with each source as good as it is said to be."""
    return class_posterior(flat(len(of.truth)), of.target, likelihoods(of, share))


def discounted_only(of: Reports, share: Shares) -> Array:
    """Every source discounted as unproven, nothing learned."""
    rows = discounted(likelihoods(of, share), expected_trust(unproven(3))[of.source])
    return class_posterior(flat(len(of.truth)), of.target, rows)


def trust_learned(of: Reports, share: Shares) -> Array:
    """Every source discounted by what it proved on the targets before."""
    rows, trust = likelihoods(of, share), unproven(3)
    posteriors = []
    for which in _batches(of):
        source, target = of.source[which], of.target[which] - of.target[which].min()
        believed = discounted(rows[which], expected_trust(trust)[source])
        posterior = class_posterior(flat(target.max() + 1), target, believed)
        posteriors.append(posterior)
        others = without_each(posterior, target, believed)
        trust = taught_trust(trust, source, rows[which], others)
    return np.concatenate(posteriors)


def confusion_learned(of: Reports, share: Shares) -> Array:
    """The confusion of every source, its pairs as words too, learned from the targets before."""
    pairs = np.where(PAIRS.T, share[2], 1.0 - share[2])
    counts = [declared_reports(c) for c in (confusion(share[0]), confusion(share[1]), pairs)]
    posteriors = []
    for which in _batches(of):
        source, said = of.source[which], of.said[which]
        target = of.target[which] - of.target[which].min()
        rows = np.empty((len(which), CLASSES))
        for k, reports in enumerate(counts):
            rows[source == k] = by_confusion(confusion_of(reports), said[source == k])
        posterior = class_posterior(flat(target.max() + 1), target, rows)
        posteriors.append(posterior)
        others = without_each(posterior, target, rows)
        counts = [
            taught_reports(reports, others[source == k], said[source == k])
            for k, reports in enumerate(counts)
        ]
    return np.concatenate(posteriors)


def _batches(of: Reports) -> list[Indices]:
    size = BATCH * 3 * REPORTS_EACH
    return [np.arange(at, min(at + size, len(of.said))) for at in range(0, len(of.said), size)]


WAYS = {
    "as claimed": as_claimed,
    "discounted": discounted_only,
    "trust learned": trust_learned,
    "confusion learned": confusion_learned,
}


@cache
def losses(seed: int, targets: int, claimed: Shares, true: Shares) -> dict[str, float]:
    """Log-loss of every way and the least possible."""
    of = reported(np.random.default_rng([seed, targets]), targets, true)
    found = {name: log_loss(way(of, claimed), of.truth) for name, way in WAYS.items()}
    return {**found, "least possible": log_loss(as_claimed(of, true), of.truth)}


def repeats(seed: int, targets: int) -> tuple[float, float]:
    """Log-loss when every report arrives five times: counted each time, and by the ledger once."""
    claimed, true = HONEST
    once = reported(np.random.default_rng([seed, 5]), targets, true)
    again = Reports(once.truth, *(np.tile(column, 5) for column in once[1:]))
    counting = log_loss(as_claimed(again, claimed), again.truth)
    number = np.arange(len(once.target))  # of the report itself: a repeat has the same
    begin = np.zeros(5 * len(number), dtype=np.int64)
    fresh, _ = counted(EMPTY_LEDGER, np.tile(number, 5), begin, begin + 1)
    news = Reports(again.truth, *(column[fresh] for column in again[1:]))
    return counting, log_loss(as_claimed(news, claimed), news.truth)


def count_honesty(seed: int, runs: int) -> tuple[float, float]:
    """Of the number of objects by two sources' pairs: mean normalised error, and mean square.

    Some pairs are doubtful with any probability; so many of them are objects both sources saw, the
    others are objects of which each saw one alone.
    """
    rng = np.random.default_rng([seed, 7])
    seen, errors = (0.9, 0.8), []
    for _ in range(runs):
        objects = int(rng.integers(100, 400))
        first, second = (rng.random(objects) < share for share in seen)
        doubtful = rng.random(objects // 16)
        true = int(np.sum(rng.random(len(doubtful)) < doubtful))
        sure = int(np.sum(first & second)) - true
        probability = np.concatenate([np.ones(sure), doubtful])
        found = count_of_pairs(int(first.sum()), int(second.sum()), probability, seen)
        errors.append((found.mean - objects) / found.sigma)
    return float(np.mean(errors)), float(np.mean(np.square(errors)))


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Both experiments, repeats, and the number of objects."""
    targets = max(10 * runs, 400)
    honest, overrated = (losses(seed, targets, *shares) for shares in (HONEST, OVERRATED))
    for name, value in honest.items():
        judged = name == "trust learned"
        text = f"log-loss, honest sources, {name}"
        yield at_most(text, value, 0.24) if judged else told(text, value)
    for name, value in overrated.items():
        judged = name == "trust learned"
        text = f"log-loss, one source overrated, {name}"
        yield at_most(text, value, 0.47) if judged else told(text, value)
    counting, once = repeats(seed, max(2 * runs, 400))
    yield told("log-loss, every report five times, each counted", counting)
    yield told("log-loss, every report five times, repeats left out", once)
    mean, square = count_honesty(seed, max(runs // 2, 50))
    yield told("number of objects: mean error", mean, "sigma")
    yield between("number of objects: mean squared error", square, 0.8, 1.2, "sigma^2")
