"""Normal equations of many carriers' logs, the targets eliminated, and their solution.

A frame is (q, D) or, where range errors are sought, (q, D, bias, scale): W numbers; bias + scale *
range is added to a range. The prior of all frames together comes as a function of whitened
coordinates z, in which it is the unit Gaussian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.frames import wrap_pi
from estimation.relative_frame.matrices import Indices, inverse, solved, times

_STEPS = 40

FramesAt: TypeAlias = Callable[[Array], tuple[Array, Array]]
"""Whitened coordinates z (n,) -> frames (N, W) and their derivative (N W, n)."""


@dataclass(frozen=True, eq=False, slots=True)
class NetworkLogs:
    """Target logs of all carriers in one table, one log a row.

    Attributes:
        carrier: (M,) who measured, 0 the own carrier.
        target: (M,) which target, numbered from 0 without regard to who sees it.
        bearing_rad: (M,) from the measuring carrier's own north.
        range_m: (M,) level ranges; nan = bearing only.
        covariance: (M, 2, 2) of (bearing, range); of a bearing only [0, 0] counts.
    """

    carrier: Indices
    target: Indices
    bearing_rad: Array
    range_m: Array
    covariance: Array

    def take(self, which: NDArray[np.bool_]) -> NetworkLogs:
        """Some of the logs, by a mask (M,)."""
        return NetworkLogs(
            self.carrier[which],
            self.target[which],
            self.bearing_rad[which],
            self.range_m[which],
            self.covariance[which],
        )


class Rows(NamedTuple):
    """Whitened conditions of all logs, two rows each (the second empty for a bearing)."""

    by_frame: Array  # (M, 2, W) of the log's carrier
    by_target: Array  # (M, 2, 2)
    misclosure: Array  # (M, 2)
    back: Array  # (M, 2, 2) takes a whitened residual to corrections of (bearing, range)


class Normal(NamedTuple):
    """Normal equations of the frames with the targets eliminated, and the way back to them."""

    matrix: Array  # (W N, W N)
    vector: Array  # (W N,)
    target_inverse: Array  # (T, 2, 2)
    cross: Array  # (T, 2, W N)
    target_vector: Array  # (T, 2)


class Adjusted(NamedTuple):
    """Where the iteration ended.

    Attributes:
        z: (n,) whitened coordinates.
        frames: (N, W), tangent: (N W, n) their derivative.
        whole: (n, n) information on z, the prior's unit matrix included.
        normal: of the targets alone, at the end.
        targets_m: (T, 2) in own axes.
        residual: (M, 2) whitened, of every log used.
        converged: False: not to be used.
    """

    z: Array
    frames: Array
    tangent: Array
    whole: Array
    normal: Normal
    targets_m: Array
    residual: Array
    converged: bool


def adjusted(
    logs: NetworkLogs,
    frames_at: FramesAt,
    size: int,
    doubt_m: Callable[[int], Array],
    sharp: int = 0,
    still: float = 1e-6,
) -> Adjusted:
    """Steps of all frames and targets until nothing moves.

    Args:
        size: n, of the whitened coordinates.
        doubt_m: (N,) how far off each carrier may still be held at a step, see `rows_of`.
        sharp: the step from which on it is none.
        still: posterior sigmas below which a step is the last.
    """
    z, v = np.zeros(size), np.zeros((len(logs.carrier), 2))
    frames, tangent = frames_at(z)
    targets = first_targets(logs, frames)
    for count in range(_STEPS):
        rows = rows_of(logs, frames, targets, v, doubt_m(count))
        normal = normal_of(logs, rows, len(frames), len(targets))
        whole = np.eye(size) + tangent.T @ normal.matrix @ tangent
        step = solved(whole, (tangent.T @ normal.vector - z)[:, None])[:, 0]
        moved = tangent @ step
        shift = times(normal.target_inverse, normal.target_vector - normal.cross @ moved)
        residual = residual_of(logs, rows, moved, shift)
        z, targets, v = z + step, targets + shift, times(rows.back, residual)
        frames, tangent = frames_at(z)
        arrived = bool(count >= sharp and step @ whole @ step < still**2)
        if arrived:
            break
    return Adjusted(z, frames, tangent, whole, normal, targets, residual, arrived)


def informative(logs: NetworkLogs) -> NetworkLogs:
    """The logs of targets measured more often than they have coordinates.

    A range and bearing of one carrier alone, or two bearings, fix the target and nothing else:
    they say nothing of the frames, and two nearly parallel bearings put it anywhere.
    """
    conditions = np.zeros(int(logs.target.max(initial=-1)) + 1, dtype=int)
    np.add.at(conditions, logs.target, 1 + np.isfinite(logs.range_m))
    use = conditions[logs.target] > 2
    return NetworkLogs(
        logs.carrier[use],
        logs.target[use],
        logs.bearing_rad[use],
        logs.range_m[use],
        logs.covariance[use],
    )


def first_targets(logs: NetworkLogs, frames: Array) -> Array:
    """Where the logs put the targets under the prior: mean of places, else crossing of bearings."""
    frame = frames[logs.carrier]
    bearing = logs.bearing_rad + frame[:, 2]
    along = np.stack([np.sin(bearing), np.cos(bearing)], axis=1)
    across = np.stack([along[:, 1], -along[:, 0]], axis=1)
    ranged = np.isfinite(logs.range_m)
    # a weak pull to 10 km along keeps a lone bearing regular; it only has to be near
    reach = np.where(ranged, logs.range_m, 1e4)
    weight = np.where(ranged, 1.0, 1e-3)[:, None, None] * (along[:, :, None] * along[:, None])
    weight += across[:, :, None] * across[:, None]
    place = frame[:, :2] + reach[:, None] * along
    count = int(logs.target.max(initial=-1)) + 1
    total, pulled = np.zeros((count, 2, 2)), np.zeros((count, 2))
    np.add.at(total, logs.target, weight)
    np.add.at(pulled, logs.target, times(weight, place))
    unseen = np.trace(total, axis1=1, axis2=2) == 0
    total[unseen] = np.eye(2)
    return times(inverse(total), pulled)


def rows_of(logs: NetworkLogs, frames: Array, targets: Array, v: Array, doubt_m: Array) -> Rows:
    """Whitened conditions of every log at the current frames and targets."""
    ranged = np.isfinite(logs.range_m)
    frame, target = frames[logs.carrier], targets[logs.target]
    places = _place_rows(logs, frame, target, v)
    if ranged.all():
        return places
    bearings = _bearing_rows(logs, frame, target, doubt_m[logs.carrier])
    return Rows(
        *(
            np.where(ranged.reshape(-1, *[1] * (a.ndim - 1)), a, b)
            for a, b in zip(places, bearings, strict=True)
        )
    )


def _place_rows(logs: NetworkLogs, frame: Array, target: Array, v: Array) -> Rows:
    """Bearing and range: q + R(D) p - t = 0, at the adjusted measurements (Gauss-Helmert)."""
    width = frame.shape[1]
    measured = np.nan_to_num(logs.range_m, nan=1.0) + v[:, 1]
    ranges = np.stack([np.ones_like(measured), measured], axis=1)[:, : width - 3]
    stretch = 1.0 + frame[:, 4] if width > 4 else 1.0
    reach = measured + (ranges * frame[:, 3:]).sum(axis=1)
    bearing = logs.bearing_rad + v[:, 0] + frame[:, 2]
    sin, cos = np.sin(bearing), np.cos(bearing)
    x, y = reach * sin, reach * cos
    by_measured = np.stack([y, sin * stretch, -x, cos * stretch], axis=1).reshape(-1, 2, 2)
    spread = by_measured @ logs.covariance @ transposed(by_measured)
    whiten = inverse(np.linalg.cholesky(np.where(np.isfinite(spread), spread, np.eye(2))))
    place = frame[:, :2] + np.stack([x, y], axis=1)
    by_frame = np.zeros((len(x), 2, width))
    by_frame[:, 0, 0] = by_frame[:, 1, 1] = 1
    by_frame[:, 0, 2], by_frame[:, 1, 2] = y, -x
    by_frame[:, 0, 3:], by_frame[:, 1, 3:] = sin[:, None] * ranges, cos[:, None] * ranges
    misclosure = place - target - times(by_measured, v)
    back = -np.nan_to_num(logs.covariance) @ transposed(by_measured) @ transposed(whiten)
    return Rows(whiten @ by_frame, -whiten, times(whiten, misclosure), back)


def _bearing_rows(logs: NetworkLogs, frame: Array, target: Array, doubt_m: Array) -> Rows:
    """Bearing only: bearing of (t - q) less D less the measured, in sigmas; nothing to adjust.

    `doubt_m` (M,) is how far off the carrier may still be held: it blurs bearings of near targets.
    """
    x, y = (target - frame[:, :2]).T
    squared = np.maximum(x**2 + y**2, 1.0)
    sigma = np.sqrt(logs.covariance[:, 0, 0] + doubt_m**2 / squared)
    by_target, by_frame = np.zeros((len(x), 2, 2)), np.zeros((len(x), 2, frame.shape[1]))
    by_target[:, 0] = np.stack([y, -x], axis=1) / (squared * sigma)[:, None]
    by_frame[:, 0, :2] = -by_target[:, 0]
    by_frame[:, 0, 2] = -1 / sigma
    misclosure = np.zeros((len(x), 2))
    misclosure[:, 0] = wrap_pi(np.arctan2(x, y) - frame[:, 2] - logs.bearing_rad) / sigma
    return Rows(by_frame, by_target, misclosure, np.zeros((len(x), 2, 2)))


def normal_of(logs: NetworkLogs, rows: Rows, carriers: int, targets: int) -> Normal:
    """Sum the logs' normal equations, then eliminate every target."""
    width = rows.by_frame.shape[2]
    to_frame, to_target = transposed(rows.by_frame), transposed(rows.by_target)
    blocks, vector = np.zeros((carriers, width, width)), np.zeros((carriers, width))
    own, vector_t = np.zeros((targets, 2, 2)), np.zeros((targets, 2))
    pairs = np.zeros((targets * carriers, 2, width))
    np.add.at(blocks, logs.carrier, to_frame @ rows.by_frame)
    np.add.at(vector, logs.carrier, -times(to_frame, rows.misclosure))
    np.add.at(own, logs.target, to_target @ rows.by_target)
    np.add.at(vector_t, logs.target, -times(to_target, rows.misclosure))
    np.add.at(pairs, logs.target * carriers + logs.carrier, to_target @ rows.by_frame)
    matrix = np.zeros((carriers, width, carriers, width))
    matrix[np.arange(carriers), :, np.arange(carriers)] = blocks
    cross = pairs.reshape(targets, carriers, 2, width).swapaxes(1, 2)
    flat = cross.reshape(targets, 2, width * carriers)
    free = _free(own, ranged=bool(np.isfinite(logs.range_m).all()))
    pull = transposed(flat) @ free
    return Normal(
        matrix.reshape(width * carriers, width * carriers) - (pull @ flat).sum(axis=0),
        vector.ravel() - times(pull, vector_t).sum(axis=0),
        free,
        flat,
        vector_t,
    )


def _free(own: Array, *, ranged: bool) -> Array:
    """Covariances (T, 2, 2) of the targets, the frames being known; zero where nothing is seen."""
    if not ranged:
        return np.asarray(np.linalg.pinv(own, rcond=1e-10, hermitian=True), dtype=float)
    seen = own[:, 0, 0] > 0
    covariance = inverse(np.where(seen[:, None, None], own, np.eye(2)))
    return np.asarray(np.where(seen[:, None, None], covariance, 0.0))


def residual_of(logs: NetworkLogs, rows: Rows, moved: Array, shift: Array) -> Array:
    """Whitened conditions (M, 2) after a step of frames and targets, to first order."""
    by_carrier = moved.reshape(-1, rows.by_frame.shape[2])[logs.carrier]
    return (
        rows.misclosure
        + times(rows.by_frame, by_carrier)
        + times(rows.by_target, shift[logs.target])
    )


def dof_of(logs: NetworkLogs, normal: Normal) -> int:
    """Measurements less target coordinates; the prior pays for the frames."""
    measured = len(logs.range_m) + int(np.isfinite(logs.range_m).sum())
    fixed: NDArray[np.int_] = np.linalg.matrix_rank(normal.target_inverse, hermitian=True)
    return measured - int(fixed.sum())
