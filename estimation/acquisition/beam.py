"""Beam search over pairs of tracks with the frame's error integrated out.

Own tracks are taken one after another; a hypothesis says whom each of them so far is paired with,
and carries the frame that these pairs imply. The score of a hypothesis is the exact likelihood of
its pairs, since each pair is weighed with the frame as uncertain as the pairs before have left it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.acquisition.innovation import (
    Frames,
    linearised,
    log_likelihood,
    updated,
    with_covariance_along_own,
)
from estimation.acquisition.problem import Mask, Problem, Side
from estimation.arrays import Array, Indices, transposed

NOBODY = -1


class Hypotheses(NamedTuple):
    """B hypotheses, the most likely first.

    Attributes:
        frames: what each believes of (q, D).
        partner: (B, N1) the other's log of each own one, or `NOBODY`.
        used: (B, N2) the other's logs that are taken.
        score: (B,) log likelihood against "nothing is shared".
    """

    frames: Frames
    partner: Indices
    used: Mask
    score: Array


def search(given: Problem, prior: Frames, worth: float, gate: float, width: int) -> Hypotheses:
    """The `width` most likely hypotheses (or fewer) by a beam of that width.

    Args:
        worth: ln of a pair's prior odds over the density of logs [m^2].
        gate: chi-squared of 2 within which a pair agrees with the prior.
    """
    other = with_covariance_along_own(given.other, float(prior.t[0, 2]))
    allowed = gated(given, prior, other, gate)
    hypotheses = _start(given, prior)
    for i in np.argsort(allowed.sum(axis=1), kind="stable"):
        candidates = np.flatnonzero(allowed[i])
        if candidates.size:
            must = bool((given.bound[:, 0] == i).any())
            odds = worth + given.log_ratio[i, candidates]
            hypotheses = _extended(hypotheses, int(i), candidates, odds, must, given, other, width)
    return hypotheses


def gated(given: Problem, prior: Frames, other: Side, gate: float) -> Mask:
    """(N1, N2) the pairs that the prior and the constraints allow; bound ones always."""
    n1, n2 = given.log_ratio.shape
    i, j = np.indices((n1, n2)).reshape(2, -1)
    w, h = linearised(prior.t[0], given.own.take(i), other.take(j))
    v = given.own.covariance[i] + other.covariance[j] + h @ prior.covariance[0] @ transposed(h)
    w, v = w[:, :2], v[:, :2, :2]
    d2 = (w * np.linalg.solve(v, w[..., None])[..., 0]).sum(axis=1).reshape(n1, n2)
    allowed: Mask = (d2 < gate) & np.isfinite(given.log_ratio)
    allowed[given.bound[:, 0], given.bound[:, 1]] = True
    return allowed


def _start(given: Problem, prior: Frames) -> Hypotheses:
    """The one hypothesis before any track is looked at."""
    n1, n2 = given.log_ratio.shape
    partner = np.full((1, n1), NOBODY, dtype=np.intp)
    return Hypotheses(prior, partner, np.zeros((1, n2), dtype=bool), np.zeros(1))


def _extended(
    old: Hypotheses,
    i: int,
    candidates: Indices,
    odds: Array,
    must: bool,
    given: Problem,
    other: Side,
    width: int,
) -> Hypotheses:
    """Every hypothesis with every candidate for own log i, and with nobody; the best `width`."""
    mine = given.own.take(np.array([i]))
    theirs = other.take(candidates)
    gain = odds + log_likelihood(old.frames, mine, theirs, given.sigma_speed_mps)
    gain[old.used[:, candidates]] = -np.inf
    nobody = np.full((len(gain), 1), -np.inf if must else 0.0)
    score = (old.score[:, None] + np.concatenate([nobody, gain], axis=1)).ravel()
    best = _best(score, width)
    parent, choice = np.divmod(best, candidates.size + 1)

    frames = old.frames.take(parent)
    partner, used = old.partner[parent], old.used[parent]
    paired = np.flatnonzero(choice)
    chosen = candidates[choice[paired] - 1]
    partner[paired, i] = chosen
    used[paired, chosen] = True
    own_logs = given.own.take(np.full(paired.size, i))
    t, covariance = updated(frames.take(paired), own_logs, other.take(chosen))
    frames.t[paired], frames.covariance[paired] = t, covariance
    return Hypotheses(frames, partner, used, score[best])


def _best(score: Array, width: int) -> Indices:
    """Indices of the `width` best finite scores, the best first; ties by index."""
    if score.size > width:
        kept = np.argpartition(-score, width - 1)[:width]
    else:
        kept = np.arange(score.size)
    kept = kept[np.isfinite(score[kept])]
    return kept[np.lexsort((kept, -score[kept]))]
