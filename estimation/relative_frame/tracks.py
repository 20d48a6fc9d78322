"""Target logs that are tracks: what of them is new, and what happens when that is not asked.

A track's errors are correlated in time: its filter keeps an error for the length of its memory.
Used at every instant as if it were a plot, it counts each measurement many times (NEES 14 for a
registration). What a filter learnt between two reports is the information it gained, P^-1 after
less P^-1 predicted: those increments are independent, and where one plot came in they are that
plot. Without the filter's model, take tracks only as far apart as their memory.

Source: Frenkel, "Multisensor tracking of ballistic targets", SPIE 2561, 1995; Drummond, "Track
and tracklet fusion filtering", SPIE 4728, 2002 (inverse Kalman filter).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike, transposed
from estimation.relative_frame.logs import PolarLogs
from estimation.relative_frame.matrices import Indices, inverse, times

_APART = 3.0  # memories between two uses of a track: their errors share 5 %
_HARMFUL = 0.1  # correlation of successive errors from which a covariance is called wrong
_NOTHING = 1e-9  # information on a velocity, by that on position, below which there is none


class TrackLog(NamedTuple):
    """A track's state in its carrier's axes: position east, north, then velocity, ...

    Attributes:
        state: (..., n) [m, m, m/s, m/s ...], n >= 2.
        covariance: (..., n, n).
    """

    state: Array
    covariance: Array


class MotionModel(NamedTuple):
    """What the filter assumed from one report to the next: state -> transition state + noise."""

    transition: Array  # (n, n)
    noise: Array  # (n, n) its covariance


class Increment(NamedTuple):
    """What a filter learnt since its last report: y (..., n) and Y (..., n, n)."""

    vector: Array
    matrix: Array


def equivalent_measurement(before: TrackLog, now: TrackLog, model: MotionModel) -> Increment:
    """The information a track gained between two of its reports, free of all it knew before.

    Args:
        before: the last report, (..., n).
        now: this report.
        model: of the motion between them, as the filter had it.
    """
    predicted = inverse(model.transition @ before.covariance @ model.transition.T + model.noise)
    after = inverse(now.covariance)
    vector = times(after, now.state) - times(predicted, times(model.transition, before.state))
    return Increment(vector, after - predicted)


def as_plots(gained: Increment) -> tuple[Array, Array]:
    """Position (..., 2) [m] and covariance (..., 2, 2) that say the same of a target's place.

    One plot between two reports comes back exactly. Of several, what they say of the velocity is
    left out (its part of the information is eliminated, not assumed).
    """
    place, cross, rest = _blocks(gained.matrix)
    vector = gained.vector[..., :2]
    if rest.shape[-1]:
        scale = np.abs(place).max(axis=(-2, -1), keepdims=True)
        known = np.where(np.abs(rest) > _NOTHING * scale, rest, 0.0)
        pull = cross @ np.linalg.pinv(known, hermitian=True)
        place = place - pull @ transposed(cross)
        vector = vector - times(pull, gained.vector[..., 2:])
    covariance = inverse(place)
    return times(covariance, vector), covariance


def plots_of_tracks(before: TrackLog, now: TrackLog, model: MotionModel) -> PolarLogs:
    """Logs (..., L) as if the plots themselves had been sent.

    Raises:
        ValueError: a plot lies at the carrier itself, where it has no bearing.
    """
    return PolarLogs.from_east_north(*as_plots(equivalent_measurement(before, now, model)))


def _blocks(matrix: Array) -> tuple[Array, Array, Array]:
    return matrix[..., :2, :2], matrix[..., :2, 2:], matrix[..., 2:, 2:]


def memory_s(before: TrackLog, now: TrackLog, model: MotionModel, interval_s: float) -> Array:
    """Time (...) in which a track forgets an error to 1/e; infinite when it never does.

    An error passes from report to report through (1 - K H) F = P P_predicted^-1 F; its largest
    eigenvalue is what is left of it.
    """
    predicted = model.transition @ before.covariance @ model.transition.T + model.noise
    kept = now.covariance @ inverse(predicted) @ model.transition
    left = np.abs(np.linalg.eigvals(kept)).max(axis=-1)
    with np.errstate(divide="ignore"):
        memory: Array = interval_s / -np.log(np.clip(left, 1e-12, 1.0))
    return memory


class Reuse(NamedTuple):
    """What using a track again does.

    Attributes:
        correlation: of the errors at successive uses.
        inflation: how many times too small the covariance of a mean over many uses is.
        warning: a sentence when that is harmful, else empty.
    """

    correlation: float
    inflation: float
    warning: str


def reuse(interval_s: float, memory_s: float) -> Reuse:
    """Judge the use of a track every `interval_s` as if each log were a new measurement.

    Args:
        interval_s: between two uses of the same track.
        memory_s: of its filter (`memory_s`, or what the source declares); 0 for plots.
    """
    correlation = float(np.exp(-interval_s / memory_s)) if memory_s > 0 else 0.0
    if correlation >= 1:
        return Reuse(1.0, float("inf"), "this track never forgets an error: use it once")
    inflation = (1 + correlation) / (1 - correlation)
    warning = ""
    if correlation > _HARMFUL:
        warning = (
            f"a track with a memory of {memory_s:.3g} s is used every {interval_s:.3g} s: "
            f"covariances come out {inflation:.2g} times too small; send increments or plots, "
            f"or use it every {_APART * memory_s:.3g} s"
        )
    return Reuse(correlation, inflation, warning)


def thinned(times_s: ArrayLike, memory_s: float) -> Indices:
    """Which of a track's reports at (n,) times to use: as far apart as three memories."""
    chosen: list[int] = []
    moments = np.asarray(times_s, dtype=float)
    for index, moment in enumerate(moments):
        if not chosen or moment - moments[chosen[-1]] >= _APART * memory_s:
            chosen.append(index)
    return np.array(chosen, dtype=np.intp)
