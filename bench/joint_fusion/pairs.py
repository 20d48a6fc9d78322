"""Pairs of logs of two sources: the paper's rule, Mahalanobis and ours, side by side.

Targets lie at random with a mean distance to the nearest neighbour of so many sigmas; one in ten is
seen by one source only. Each log has two lengths and a word with their errors, some are missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_least, at_most, told
from estimation.arrays import Array, Indices
from estimation.association import Population, Side, associate, candidates, population
from estimation.association_rules import mahalanobis_rule, paper_rule, ruled_pairs
from estimation.feature_learning import declared_variance, taught_variance, with_learned
from estimation.features import (
    UNSAID,
    Behavioural,
    Parametric,
    behavioural_log_ratio,
    parametric_log_ratio,
)

OBJECTS = 300
SEEN_BY_BOTH = 0.9
SIGMA_M = 50.0
SIGMA_FEATURE = 0.05  # of a report, in the width of the population
WORDS, RIGHT_WORD, UNREPORTED = 4, 0.9, 0.1
PARAMETRIC = Parametric("length", 0.0, 1.0, 2 * SIGMA_FEATURE**2)
MAHALANOBIS_GATE = 18.42  # chi2 of two dof: one right pair in 10 000 lies outside
NO_COMMON = np.empty((0, 0))
RULES = ("paper's rule", "Mahalanobis", "ours without features", "ours")


class Scene(NamedTuple):
    """Logs of two sources as columns; the truth says which object each is of."""

    own: Side
    other: Side
    own_truth: Indices
    other_truth: Indices
    own_numbers: Array  # (n, 2), nan = not reported
    other_numbers: Array
    own_word: Indices
    other_word: Indices
    side_m: float


class Score(NamedTuple):
    """Pairs by the objects that both sources saw, and whether each count is right."""

    right: float
    wrong: float


def scene(rng: np.random.Generator, neighbour_sigmas: float, objects: int = OBJECTS) -> Scene:
    """Objects at random in a square; the mean nearest neighbour is at 1 / (2 sqrt(density))."""
    side_m = np.sqrt(objects) * 2.0 * neighbour_sigmas * SIGMA_M
    place = rng.uniform(0.0, side_m, (objects, 2))
    numbers = rng.uniform(0.0, 1.0, (objects, 2))
    word = rng.integers(0, WORDS, objects)
    alone = rng.random(objects) >= SEEN_BY_BOTH
    by_own = ~alone | (rng.random(objects) < 0.5)
    by_other = alone <= ~by_own
    i, j = (rng.permutation(np.flatnonzero(which)) for which in (by_own, by_other))
    own, own_numbers, own_word = _logs(rng, place[i], numbers[i], word[i])
    other, other_numbers, other_word = _logs(rng, place[j], numbers[j], word[j])
    return Scene(own, other, i, j, own_numbers, other_numbers, own_word, other_word, float(side_m))


def _logs(
    rng: np.random.Generator, place: Array, numbers: Array, word: Indices
) -> tuple[Side, Array, Indices]:
    count = len(place)
    measured = place + rng.normal(0.0, SIGMA_M, (count, 2))
    side = Side(measured, np.broadcast_to(SIGMA_M**2 * np.eye(2), (count, 2, 2)))
    reported = numbers + rng.normal(0.0, SIGMA_FEATURE, numbers.shape)
    reported[rng.random(numbers.shape) < UNREPORTED] = np.nan
    mistaken = rng.random(count) >= RIGHT_WORD
    said = (word + mistaken * rng.integers(1, WORDS, count)) % WORDS
    said[rng.random(count) < UNREPORTED] = UNSAID
    return side, reported, said


def feature_log_ratio(
    of: Scene, own: Indices, other: Indices, number: Parametric = PARAMETRIC
) -> Array:
    """What all features say of pairs (K,), the numbers being believed to be as stated."""
    numbers = parametric_log_ratio(number, of.own_numbers[own], of.other_numbers[other])
    total: Array = numbers.sum(axis=-1) + word_log_ratio(of, own, other)
    return total


def word_log_ratio(of: Scene, own: Indices, other: Indices) -> Array:
    """What the words say of pairs (K,)."""
    wrong = (1.0 - RIGHT_WORD) / (WORDS - 1)
    confusion = np.full((WORDS, WORDS), wrong) + (RIGHT_WORD - wrong) * np.eye(WORDS)
    word = Behavioural("kind", np.full(WORDS, 1.0 / WORDS), confusion, confusion)
    return behavioural_log_ratio(word, of.own_word[own], of.other_word[other])


def pairs_of(of: Scene, rule: str, neighbour_sigmas: float) -> tuple[Indices, Indices]:
    """The pairs (own rows, other rows) that a rule makes."""
    near = candidates(of.own, of.other, NO_COMMON)
    if rule.startswith("ours"):
        features = feature_log_ratio(of, near.own, near.other)
        features = features if rule == "ours" else np.zeros_like(features)
        found = associate(near, NO_COMMON, seen_by(of), features)
        return found.own, found.other
    if rule == "Mahalanobis":
        ruled = mahalanobis_rule(near.misclosure_m, near.covariance, MAHALANOBIS_GATE)
    else:
        ruled = paper_rule(*_paper_terms(of, near.own, near.other, neighbour_sigmas))
    chosen = ruled_pairs(near.own, near.other, near.misclosure_m, near.covariance, ruled)
    return chosen.own, chosen.other


def _paper_terms(
    of: Scene, own: Indices, other: Indices, neighbour_sigmas: float
) -> tuple[Array, Array, Array]:
    """Differences, sigmas, displacements of the paper's rule: all parametric, alpha = distance.

    A feature that is missing agrees with all. The words are part of the rule as "must agree", by
    which every mistaken word is a lost pair; they are left out, to its advantage.
    """
    place = of.own.place_m[own] - of.other.place_m[other]
    numbers = np.nan_to_num(of.own_numbers[own] - of.other_numbers[other])
    sigma = np.sqrt(2.0) * np.array([SIGMA_M, SIGMA_M, SIGMA_FEATURE, SIGMA_FEATURE])
    displaced = np.array([neighbour_sigmas * SIGMA_M] * 2 + [0.3, 0.3])
    return np.hstack([place, numbers]), np.broadcast_to(sigma, (len(own), 4)), displaced


def seen_by(of: Scene) -> Population:
    """How dense the targets are, by who sees them."""
    return population(len(of.own_truth), len(of.other_truth), of.side_m**2, SEEN_BY_BOTH)


def scenes(seed: int, runs: int, neighbour_sigmas: float) -> Iterator[Scene]:
    """Independent scenes, the same ones for every rule."""
    for run in range(runs):
        rng = np.random.default_rng([seed, run, int(10 * neighbour_sigmas)])
        yield scene(rng, neighbour_sigmas)


@cache
def measure(seed: int, runs: int, neighbour_sigmas: float, rule: str) -> Score:
    """Right and wrong pairs by common objects, over some scenes."""
    counts = [
        count(of, *pairs_of(of, rule, neighbour_sigmas))
        for of in scenes(seed, runs, neighbour_sigmas)
    ]
    return scored(counts)


def count(of: Scene, own: Indices, other: Indices) -> tuple[int, int, int]:
    """Right pairs, wrong pairs and objects that both saw."""
    right = int(np.sum(of.own_truth[own] == of.other_truth[other]))
    return right, len(own) - right, len(np.intersect1d(of.own_truth, of.other_truth))


def scored(counts: list[tuple[int, int, int]]) -> Score:
    """Of all scenes together."""
    right, wrong, common = np.sum(counts, axis=0)
    return Score(right / common, wrong / common)


def with_wrong_sigma(seed: int, runs: int, factor: float) -> tuple[Score, Score, float]:
    """Ours at four sigmas when a number's sigma is declared so many times too large.

    Returns:
        The scores as declared and with what earlier scenes taught, and the factor at the end.
    """
    declared = PARAMETRIC._replace(variance=factor**2 * PARAMETRIC.variance)
    number, learned = declared, declared_variance(declared.variance)
    as_declared: list[tuple[int, int, int]] = []
    as_learned: list[tuple[int, int, int]] = []
    for of in scenes(seed, runs, 4):
        near = candidates(of.own, of.other, NO_COMMON)
        for counts, used in ((as_declared, declared), (as_learned, number)):
            features = feature_log_ratio(of, near.own, near.other, used)
            found = associate(near, NO_COMMON, seen_by(of), features)
            counts.append(count(of, found.own, found.other))
        word = word_log_ratio(of, near.own, near.other)
        sure = associate(near, NO_COMMON, seen_by(of), word)  # without what is to be learned
        difference = of.own_numbers[sure.own] - of.other_numbers[sure.other]
        for column in difference.T:
            learned = taught_variance(learned, number, column, sure.probability)
        number = with_learned(number, learned)
    found_factor = float(np.sqrt(number.variance / PARAMETRIC.variance))
    return scored(as_declared), scored(as_learned), found_factor


def displaced(seed: int, runs: int, sigmas: float) -> dict[str, Score]:
    """Ours at four sigmas when all of one source is displaced by a common error of so many."""
    common = np.square(sigmas * SIGMA_M) * np.eye(2)
    found: dict[str, list[tuple[int, int, int]]] = {}
    for run, of in enumerate(scenes(seed, runs, 4)):
        shift = np.random.default_rng([seed, run, 77]).normal(0.0, sigmas * SIGMA_M, 2)
        theirs = Side(of.other.place_m + shift, of.other.covariance)
        everyone = np.broadcast_to(np.eye(2), (len(theirs.place_m), 2, 2))
        for name, side, prior in (
            ("common error known", of.other, NO_COMMON),
            ("common error integrated out", theirs._replace(by_common=everyone), common),
            (
                "common error taken for noise",
                theirs._replace(covariance=theirs.covariance + common),
                NO_COMMON,
            ),
            ("common error left out", theirs, NO_COMMON),
        ):
            near = candidates(of.own, side, prior)
            features = feature_log_ratio(of, near.own, near.other)
            pairs = associate(near, prior, seen_by(of), features)
            found.setdefault(name, []).append(count(of, pairs.own, pairs.other))
    return {name: scored(counts) for name, counts in found.items()}


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Three distances and four rules, with the demand on ours; wrong sigmas; a common error."""
    number = max(runs // 20, 2)
    for distance in (4, 2, 1):
        for rule in RULES:
            score = measure(seed, number, distance, rule)
            name = f"neighbours at {distance} sigma, {rule}"
            judged = distance == 4 and rule == "ours"
            right, wrong = f"{name}: right", f"{name}: wrong"
            yield at_least(right, score.right, 0.985) if judged else told(right, score.right)
            yield at_most(wrong, score.wrong, 0.01) if judged else told(wrong, score.wrong)
    for factor in (0.2, 1.0, 5.0):
        declared, learned, found = with_wrong_sigma(seed, number, factor)
        name = f"sigma of the numbers declared x {factor:g}"
        yield told(f"{name}: right", declared.right)
        yield told(f"{name}, learned: right", learned.right)
        yield told(f"{name}, learned: x", found)
    for name, score in displaced(seed, number, 3.0).items():
        yield told(f"a source displaced by 3 sigma, {name}: right", score.right)
        yield told(f"a source displaced by 3 sigma, {name}: wrong", score.wrong)
