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
from estimation.association import Side, associate, candidates, population
from estimation.association_rules import mahalanobis_rule, paper_rule, ruled_pairs
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


def feature_log_ratio(of: Scene, own: Indices, other: Indices) -> Array:
    """What all features say of pairs (K,)."""
    numbers = parametric_log_ratio(PARAMETRIC, of.own_numbers[own], of.other_numbers[other])
    wrong = (1.0 - RIGHT_WORD) / (WORDS - 1)
    confusion = np.full((WORDS, WORDS), wrong) + (RIGHT_WORD - wrong) * np.eye(WORDS)
    word = Behavioural("kind", np.full(WORDS, 1.0 / WORDS), confusion, confusion)
    said = behavioural_log_ratio(word, of.own_word[own], of.other_word[other])
    total: Array = numbers.sum(axis=-1) + said
    return total


def pairs_of(of: Scene, rule: str, neighbour_sigmas: float) -> tuple[Indices, Indices]:
    """The pairs (own rows, other rows) that a rule makes."""
    near = candidates(of.own, of.other, NO_COMMON)
    if rule.startswith("ours"):
        seen = population(len(of.own_truth), len(of.other_truth), of.side_m**2, SEEN_BY_BOTH)
        features = feature_log_ratio(of, near.own, near.other)
        features = features if rule == "ours" else np.zeros_like(features)
        found = associate(near, NO_COMMON, seen, features)
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


@cache
def measure(seed: int, runs: int, neighbour_sigmas: float, rule: str) -> Score:
    """Right and wrong pairs by common objects, over some scenes."""
    right = wrong = common = 0
    for run in range(runs):
        of = scene(np.random.default_rng([seed, run, int(10 * neighbour_sigmas)]), neighbour_sigmas)
        own, other = pairs_of(of, rule, neighbour_sigmas)
        hits = int(np.sum(of.own_truth[own] == of.other_truth[other]))
        right, wrong = right + hits, wrong + len(own) - hits
        common += len(np.intersect1d(of.own_truth, of.other_truth))
    return Score(right / common, wrong / common)


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The table of three distances and four rules, with the demand on ours at four sigmas."""
    scenes = max(runs // 20, 2)
    for distance in (4, 2, 1):
        for rule in RULES:
            score = measure(seed, scenes, distance, rule)
            name = f"neighbours at {distance} sigma, {rule}"
            judged = distance == 4 and rule == "ours"
            right, wrong = f"{name}: right", f"{name}: wrong"
            yield at_least(right, score.right, 0.985) if judged else told(right, score.right)
            yield at_most(wrong, score.wrong, 0.01) if judged else told(wrong, score.wrong)
