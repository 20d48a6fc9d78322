"""Exact probabilities of pairs in small groups of tracks and plots that form loops.

Where two tracks vie for the same two plots, belief propagation is sure of the likelier of the two
ways (Bethe's approximation of a permanent of 2 x 2 is the larger of its terms), be it only a little
likelier: tracks side by side are then driven apart. Groups of a few tracks are summed over
completely instead, all of one size at once.

Source: of what belief propagation does there, Vontobel, The Bethe permanent of a nonnegative
matrix, IEEE Trans. IT 59(3), 2013. The sum is dynamic programming over sets of tracks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices

_TRACKS, _PLOTS = 5, 10  # at most, of a group: time grows with plots * tracks * 2^tracks
_SLIGHT = 1e-3  # share of the geometric mean of what both ends have best


class Summed(NamedTuple):
    """Rows (k,) of the pairs in such groups, and the probability (k,) of each."""

    pair: Indices
    probability: Array


def summed(track: Indices, plot: Indices, weight: Array) -> Summed:
    """Probabilities of the pairs of all groups that have a loop and are small.

    Pairs that are slight beside what both of their ends have instead belong to no group.

    Args:
        track, plot: (K,) ends of each pair, none twice.
        weight: (K,) likelihood of a pair over that of both staying alone.
    """
    tracks, plots = (int(ends.max(initial=-1)) + 1 for ends in (track, plot))
    best = _best(track, weight, tracks)[track] * _best(plot, weight, plots)[plot]
    rows = np.flatnonzero(weight**2 > _SLIGHT**2 * best)
    rows = rows[_looped(track[rows], plot[rows], tracks, plots)]
    if not rows.size:
        return Summed(rows, np.empty(0))
    group = _groups(track[rows], plot[rows], tracks, plots)
    i, height = _within(group, track[rows])
    j, width = _within(group, plot[rows])
    small = (height[group] <= _TRACKS) & (width[group] <= _PLOTS)
    rows, group, i, j = (part[small] for part in (rows, group, i, j))
    probability = np.empty(len(rows))
    for n in np.unique(height[group]):
        alike = np.flatnonzero(height[group] == n)
        _, which = np.unique(group[alike], return_inverse=True)
        at = which, i[alike], j[alike]
        table = np.zeros((int(which.max()) + 1, int(n), int(j[alike].max()) + 1))
        table[at] = weight[rows[alike]]
        probability[alike] = _enumerated(table)[at]
    return Summed(rows, probability)


def _best(ends: Indices, weight: Array, size: int) -> Array:
    """(size,) largest weight at each end, or 1: it may stay alone."""
    best = np.ones(size)
    np.maximum.at(best, ends, weight)
    return best


def _looped(track: Indices, plot: Indices, tracks: int, plots: int) -> Indices:
    """Pairs that hang together with a loop: what is left when dead ends are cut off, and around."""
    left = np.arange(len(track))
    while left.size:
        begun, ended = track[left], plot[left]
        dead = np.bincount(begun, minlength=tracks)[begun] == 1
        dead |= np.bincount(ended, minlength=plots)[ended] == 1
        if not dead.any():
            break
        left = left[~dead]
    reached = -1
    while left.size > reached:
        reached = left.size
        of_track, of_plot = np.zeros(tracks, dtype=bool), np.zeros(plots, dtype=bool)
        of_track[track[left]] = of_plot[plot[left]] = True
        left = np.flatnonzero(of_track[track] | of_plot[plot])
    return left


def _groups(track: Indices, plot: Indices, tracks: int, plots: int) -> Indices:
    """(K,) number of the group of each pair, from 0: the least of its tracks, passed on."""
    group, before = track, np.full_like(track, -1)
    while not np.array_equal(group, before):
        before, of_plot, of_track = group, np.full(plots, tracks), np.full(tracks, tracks)
        np.minimum.at(of_plot, plot, group)
        np.minimum.at(of_track, track, of_plot[plot])
        group = of_track[track]
    _, group = np.unique(group, return_inverse=True)
    return group


def _within(group: Indices, end: Indices) -> tuple[Indices, Indices]:
    """Number (K,) of each pair's end among those of its group; how many (groups,) it has."""
    span = int(end.max()) + 1
    each, of_pair = np.unique(group * span + end, return_inverse=True)
    whose = each // span
    size = np.bincount(whose)
    first = np.cumsum(size) - size
    return (np.arange(len(each)) - first[whose])[of_pair], size


def _enumerated(weight: Array) -> Array:
    """Probabilities (C, n, m) of pairs of n tracks and m plots, over all sets of pairs.

    Plot after plot: `given[j]` is the weight of all that plots before j may be, by the set of
    tracks they take; `left` that of all that the others may be, by the set already taken.
    """
    cases, n, m = weight.shape
    masks = np.arange(2**n)
    free = [masks[masks >> t & 1 == 0] for t in range(n)]
    given = [np.zeros((cases, 2**n))]
    given[0][:, 0] = 1.0
    for j in range(m):
        after = given[j].copy()
        for t in range(n):
            after[:, free[t] | 1 << t] += given[j][:, free[t]] * weight[:, t, j, None]
        given.append(after)
    left, pair = np.ones((cases, 2**n)), np.empty_like(weight)
    for j in reversed(range(m)):
        now = left.copy()
        for t in range(n):
            taken = left[:, free[t] | 1 << t] * weight[:, t, j, None]
            pair[:, t, j] = (given[j][:, free[t]] * taken).sum(axis=1)
            now[:, free[t]] += taken
        left = now
    return np.asarray(pair / left[:, 0, None, None])
