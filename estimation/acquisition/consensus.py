"""Frames when nothing is known of the heading: pairs of targets with equal distances, by vote.

The distance of two targets needs no frame. Two own logs and two of the other's at the same
distance, taken as the same two targets, give a turn and a shift; right ones agree, wrong ones
scatter. They vote in cells of (place of the other's picture, D), and the fullest cells are tried.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.acquisition.innovation import Frames
from estimation.acquisition.problem import Problem, Side
from estimation.arrays import Array, Indices, transposed
from estimation.frames import polar_from_east_north, rotation_clockwise, wrap_pi

_SIGMAS = 3.0  # that the two distances may differ
_LEAST_SEPARATION = 4.0  # sigmas of the distance: nearer targets tell no heading
_MOST_VOTES = 300_000
_UNLIKELY = -4.0  # log ratio of features at which two pairs have no vote
_CELL_SIGMAS = 4.0  # the width of a cell, which is counted with its neighbours
_CELLS_ACROSS, _CELLS_AROUND = 120, 120


class _Lines(NamedTuple):
    """Pairs of one carrier's logs: ends, separation with its variance, direction, middle."""

    start: Indices
    end: Indices
    separation_m: Array
    variance: Array
    bearing_rad: Array
    middle_m: Array

    def take(self, which: Indices) -> _Lines:
        return _Lines(
            self.start[which],
            self.end[which],
            self.separation_m[which],
            self.variance[which],
            self.bearing_rad[which],
            self.middle_m[which],
        )


class _Votes(NamedTuple):
    """Frames by the place (n, 2) [m] of the middle of the other's picture, and D (n)."""

    place_m: Array
    turn_rad: Array


def consensus(given: Problem, prior: Frames, most: int, gate: float) -> Frames:
    """At most `most` frames that many pairs of pairs agree on, with the size of a cell as sigma.

    Args:
        prior: B = 1; what it says of D may be next to nothing.
        gate: chi-squared of 3 within which a frame agrees with the prior.
    """
    middle = given.other.state[:, :2].mean(axis=0) if given.other.count else np.zeros(2)
    votes = _votes(given, middle)
    off = _frame_t(votes, middle) - prior.t[0]
    weight = np.linalg.inv(prior.covariance[0])
    likely = np.einsum("ni,ij,nj->n", off, weight, off) < gate
    votes = _Votes(votes.place_m[likely], votes.turn_rad[likely])
    sides = (given.own, given.other)
    sigma = np.sqrt(sum(np.trace(s.covariance[:, :2, :2].mean(axis=0)) / 2 for s in sides))
    return _fullest(votes, middle, _CELL_SIGMAS * float(sigma), most)


def _frame_t(votes: _Votes, middle_m: Array) -> Array:
    """(n, 3) the frames that votes stand for."""
    q = votes.place_m - rotation_clockwise(votes.turn_rad) @ middle_m
    return np.column_stack([q, votes.turn_rad])


def _votes(given: Problem, middle_m: Array) -> _Votes:
    """What every own line and every line of the other's of its length, in both senses, imply."""
    own, other = _lines(given.own), _lines(given.other)
    other = other.take(np.argsort(other.separation_m, kind="stable"))
    mine, theirs = _alike(own, other)
    one = given.log_ratio[own.start[mine], other.start[theirs]]
    two = given.log_ratio[own.end[mine], other.end[theirs]]
    allowed = one + two > _UNLIKELY
    mine, theirs = mine[allowed], theirs[allowed]
    turn = wrap_pi(own.bearing_rad[mine] - other.bearing_rad[theirs])
    lever = middle_m - other.middle_m[theirs]
    place = own.middle_m[mine] + (rotation_clockwise(turn) @ lever[..., None])[..., 0]
    return _Votes(place, turn)


def _lines(side: Side) -> _Lines:
    """All ordered pairs of logs."""
    start, end = np.nonzero(~np.eye(side.count, dtype=bool))
    place = side.state[:, :2]
    bearing, separation = polar_from_east_north(place[end] - place[start])
    along = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    spread = (side.covariance[start] + side.covariance[end])[:, :2, :2]
    variance = np.einsum("ni,nij,nj->n", along, spread, along)
    middle = (place[start] + place[end]) / 2
    lines = _Lines(start, end, separation, variance, bearing, middle)
    long = separation > _LEAST_SEPARATION * np.sqrt(variance)
    return lines.take(np.flatnonzero(long))


def _alike(own: _Lines, other: _Lines) -> tuple[Indices, Indices]:
    """Indices of own lines (one sense of each) and of other's lines of the same length.

    Of many own lines an even sample is taken, so that the votes stay within bounds.
    """
    once = np.flatnonzero(own.start < own.end)
    if not (once.size and other.start.size):
        return once[:0], once[:0]
    reach = _SIGMAS * np.sqrt(own.variance[once] + other.variance.max())
    low = np.searchsorted(other.separation_m, own.separation_m[once] - reach)
    high = np.searchsorted(other.separation_m, own.separation_m[once] + reach)
    sample = slice(None, None, 1 + int((high - low).sum()) // _MOST_VOTES)
    once, low, count = once[sample], low[sample], (high - low)[sample]
    mine = np.repeat(once, count)
    first = np.repeat(low - np.cumsum(count) + count, count)
    theirs = first + np.arange(mine.size)
    apart = np.abs(own.separation_m[mine] - other.separation_m[theirs])
    close = apart < _SIGMAS * np.sqrt(own.variance[mine] + other.variance[theirs])
    return mine[close], theirs[close]


def _fullest(votes: _Votes, middle_m: Array, cell_m: float, most: int) -> Frames:
    """The frames of the fullest cells, counted with their neighbours, the fullest first."""
    if not votes.turn_rad.size:
        return Frames(np.zeros((0, 3)), np.zeros((0, 3, 3)))
    low, high = votes.place_m.min(axis=0), votes.place_m.max(axis=0)
    cell_m = max(cell_m, float((high - low).max()) / _CELLS_ACROSS)
    cell_rad = 2 * np.pi / _CELLS_AROUND
    across = np.floor((votes.place_m - low) / cell_m).astype(np.intp) + 1
    around = np.floor((votes.turn_rad + np.pi) / cell_rad).astype(np.intp) % _CELLS_AROUND
    shape = (*(across.max(axis=0) + 2), _CELLS_AROUND)
    at = np.ravel_multi_index((across[:, 0], across[:, 1], around), shape)
    count = np.bincount(at, minlength=int(np.prod(shape))).reshape(shape)
    for axis in range(3):  # the margins of places are empty, the turn closes on itself
        count = count + np.roll(count, 1, axis) + np.roll(count, -1, axis)

    found = []
    for _ in range(most):
        peak = np.unravel_index(int(np.argmax(count)), shape)
        if count[peak] == 0:
            break
        found.append(_mean_vote(votes, across, around, peak))
        x, y = (slice(max(k - 2, 0), k + 3) for k in peak[:2])
        count[x, y, np.arange(peak[2] - 2, peak[2] + 3) % _CELLS_AROUND] = 0
    return _about(np.array(found), middle_m, cell_m, cell_rad)


def _mean_vote(votes: _Votes, across: Indices, around: Indices, peak: tuple[np.intp, ...]) -> Array:
    """(3,) mean place and turn of the votes in a cell and its neighbours."""
    near = (np.abs(across - np.array(peak[:2])) <= 1).all(axis=1)
    near &= (around - peak[2] + 1) % _CELLS_AROUND <= 2
    turn = votes.turn_rad[near]
    mean_turn = turn[0] + wrap_pi(turn - turn[0]).mean()
    return np.array([*votes.place_m[near].mean(axis=0), mean_turn])


def _about(found: Array, middle_m: Array, cell_m: float, cell_rad: float) -> Frames:
    """Frames of mean votes (n, 3), uncertain by a cell in place and turn."""
    t = _frame_t(_Votes(found[:, :2], found[:, 2]), middle_m)
    t[:, 2] = wrap_pi(t[:, 2])
    lever = found[:, :2] - t[:, :2]  # R(D) middle
    by_place_and_turn = np.tile(np.eye(3), (len(t), 1, 1))
    by_place_and_turn[:, 0, 2], by_place_and_turn[:, 1, 2] = -lever[:, 1], lever[:, 0]
    root = by_place_and_turn * (np.array([cell_m, cell_m, cell_rad]) / 2)
    return Frames(t, root @ transposed(root))
