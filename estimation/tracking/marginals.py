"""Who is whose: probabilities of pairs of a track and a plot when each has at most one partner.

`Candidates.weight` is the likelihood of a pair over that of both staying alone. Two ways from
there to `Marginals`, with the same signature: `by_belief` (probabilities) and `by_assignment`
(the one best set, taken for certain; global nearest neighbour).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from estimation.arrays import Array, Indices
from estimation.assignment import assignment

_TOLERANCE = 1e-3
_PASSES = 8  # between two looks at what has settled
_ROUNDS = 12


class Candidates(NamedTuple):
    """Pairs that may be, sparse.

    Attributes:
        track, plot: (k,) ends of each pair, none twice.
        weight: (k,) positive.
        tracks, plots: how many there are.
    """

    track: Indices
    plot: Indices
    weight: Array
    tracks: int
    plots: int


class Marginals(NamedTuple):
    """Probabilities: of each pair (k,), of each track and of each plot to have no partner."""

    pair: Array
    track_alone: Array
    plot_alone: Array


def by_belief(given: Candidates) -> Marginals:
    """Marginals by loopy belief propagation; exact where the candidates form no loop.

    Pairs that no other pair touches are exact at once, the others are iterated.

    Source: Williams & Lau, Approximate evaluation of marginal association probabilities with
    belief propagation, IEEE Trans. AES 50(4), 2014, eqs 21-26.
    """
    degree_track = np.bincount(given.track, minlength=given.tracks)[given.track]
    degree_plot = np.bincount(given.plot, minlength=given.plots)[given.plot]
    tangled = np.flatnonzero((degree_track > 1) | (degree_plot > 1))
    message = np.ones(len(given.weight))  # from plots to tracks
    rivals = given._replace(
        track=given.track[tangled], plot=given.plot[tangled], weight=given.weight[tangled]
    )
    message[tangled] = _converged(rivals)
    claim = given.weight * message
    pair = claim / (1.0 + _sums(given.track, claim, given.tracks)[given.track])
    return _completed(given, pair)


def by_assignment(given: Candidates) -> Marginals:
    """The set of pairs of largest product of weights, as if it were certain."""
    pair = np.zeros(len(given.weight))
    with np.errstate(divide="ignore"):
        pair[assignment(given.track, given.plot, np.log(given.weight))] = 1.0
    return _completed(given, pair)


def _converged(given: Candidates) -> Array:
    """Messages from plots to tracks at their fixed point.

    Pairs are dropped from the iteration, a knot of them at a time, as they settle.
    """
    message = np.ones(len(given.weight))
    knot = _knots(given)
    active = np.arange(len(message))
    for _ in range(_ROUNDS):
        if not active.size:
            break
        rest = given._replace(
            track=given.track[active], plot=given.plot[active], weight=given.weight[active]
        )
        message[active], moved = _iterated(rest, message[active])
        unsettled = np.bincount(knot[active], moved, minlength=int(knot.max()) + 1) > 0
        active = active[unsettled[knot[active]]]
    return message


def _iterated(given: Candidates, message: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Messages after some passes, and which still moved in the last."""
    before = message
    for _ in range(_PASSES):
        before = message
        claim = given.weight * message
        others = _sums(given.track, claim, given.tracks)[given.track] - claim
        bid = given.weight / (1.0 + np.maximum(others, 0.0))
        rest = _sums(given.plot, bid, given.plots)[given.plot] - bid
        message = 1.0 / (1.0 + np.maximum(rest, 0.0))
    return message, np.abs(message - before) > _TOLERANCE * message


def _knots(given: Candidates) -> Indices:
    """Which pairs hang together, directly or through others: a label (k,) of each."""
    ends = (given.track, given.tracks + given.plot)
    size = given.tracks + given.plots
    links = coo_array((np.ones(len(given.weight)), ends), shape=(size, size))
    _, label = connected_components(links, directed=False)
    return np.asarray(label[given.track], dtype=np.intp)


def _completed(given: Candidates, pair: Array) -> Marginals:
    track_alone = 1.0 - _sums(given.track, pair, given.tracks)
    plot_alone = 1.0 - _sums(given.plot, pair, given.plots)
    return Marginals(pair, np.maximum(track_alone, 0.0), np.maximum(plot_alone, 0.0))


def _sums(label: Indices, values: Array, size: int) -> Array:
    return np.asarray(np.bincount(label, values, minlength=size), dtype=float)
