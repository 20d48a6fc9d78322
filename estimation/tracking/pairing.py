"""Pairs of a track and a plot that may be one target, and what a plot would change in a track."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices, beginnings
from estimation.tracking.gating import near
from estimation.tracking.imm import Bank
from estimation.tracking.innovations import (
    Foretold,
    Innovations,
    foretold,
    innovations,
    joined_innovations,
    moved,
)
from estimation.tracking.measurements import Readings
from estimation.tracking.scan import Scan

_BATCH = 8_192  # pairs worked on together: their numbers stay in the cache


class Paired(NamedTuple):
    """k pairs within the gate, by track.

    Attributes:
        track, plot: (k,).
        told: what the states of the innovations should give: of each track or, where plots have
            instants of their own, several of a track.
        owner: (states,) track of each state, ascending; None if tracks are the states.
        innovations: of the pairs.
    """

    track: Indices
    plot: Indices
    told: Foretold
    owner: Indices | None
    innovations: Innovations

    def take(self, which: Indices) -> Paired:
        """The pairs `which`, in that order."""
        some, found = (self.track[which], self.plot[which]), self.innovations.take(which)
        return Paired(*some, self.told, self.owner, found)


def paired(bank: Bank, scan: Scan, gate: float) -> Paired:
    """Pairs whose plot lies within the ellipse of `gate` of either model of a track.

    Args:
        bank: predicted to the scan.
        scan: one report.
        gate: Mahalanobis distance squared.
    """
    readings = scan.plots.readings()
    told = [_foretold(bank, scan, offset_s) for offset_s in _ends(readings.offset_s)]
    track, plot = near(told, readings, gate)
    if len(told) == 1:
        kept, found = _within(readings, told[0], track, plot, gate)
        return Paired(track[kept], plot[kept], told[0], None, found)
    each = _foretold(bank.take(track), scan, readings.offset_s[plot])
    kept, found = _within(readings, each, np.arange(len(track)), plot, gate)
    return Paired(track[kept], plot[kept], each, track, found)


def folded(bank: Bank, pairs: Paired, share: Array) -> Bank:
    """First two moments of each model over the hypotheses of its track: a miss, and the pairs.

    Args:
        share: (models, k) probability of each pair, given the track and the model.
    """
    mean, covariance, shared = (part.copy() for part in (bank.mean, bank.covariance, bank.shared))
    for batch in _by_track(pairs.track):
        some, given = pairs.take(batch), share[:, batch]
        tracks = slice(some.track[0], some.track[-1] + 1)
        shift, change, less = _moves(some, given, tracks)
        mean[..., tracks] += shift
        covariance[..., tracks] += change - shift[:, None] * shift
        shared[..., tracks] -= less
    return bank._replace(mean=mean, covariance=covariance, shared=shared)


def believed(bank: Bank, pairs: Paired, model: Array) -> Bank:
    """The track of each pair if that pair is right; the models (models, k) are then these."""
    weight, inverse = pairs.innovations.weights()
    state, before = pairs.innovations.state, bank.take(pairs.track)
    shift, less = moved(pairs.told.push.take(state, axis=-1), weight, inverse)
    shared = before.shared - _learnt(pairs.told, state, inverse)
    return Bank(before.mean + shift, before.covariance - less, model, shared)


def _by_track(track: Indices) -> list[Indices]:
    """Rows of pairs in batches that part no track."""
    begins = beginnings(track)
    cuts = begins[np.searchsorted(begins, np.arange(0, len(track), _BATCH), side="right") - 1]
    return np.split(np.arange(len(track)), np.unique(cuts)[1:]) if len(track) else []


def _moves(pairs: Paired, share: Array, tracks: slice) -> tuple[Array, Array, Array]:
    """What pairs do to a run of tracks.

    Returns:
        mean shifts (4, models, n), changes of covariances about the old means (4, 4, models, n),
        and what is less of the covariances with errors of frames (4, errors, models, n).
    """
    weight, inverse = pairs.innovations.weights()
    state = pairs.innovations.state
    states = tracks if pairs.owner is None else slice(state[0], state[-1] + 1)
    sums = Sums(state - states.start, states.stop - states.start)
    bent = sums.of((weight[:, None] * weight - inverse) * share)
    shift, change = moved(pairs.told.push[..., states], sums.of(weight * share), bent)
    less = np.zeros((4, 0, *shift.shape[1:]))
    if pairs.told.push_shared.shape[1]:
        less = _learnt(pairs.told, states, sums.of(inverse * share))
    if pairs.owner is None:
        return shift, change, less
    by_track = Sums(pairs.owner[states] - tracks.start, tracks.stop - tracks.start)
    return by_track.of(shift), by_track.of(change), by_track.of(less)


def _learnt(told: Foretold, states: slice | Indices, inverse: Array) -> Array:
    """Decrease (4, errors, models, n) of the covariance with errors of frames."""
    across = np.einsum("rsmn,semn->remn", inverse, told.push_shared[..., states])
    return np.asarray(np.einsum("ramn,remn->aemn", told.push[..., states], across))


class Sums:
    """Sums over what belongs to each of some owners, and comes by owner."""

    def __init__(self, owner: Indices, owners: int) -> None:
        self._owners = owners
        self._begins = beginnings(owner)
        self._owner = owner[self._begins]

    def of(self, values: Array) -> Array:
        """(..., k) to (..., owners)."""
        total = np.zeros((*values.shape[:-1], self._owners))
        if self._owner.size:
            total[..., self._owner] = np.add.reduceat(values, self._begins, axis=-1)
        return total


def _ends(offset_s: Array) -> Array:
    """The earliest and the latest instant; one if they are one."""
    if not offset_s.size:
        return np.zeros(1)
    ends = np.array([offset_s.min(), offset_s.max()])
    return ends if ends[0] < ends[1] else ends[:1]


def _foretold(bank: Bank, scan: Scan, offset_s: Array | float) -> Foretold:
    expected = scan.plots.expected(bank.mean, offset_s)
    return foretold(expected, bank, scan.common)


def _within(
    readings: Readings, told: Foretold, state: Indices, plot: Indices, gate: float
) -> tuple[Indices, Innovations]:
    """Which of some pairs are within the gate, and their innovations."""
    kept, found = [], []
    for begin in range(0, max(len(state), 1), _BATCH):
        batch = slice(begin, begin + _BATCH)
        every = innovations(readings, told, state[batch], plot[batch])
        inside = np.flatnonzero((every.distance_squared() <= gate).any(axis=0))
        kept.append(begin + inside)
        found.append(every.take(inside))
    return np.concatenate(kept), joined_innovations(found)
