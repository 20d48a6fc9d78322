"""Frames of many carriers at once, from every overlap of every two, three or more of them.

In pairs with the own carrier, only targets that it sees itself count. Jointly, a target that
carriers 3 and 5 share ties 3 to 5, and through 5's own targets to the gauge: at partial coverage
that is most of the information. Targets' positions are unknowns of the whole adjustment and are
eliminated one by one (Schur), so the work grows with the logs, not with the targets cubed.

The gauge is the own carrier, number 0: its frame is (0, 0). Carriers may measure bearings only.

Source: Triggs, McLauchlan, Hartley & Fitzgibbon, "Bundle adjustment - a modern synthesis", 2000.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.frames import wrap_pi
from estimation.relative_frame.gauge import root_of
from estimation.relative_frame.logs import OwnAxesFrame
from estimation.relative_frame.matrices import Indices, inverse, solved, times

_STEPS, _STILL = 40, 1e-6
_GRADUAL, _SHARPER = 12, 0.6  # steps in which bearings of near targets are sharpened


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


class NetworkPrior(NamedTuple):
    """What navigation says of N carriers, the own one first.

    Attributes:
        offset_m: (N, 2) reported positions from the own carrier; row 0 is not used.
        offset_covariance: (N, 2, 2) of them.
        sigma_c_rad: (N,) of each carrier's north.
    """

    offset_m: Array
    offset_covariance: Array
    sigma_c_rad: Array


class NetworkFrames(NamedTuple):
    """Frames of all carriers in own axes; those of different carriers are correlated.

    Attributes:
        q_m: (N, 2), D_rad: (N,) as in `OwnAxesFrame`; zero for the own carrier.
        covariance: (3 N, 3 N) of (q, D) of carrier 0, 1, ...; zero in the own carrier's rows.
        information: (3 N, 3 N) of the targets alone, before the prior.
        prior_covariance: (3 N, 3 N) of the prior alone, at the estimate.
        targets_m: (T, 2) in own axes.
        chi2: misclosure; chi-squared of `dof`.
        dof: measurements less the coordinates of targets that they fix.
        converged: False: not to be used.
    """

    q_m: Array
    D_rad: Array
    covariance: Array
    information: Array
    prior_covariance: Array
    targets_m: Array
    chi2: float
    dof: int
    converged: bool

    def frame(self, carrier: int) -> OwnAxesFrame:
        """One carrier's frame alone."""
        part = slice(3 * carrier, 3 * carrier + 3)
        return OwnAxesFrame(self.q_m[carrier], self.D_rad[carrier], self.covariance[part, part])


class _Rows(NamedTuple):
    """Whitened conditions of all logs, two rows each (the second empty for a bearing)."""

    by_frame: Array  # (M, 2, 3) of the log's carrier
    by_target: Array  # (M, 2, 2)
    misclosure: Array  # (M, 2)
    back: Array  # (M, 2, 2) takes a whitened residual to corrections of (bearing, range)


class _Normal(NamedTuple):
    """Normal equations of the frames with the targets eliminated, and the way back to them."""

    matrix: Array  # (3 N, 3 N)
    vector: Array  # (3 N,)
    target_inverse: Array  # (T, 2, 2)
    cross: Array  # (T, 2, 3 N)
    target_vector: Array  # (T, 2)


def network_adjustment(logs: NetworkLogs, prior: NetworkPrior) -> NetworkFrames:
    """Joint adjustment of all carriers' frames and all targets' positions.

    Starts from the prior: for heading errors up to some ten degrees; beyond, start with
    `adjustment` of pairs. A carrier that shares nothing keeps its prior; a target that one
    carrier alone sees changes nothing.

    Raises:
        ValueError: a log names a carrier that the prior does not know.
    """
    if logs.carrier.size and int(logs.carrier.max()) >= len(prior.sigma_c_rad):
        raise ValueError(
            f"logs name carrier {int(logs.carrier.max())}, "
            f"the prior knows {len(prior.sigma_c_rad)} carriers"
        )
    root, logs = _root(prior), _informative(logs)
    sharp = 0 if np.isfinite(logs.range_m).all() else _GRADUAL
    z, v = np.zeros(root.shape[1]), np.zeros((len(logs.carrier), 2))
    frames, tangent = _frames(prior, root, z)
    targets = _first_targets(logs, frames)
    for count in range(_STEPS):
        rows = _rows(logs, frames, targets, v, _doubt_m(prior, count))
        normal = _normal(logs, rows, len(frames), len(targets))
        whole = np.eye(len(z)) + tangent.T @ normal.matrix @ tangent
        step = solved(whole, (tangent.T @ normal.vector - z)[:, None])[:, 0]
        moved = tangent @ step
        shift = times(normal.target_inverse, normal.target_vector - normal.cross @ moved)
        residual = _residual(logs, rows, moved, shift)
        z, targets, v = z + step, targets + shift, times(rows.back, residual)
        frames, tangent = _frames(prior, root, z)
        still = count >= sharp and step @ whole @ step < _STILL**2
        if still:
            break
    return NetworkFrames(
        q_m=frames[:, :2],
        D_rad=wrap_pi(frames[:, 2]),
        covariance=tangent @ inverse(whole) @ tangent.T,
        information=normal.matrix,
        prior_covariance=tangent @ tangent.T,
        targets_m=targets,
        chi2=float(np.square(residual).sum() + z @ z),
        dof=_dof(logs, normal),
        converged=bool(still),
    )


def _informative(logs: NetworkLogs) -> NetworkLogs:
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


def _doubt_m(prior: NetworkPrior, count: int) -> Array:
    """(N,) the prior's sigma of each place, less at every step and then forgotten."""
    spread = np.sqrt(np.trace(prior.offset_covariance, axis1=1, axis2=2) / 2)
    return np.asarray(spread * _SHARPER**count if count < _GRADUAL else 0.0 * spread)


def _root(prior: NetworkPrior) -> Array:
    """Square root (3 N, 3 N) of the prior of (x, y, c) of every carrier; no offset of the own."""
    count = len(prior.sigma_c_rad)
    root = np.zeros((3 * count, 3 * count))
    for carrier in range(count):
        first = 3 * carrier
        if carrier:
            block = root_of(prior.offset_covariance[carrier])
            root[first : first + 2, first : first + 2] = block
        root[first + 2, first + 2] = prior.sigma_c_rad[carrier]
    return root


def _frames(prior: NetworkPrior, root: Array, z: Array) -> tuple[Array, Array]:
    """(q, D) (N, 3) of every carrier and their derivative (3 N, 3 N) by z."""
    theta = (root @ z).reshape(-1, 3)
    c1 = theta[0, 2]
    own_from_fixed = np.array([[np.cos(c1), -np.sin(c1)], [np.sin(c1), np.cos(c1)]])
    offsets = prior.offset_m + theta[:, :2]
    frames = np.concatenate([offsets @ own_from_fixed.T, theta[:, 2:] - c1], axis=1)
    frames[0] = 0
    by_theta = np.zeros((len(frames), 3, len(frames), 3))
    for carrier in range(1, len(frames)):
        by_theta[carrier, :2, carrier, :2] = own_from_fixed
        by_theta[carrier, :, 0, 2] = -frames[carrier, 1], frames[carrier, 0], -1
        by_theta[carrier, 2, carrier, 2] = 1
    return frames, by_theta.reshape(root.shape) @ root


def _first_targets(logs: NetworkLogs, frames: Array) -> Array:
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


def _rows(logs: NetworkLogs, frames: Array, targets: Array, v: Array, doubt_m: Array) -> _Rows:
    """Whitened conditions of every log at the current frames and targets."""
    ranged = np.isfinite(logs.range_m)
    frame, target = frames[logs.carrier], targets[logs.target]
    places = _place_rows(logs, frame, target, v)
    bearings = _bearing_rows(logs, frame, target, doubt_m[logs.carrier])
    return _Rows(
        *(
            np.where(ranged.reshape(-1, *[1] * (a.ndim - 1)), a, b)
            for a, b in zip(places, bearings, strict=True)
        )
    )


def _place_rows(logs: NetworkLogs, frame: Array, target: Array, v: Array) -> _Rows:
    """Bearing and range: q + R(D) p - t = 0, at the adjusted measurements (Gauss-Helmert)."""
    reach = np.nan_to_num(logs.range_m, nan=1.0) + v[:, 1]
    bearing = logs.bearing_rad + v[:, 0] + frame[:, 2]
    sin, cos = np.sin(bearing), np.cos(bearing)
    x, y = reach * sin, reach * cos
    by_measured = np.stack([y, sin, -x, cos], axis=1).reshape(-1, 2, 2)
    spread = by_measured @ logs.covariance @ transposed(by_measured)
    whiten = inverse(np.linalg.cholesky(np.where(np.isfinite(spread), spread, np.eye(2))))
    place = frame[:, :2] + np.stack([x, y], axis=1)
    by_frame = np.zeros((len(x), 2, 3))
    by_frame[:, 0, 0] = by_frame[:, 1, 1] = 1
    by_frame[:, 0, 2], by_frame[:, 1, 2] = y, -x
    misclosure = place - target - times(by_measured, v)
    back = -np.nan_to_num(logs.covariance) @ transposed(by_measured) @ transposed(whiten)
    return _Rows(whiten @ by_frame, -whiten, times(whiten, misclosure), back)


def _bearing_rows(logs: NetworkLogs, frame: Array, target: Array, doubt_m: Array) -> _Rows:
    """Bearing only: bearing of (t - q) less D less the measured, in sigmas; nothing to adjust.

    `doubt_m` (M,) is how far off the carrier may still be held: it blurs bearings of near targets.
    """
    x, y = (target - frame[:, :2]).T
    squared = np.maximum(x**2 + y**2, 1.0)
    sigma = np.sqrt(logs.covariance[:, 0, 0] + doubt_m**2 / squared)
    by_target, by_frame = np.zeros((len(x), 2, 2)), np.zeros((len(x), 2, 3))
    by_target[:, 0] = np.stack([y, -x], axis=1) / (squared * sigma)[:, None]
    by_frame[:, 0, :2] = -by_target[:, 0]
    by_frame[:, 0, 2] = -1 / sigma
    misclosure = np.zeros((len(x), 2))
    misclosure[:, 0] = wrap_pi(np.arctan2(x, y) - frame[:, 2] - logs.bearing_rad) / sigma
    return _Rows(by_frame, by_target, misclosure, np.zeros((len(x), 2, 2)))


def _normal(logs: NetworkLogs, rows: _Rows, carriers: int, targets: int) -> _Normal:
    """Sum the logs' normal equations, then eliminate every target."""
    to_frame, to_target = transposed(rows.by_frame), transposed(rows.by_target)
    blocks, vector = np.zeros((carriers, 3, 3)), np.zeros((carriers, 3))
    own, vector_t = np.zeros((targets, 2, 2)), np.zeros((targets, 2))
    pairs = np.zeros((targets * carriers, 2, 3))
    np.add.at(blocks, logs.carrier, to_frame @ rows.by_frame)
    np.add.at(vector, logs.carrier, -times(to_frame, rows.misclosure))
    np.add.at(own, logs.target, to_target @ rows.by_target)
    np.add.at(vector_t, logs.target, -times(to_target, rows.misclosure))
    np.add.at(pairs, logs.target * carriers + logs.carrier, to_target @ rows.by_frame)
    matrix = np.zeros((carriers, 3, carriers, 3))
    matrix[np.arange(carriers), :, np.arange(carriers)] = blocks
    cross = pairs.reshape(targets, carriers, 2, 3).swapaxes(1, 2)
    flat = cross.reshape(targets, 2, 3 * carriers)
    free = np.asarray(np.linalg.pinv(own, rcond=1e-10, hermitian=True), dtype=float)
    pull = transposed(flat) @ free
    return _Normal(
        matrix.reshape(3 * carriers, 3 * carriers) - (pull @ flat).sum(axis=0),
        vector.ravel() - times(pull, vector_t).sum(axis=0),
        free,
        flat,
        vector_t,
    )


def _residual(logs: NetworkLogs, rows: _Rows, moved: Array, shift: Array) -> Array:
    """Whitened conditions (M, 2) after a step of frames and targets, to first order."""
    by_carrier = moved.reshape(-1, 3)[logs.carrier]
    return (
        rows.misclosure
        + times(rows.by_frame, by_carrier)
        + times(rows.by_target, shift[logs.target])
    )


def _dof(logs: NetworkLogs, normal: _Normal) -> int:
    """Measurements less target coordinates; the prior pays for the frames."""
    measured = len(logs.range_m) + int(np.isfinite(logs.range_m).sum())
    fixed: NDArray[np.int_] = np.linalg.matrix_rank(normal.target_inverse, hermitian=True)
    return measured - int(fixed.sum())
