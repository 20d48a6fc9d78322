"""From hypotheses to modes: frames that stand apart, each polished and weighed.

Hypotheses that differ only in whom some crowded log belongs to have nearly one frame; they are one
mode. A mode is polished by assignment and exact fit in turn, and weighed by the likelihood of its
pairs with the frame integrated out, summed over the assignments near the best.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimation.acquisition.innovation import (
    Frames,
    fitted,
    log_likelihood,
    with_covariance_along_own,
)
from estimation.acquisition.matching import Pairs, all_assignments, best_assignment
from estimation.acquisition.problem import Problem, Side
from estimation.acquisition.refine import weighed_fit
from estimation.acquisition.sharing import Sharing
from estimation.arrays import Array

_ROUNDS, _REFINEMENTS = 8, 3
_TOLD = 0.3  # probability of a pair below which it is not told of: rather a doubtful pair than none
_APART = 16.0  # chi-squared of 3 beyond which two frames are two modes


class Setting(NamedTuple):
    """What every mode is polished and weighed against.

    Attributes:
        given: the logs.
        prior: B = 1; next to flat in D where the heading is unknown.
        log_peak: ln of the prior's density [1/(m^2 rad)] at its mean.
        sharing: the weights of numbers of pairs.
        covariance: (3, 3) of the prior as it is told.
        flat: whether every heading is as likely.
    """

    given: Problem
    prior: Frames
    log_peak: float
    sharing: Sharing
    covariance: Array
    flat: bool

    def closed(self, covariance: Array) -> Array:
        """A posterior covariance (3, 3); a flat heading is no wider than the circle."""
        if not self.flat:
            return covariance
        circle = np.diag([0.0, 0.0, 1 / self.covariance[2, 2]])
        closed: Array = np.linalg.inv(np.linalg.inv(covariance) + circle)
        return closed


class Candidate(NamedTuple):
    """A polished mode.

    Attributes:
        pairs: its best assignment.
        frame: B = 1.
        log_evidence: against "nothing is shared".
        pair_probability: (K,) that each pair is right, given the mode.
    """

    pairs: Pairs
    frame: Frames
    log_evidence: float
    pair_probability: Array


def starts(frames: Frames, score: Array, most: int) -> Frames:
    """The best of each group of frames that agree within the better one's errors."""
    left = np.argsort(-score, kind="stable")
    chosen: list[int] = []
    while left.size and len(chosen) < most:
        best = left[0]
        chosen.append(int(best))
        both = frames.covariance[best] + frames.covariance[left]
        left = left[_distance(frames.t[left] - frames.t[best], both) > _APART]
    return frames.take(np.array(chosen, dtype=np.intp))


def _distance(apart: Array, covariance: Array) -> Array:
    solved = np.linalg.solve(covariance, apart[..., None])[..., 0]
    distance: Array = (apart * solved).sum(axis=-1)
    return distance


def polished(setting: Setting, start: Frames) -> Candidate:
    """Assignment and fit in turn from one frame (B = 1) until the pairs stay, then the evidence."""
    worth = setting.sharing.worth_at_first
    frame, pairs = start, _assigned(setting, start, worth)
    for _ in range(_ROUNDS):
        frame = fitted(setting.prior, frame.t[0], *_logs(setting.given, pairs))
        before, pairs = pairs, _assigned(setting, frame, setting.sharing.worth(pairs.own.size))
        if _same(before, pairs):
            break
    else:
        frame = fitted(setting.prior, frame.t[0], *_logs(setting.given, pairs))
    return _weighed(setting, frame, pairs)


def refined(setting: Setting, found: Candidate) -> Candidate:
    """A mode with its frame by every pair's probability, and then the pairs that are probable.

    The pairs are those with which one is right most often, which in a crowd are not those of the
    likeliest assignment.
    """
    frame, worth = found.frame, setting.sharing.worth(found.pairs.own.size)
    probability = _chances(setting, frame, worth)[1]
    for _ in range(_REFINEMENTS):
        frame = weighed_fit(setting.given, setting.prior, frame, probability)
        probability = _chances(setting, frame, worth)[1]
    told = np.where(probability > _TOLD, probability, 0.0)
    pairs = best_assignment(told, setting.given.bound)
    pairs = pairs if pairs.own.size else found.pairs
    return Candidate(pairs, frame, found.log_evidence, probability[pairs.own, pairs.other])


def _same(one: Pairs, other: Pairs) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def _logs(given: Problem, pairs: Pairs) -> tuple[Side, Side]:
    return given.own.take(pairs.own), given.other.take(pairs.other)


def _log_ratio(setting: Setting, frame: Frames, worth: float) -> Array:
    """(N1, N2) what each pair is worth under one frame and its uncertainty."""
    given = setting.given
    other = with_covariance_along_own(given.other, float(frame.t[0, 2]))
    own = Side(given.own.state[:, None], given.own.covariance[:, None], given.own.moving[:, None])
    return worth + log_likelihood(frame, own, other, given.sigma_speed_mps) + given.log_ratio


def _assigned(setting: Setting, frame: Frames, worth: float) -> Pairs:
    return best_assignment(_log_ratio(setting, frame, worth), setting.given.bound)


def _chances(setting: Setting, frame: Frames, worth: float) -> tuple[float, Array]:
    """Log weight of all assignments, that of bound pairs left out, and the pairs' probabilities."""
    ratio = _log_ratio(setting, frame, worth)
    i, j = setting.given.bound.T
    ratio[i, j] = -np.inf  # no rivals, and no choice
    total, probability = all_assignments(ratio)
    probability[i, j] = 1.0
    return total, probability


def _weighed(setting: Setting, frame: Frames, pairs: Pairs) -> Candidate:
    """The evidence of a mode, by Laplace's method about its fit; exact while w is linear in t."""
    given, prior = setting.given, setting.prior
    own, other = _logs(given, pairs)
    other = with_covariance_along_own(other, float(frame.t[0, 2]))
    exact = Frames(frame.t, np.zeros((1, 3, 3)))
    at_fit = log_likelihood(exact, own, other, given.sigma_speed_mps).sum()
    features = given.log_ratio[pairs.own, pairs.other].sum()
    log_prior = setting.log_peak - 0.5 * float(_distance(frame.t - prior.t, prior.covariance)[0])
    covariance = setting.closed(frame.covariance[0])
    log_volume = 0.5 * float(np.linalg.slogdet(2 * np.pi * covariance)[1])
    weight = setting.sharing.log_weight(pairs.own.size)
    best = float(weight + at_fit + features + log_prior + log_volume)

    worth = setting.sharing.worth(pairs.own.size)
    total, probability = _chances(setting, frame, worth)
    chosen = _log_ratio(setting, frame, worth)[pairs.own, pairs.other]
    free = ~np.isin(pairs.own, given.bound[:, 0])
    others = total - float(chosen[free].sum())  # of all assignments over the best one
    return Candidate(pairs, frame, best + others, probability[pairs.own, pairs.other])


def apart(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The best of each group of candidates with one frame, the best first."""
    kept: list[Candidate] = []
    for each in sorted(candidates, key=lambda c: -c.log_evidence):
        if all(_differ(each, other) for other in kept):
            kept.append(each)
    return kept


def _differ(one: Candidate, other: Candidate) -> bool:
    """Two modes: their frames disagree, or they have hardly a pair in common."""
    both = one.frame.covariance + other.frame.covariance
    distance = float(_distance(one.frame.t - other.frame.t, both)[0])
    pairs = set(zip(*one.pairs, strict=True)), set(zip(*other.pairs, strict=True))
    common = len(pairs[0] & pairs[1])
    return distance > _APART or 2 * common < min(map(len, pairs))
