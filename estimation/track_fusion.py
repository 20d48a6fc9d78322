"""Fusing sources that track by themselves: exactly by increments, else by intersection.

A track carries all its source has ever measured, and all tracks of a target share the noise of its
motion. So a track is never a fresh measurement: what a filter learnt since its last report
(`estimation.relative_frame.tracks.equivalent_measurement`) adds to the centre's information as the
measurements themselves would; where that is not sent, covariance intersection assumes nothing of
what the two have in common. No interval counts twice: `estimation.ledger`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices, transposed
from estimation.relative_frame.matrices import inverse, times
from estimation.relative_frame.tracks import Increment, MotionModel, TrackLog

_HALVINGS = 45  # of the interval in which the weight of an intersection lies


class Intersected(NamedTuple):
    """Covariance intersections.

    Attributes:
        track: (..., n).
        weight: (...) of the first; 1 - weight of the second.
    """

    track: TrackLog
    weight: Array


def predicted(track: TrackLog, model: MotionModel) -> TrackLog:
    """Tracks (..., n) one interval on."""
    covariance = model.transition @ track.covariance @ transposed(model.transition) + model.noise
    return TrackLog(times(model.transition, track.state), covariance)


def with_increments(track: TrackLog, gained: Increment, row: Indices) -> TrackLog:
    """Tracks with all increments of one instant: what a centre that had the plots would hold.

    Args:
        track: (N, n) predicted to that instant.
        gained: (K, n) in the tracks' axes.
        row: (K,) of the track that each is of.

    Source: Durrant-Whyte & Stevens, Data fusion in decentralised sensing networks, FUSION 2001,
    eqs 15 to 20.
    """
    vector, matrix = np.zeros_like(track.state), np.zeros_like(track.covariance)
    np.add.at(vector, row, gained.vector)
    np.add.at(matrix, row, gained.matrix)
    identity = np.eye(track.state.shape[-1])
    covariance = track.covariance @ inverse(identity + matrix @ track.covariance)
    covariance = (covariance + transposed(covariance)) / 2
    surprise = vector - times(matrix, track.state)
    return TrackLog(track.state + times(covariance, surprise), covariance)


def information_of(log: TrackLog, size: int) -> Increment:
    """All that logs (..., m) say of the first m of `size` components, as information."""
    known = log.state.shape[-1]
    matrix = np.zeros((*log.state.shape[:-1], size, size))
    matrix[..., :known, :known] = inverse(log.covariance)
    vector = np.zeros((*log.state.shape[:-1], size))
    vector[..., :known] = times(matrix[..., :known, :known], log.state)
    return Increment(vector, matrix)


def covariance_intersection(track: TrackLog, said: Increment) -> Intersected:
    """Tracks (..., n) and what others say of the same targets, whatever the two share.

    P^-1 = w A + (1 - w) B with the weight that makes det P least; it is conservative for every
    correlation of the two, and where one says nothing the other is returned.

    Args:
        track: (..., n).
        said: (..., n) such as `information_of` another track.

    Source: Julier & Uhlmann, A non-divergent estimation algorithm in the presence of unknown
    correlations, ACC 1997, eqs 7 and 8.
    """
    weight = _least_determinant(track.covariance, said.matrix)
    share = weight[..., None]
    own = inverse(track.covariance)
    covariance = inverse(share[..., None] * own + (1.0 - share[..., None]) * said.matrix)
    surprise = (1.0 - share) * (said.vector - times(said.matrix, track.state))
    state = track.state + times(covariance, surprise)
    return Intersected(TrackLog(state, covariance), weight)


def _least_determinant(covariance: Array, information: Array) -> Array:
    """The weight (...) in [0, 1] for which det(w P^-1 + (1 - w) Y) is largest.

    With the eigenvalues u of L' Y L, P = L L', it is the root of a decreasing function,
    sum (1 - u) / (w + (1 - w) u).
    """
    factor = np.asarray(np.linalg.cholesky(covariance), dtype=float)
    values = np.maximum(np.linalg.eigvalsh(transposed(factor) @ information @ factor), 0.0)
    low, high = np.zeros(values.shape[:-1]), np.ones(values.shape[:-1])
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        share = middle[..., None]
        rising = np.sum((1.0 - values) / (share + (1.0 - share) * values), axis=-1) > 0
        low, high = np.where(rising, middle, low), np.where(rising, high, middle)
    return np.where(high == 1.0, 1.0, np.where(low == 0.0, 0.0, (low + high) / 2))
