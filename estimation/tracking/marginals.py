"""Who is whose: probabilities of pairs of a track and a plot when each has at most one partner.

`Candidates.weight` is the likelihood of a pair over that of both staying alone. Two ways from
there to `Marginals`, with the same signature: `by_belief` (probabilities) and `by_assignment`
(the one best set, taken for certain; global nearest neighbour).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices, beginnings
from estimation.assignment import assignment
from estimation.tracking.tangles import summed

_TOLERANCE = 1e-3
_ROUNDING = 1e-15
_PASSES = 4  # between two looks at what has settled
_ROUNDS = 24


class Candidates(NamedTuple):
    """Pairs that may be, sparse.

    Attributes:
        track, plot: (k,) ends of each pair, by track, none twice.
        weight: (k,) positive.
        tracks, plots: how many there are.
    """

    track: Indices
    plot: Indices
    weight: Array
    tracks: int
    plots: int

    def take(self, which: Indices) -> Candidates:
        """Some of the pairs."""
        some = (self.track[which], self.plot[which], self.weight[which])
        return Candidates(*some, self.tracks, self.plots)


class Marginals(NamedTuple):
    """Probabilities: of each pair (k,), of each track and of each plot to have no partner."""

    pair: Array
    track_alone: Array
    plot_alone: Array


def by_belief(given: Candidates) -> Marginals:
    """Marginals by loopy belief propagation; exact without loops, and in small groups.

    Pairs that no other pair touches are exact at once. Of the others small groups that form loops
    are summed over completely (`tangles`), the rest is iterated. Faint pairs, and slight ones at
    such a group, are weighed against what the others settled on, but take no part in settling it.

    Source: Williams & Lau, Approximate evaluation of marginal association probabilities with
    belief propagation, IEEE Trans. AES 50(4), 2014, eqs 21-26.
    """
    degree_track = np.bincount(given.track, minlength=given.tracks)[given.track]
    degree_plot = np.bincount(given.plot, minlength=given.plots)[given.plot]
    tangled = (degree_track > 1) | (degree_plot > 1)
    rivals = np.flatnonzero(tangled & (given.weight > _TOLERANCE))
    some = given.take(rivals)
    exact = summed(some.track, some.plot, some.weight)
    grouped, probability = given.take(rivals[exact.pair]), exact.probability
    iterated = rivals[~_touching(some, grouped)]
    bid = np.zeros(len(given.weight))  # from tracks to plots
    some = given.take(iterated)
    bid[iterated] = _bids(some, _converged(some))
    bid[rivals[exact.pair]] = _odds(grouped.plot, probability, given.plots)
    rest = _sums(given.plot, bid, given.plots)[given.plot] - bid
    claim = given.weight / (1.0 + np.maximum(rest, 0.0))
    claim[rivals[exact.pair]] = _odds(grouped.track, probability, given.tracks)
    pair = claim / (1.0 + _sums(given.track, claim, given.tracks)[given.track])
    return _completed(given, pair)


def _touching(some: Candidates, others: Candidates) -> NDArray[np.bool_]:
    """Which pairs share a track or a plot with any of the others."""
    track, plot = np.zeros(some.tracks, dtype=bool), np.zeros(some.plots, dtype=bool)
    track[others.track] = plot[others.plot] = True
    return np.asarray(track[some.track] | plot[some.plot])


def _odds(end: Indices, probability: Array, size: int) -> Array:
    """Probabilities of pairs by that of their end to stay alone."""
    alone = np.maximum(1.0 - _sums(end, probability, size), _ROUNDING)
    return np.asarray(probability / alone[end])


def by_assignment(given: Candidates) -> Marginals:
    """The set of pairs of largest product of weights, as if it were certain."""
    pair = np.zeros(len(given.weight))
    with np.errstate(divide="ignore"):
        pair[assignment(given.track, given.plot, np.log(given.weight))] = 1.0
    return _completed(given, pair)


def _converged(given: Candidates) -> Array:
    """Messages from plots to tracks at their fixed point.

    What has settled rests for as long as nothing moves that it depends on.
    """
    message = np.ones(len(given.weight))
    active = np.arange(len(message))
    for _ in range(_ROUNDS):
        if not active.size:
            break
        message[active], moved = _iterated(_rivals(given, message, active), message[active])
        restless = active[moved]
        track, plot = np.zeros(given.tracks, dtype=bool), np.zeros(given.plots, dtype=bool)
        track[given.track[restless]] = plot[given.plot[restless]] = True
        active = np.flatnonzero(track[given.track] | plot[given.plot])
    return message


class _Rivals(NamedTuple):
    """Pairs that are iterated, and what those at rest say to them.

    Attributes:
        given: the k pairs.
        begins, runs: first pair and length of each run of pairs of one track.
        claims: (k,) of pairs at rest on the track of each; bids: (k,) on its plot.
    """

    given: Candidates
    begins: Indices
    runs: Indices
    claims: Array
    bids: Array

    def bid(self, message: Array) -> Array:
        """Messages from tracks to plots, by those from plots to tracks."""
        weight = self.given.weight
        claim = weight * message
        others = np.repeat(np.add.reduceat(claim, self.begins), self.runs)
        others -= claim
        others += self.claims
        np.maximum(others, 0.0, out=others)
        others += 1.0
        bid: Array = np.divide(weight, others, out=others)
        return bid


def _rivals(given: Candidates, message: Array, active: Indices) -> _Rivals:
    """The active ones among some pairs."""
    some = given.take(active)
    begins = beginnings(some.track)
    runs = np.diff(begins, append=len(active))
    if len(active) == len(message):
        return _Rivals(some, begins, runs, np.zeros(1), np.zeros(1))
    claim, bid = given.weight * message, _bids(given, message)
    claim[active] = bid[active] = 0.0
    claims, bids = _sums(given.track, claim, given.tracks), _sums(given.plot, bid, given.plots)
    return _Rivals(some, begins, runs, claims[some.track], bids[some.plot])


def _bids(given: Candidates, message: Array) -> Array:
    """Messages from tracks to plots, by those from plots to tracks."""
    claim = given.weight * message
    others = _sums(given.track, claim, given.tracks)[given.track] - claim
    return np.asarray(given.weight / (1.0 + np.maximum(others, 0.0)))


def _iterated(rivals: _Rivals, message: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Messages after some passes, and which still moved in the last."""
    given, before = rivals.given, message
    for _ in range(_PASSES):
        before, bid = message, rivals.bid(message)
        rest = _sums(given.plot, bid, given.plots)[given.plot]
        rest -= bid
        rest += rivals.bids
        np.maximum(rest, 0.0, out=rest)
        rest += 1.0
        message = np.divide(1.0, rest, out=rest)
    return message, np.abs(message - before) > _TOLERANCE * message


def _completed(given: Candidates, pair: Array) -> Marginals:
    track_alone = 1.0 - _sums(given.track, pair, given.tracks)
    plot_alone = 1.0 - _sums(given.plot, pair, given.plots)
    return Marginals(pair, np.maximum(track_alone, 0.0), np.maximum(plot_alone, 0.0))


def _sums(label: Indices, values: Array, size: int) -> Array:
    return np.asarray(np.bincount(label, values, minlength=size), dtype=float)
