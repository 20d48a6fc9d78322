"""Frames of all carriers followed over time, together.

Of each carrier: where it is in own axes (q), how its bearings are turned (D), at which velocity
its dead reckoning drifts (u), and what is to be added to its ranges: b, and s times the range.
Between instants the carriers move by what they reckon; u is a current and an error of the log,
constant for long and new after a turn. All targets shared by any two carriers tie the frames at
an instant; they are eliminated (`network`), so that an instant costs in proportion to its logs.

The own carrier is number 0. Its q and D are zero, its drift and its range errors are unknowns as
anyone's: the drift of another against it is u_i - u_0, the same u_0 for all. When own north
wanders, all frames turn about the own carrier.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.relative_frame.gauge import root_of
from estimation.relative_frame.logs import OwnAxesFrame
from estimation.relative_frame.matrices import Indices, inverse, solved
from estimation.relative_frame.network_equations import (
    Adjusted,
    NetworkLogs,
    adjusted,
    informative,
)
from estimation.relative_frame.own_axes_information import OwnAxesInformation
from estimation.relative_frame.range_errors import RangeErrors

WIDTH = 7
"""Numbers of a carrier: q east and north [m], D [rad], u east and north [m/s], b [m], s."""
LOGS = np.array([0, 1, 2, 5, 6])
"""Of these, what logs depend on: (q, D) and the ranges."""
_STILL = 1e-3  # sigmas: the next step would be a millionth
_MINORITY = 1 / 3  # share of targets up to which they are taken for wrong, and not the frame


@dataclass(frozen=True, eq=False, slots=True)
class JointFrames:
    """What is believed of N carriers at one instant.

    Attributes:
        mean: (N, 7) q, D, u, b, s of each.
        covariance: (7 N, 7 N).
    """

    mean: Array
    covariance: Array

    @property
    def carriers(self) -> int:
        """N, the own carrier included."""
        return len(self.mean)

    def frame(self, carrier: int) -> OwnAxesFrame:
        """One carrier's frame alone."""
        part = slice(WIDTH * carrier, WIDTH * carrier + 3)
        mean = self.mean[carrier]
        return OwnAxesFrame(mean[:2], mean[2], self.covariance[part, part])

    def drift_mps(self, carrier: int) -> tuple[Array, Array]:
        """u_i - u_0 (2,) of a carrier, and its covariance (2, 2)."""
        other = WIDTH * carrier + 3
        p, i, o = self.covariance, slice(other, other + 2), slice(3, 5)
        covariance = p[i, i] + p[o, o] - p[i, o] - p[o, i]
        return self.mean[carrier, 3:5] - self.mean[0, 3:5], covariance

    def ranges(self, carrier: int) -> RangeErrors:
        """What is to be added to a carrier's ranges."""
        part = slice(WIDTH * carrier + 5, WIDTH * (carrier + 1))
        return RangeErrors(self.mean[carrier, 5:], self.covariance[part, part])

    def errors(self, carrier: int) -> Array:
        """(5, 5) covariance of all that logs of a carrier depend on: q, D, b, s."""
        rows = WIDTH * carrier + LOGS
        errors: Array = self.covariance[np.ix_(rows, rows)]
        return errors

    def without(self, carrier: int) -> JointFrames:
        """The others, renumbered."""
        kept = np.delete(np.arange(self.covariance.shape[0]), _block(carrier))
        mean = np.delete(self.mean, carrier, axis=0)
        return JointFrames(mean, self.covariance[np.ix_(kept, kept)])

    def joined_by(
        self,
        frame: OwnAxesFrame,
        sigma_drift_mps: float,
        sigma_bias_m: float,
        sigma_scale: float = 0.0,
        shared: Array | None = None,
    ) -> JointFrames:
        """With one more carrier, the last, whose frame has been found by itself.

        Args:
            shared: (7 N, 3) covariance of all that is known with it, see `common_tracks`; None =
                nothing.
        """
        old, new = (
            self.covariance.shape[0],
            np.diag(np.square([0.0] * 3 + [sigma_drift_mps] * 2 + [sigma_bias_m, sigma_scale])),
        )
        new[:3, :3] = frame.covariance
        covariance = np.zeros((old + WIDTH, old + WIDTH))
        covariance[:old, :old], covariance[old:, old:] = self.covariance, new
        if shared is not None:
            covariance[:old, old : old + 3], covariance[old : old + 3, :old] = shared, shared.T
        row = np.array([*frame.q_m, float(frame.D_rad), 0.0, 0.0, 0.0, 0.0])
        return JointFrames(np.vstack([self.mean, row]), covariance)

    def joined_through(
        self,
        base: int,
        seen: OwnAxesFrame,
        sigma_drift_mps: float,
        sigma_bias_m: float,
        sigma_scale: float = 0.0,
        by_ranges: Array | None = None,
        shared: Array | None = None,
    ) -> JointFrames:
        """With one more carrier, the last, whose frame has been found in the axes of another.

        Args:
            base: in whose axes; its own error goes on to the new one and correlates them.
            seen: (q, D) of the new one there.
            by_ranges: (3, 4) derivative of `seen` by (b, s) of the base and of the new one, whose
                errors are not in its covariance; None = it hangs on neither.
            shared: (7 N, 3) covariance of all that is known with `seen`, see `common_tracks`.
        """
        frame, by_base, own_part = composed(self.frame(base), seen)
        sigmas = sigma_drift_mps, sigma_bias_m, sigma_scale
        if shared is not None:
            shared = np.hstack(
                [shared[:, :2] @ rotation_clockwise(self.mean[base, 2]).T, shared[:, 2:]]
            )
        joined = self.joined_by(frame._replace(covariance=own_part), *sigmas, shared)
        old = self.covariance.shape[0]
        hangs = np.zeros((3, 4)) if by_ranges is None else by_ranges.copy()
        hangs[:2] = rotation_clockwise(self.mean[base, 2]) @ hangs[:2]
        through = np.eye(old + WIDTH)
        block, ranges = _block(base), np.r_[_block(base)[5:], old + 5, old + 6]
        through[old : old + 3, block[:3]] = by_base
        through[old : old + 3, ranges] = hangs
        return JointFrames(joined.mean, through @ joined.covariance @ through.T)

    def with_frame(self, carrier: int, frame: OwnAxesFrame) -> JointFrames:
        """A carrier's (q, D) found anew and independent of all else; its drift and bias stay."""
        block, mean, covariance = _block(carrier)[:3], self.mean.copy(), self.covariance.copy()
        mean[carrier, :2], mean[carrier, 2] = frame.q_m, frame.D_rad
        covariance[block, :] = covariance[:, block] = 0.0
        covariance[np.ix_(block, block)] = frame.covariance
        return JointFrames(mean, covariance)


def composed(base: OwnAxesFrame, seen: OwnAxesFrame) -> tuple[OwnAxesFrame, Array, Array]:
    """A frame known in the axes of another, independent of it, in own axes.

    Returns:
        The frame; its derivative (3, 3) by the base; what of its covariance is not the base's.
    """
    turn = rotation_clockwise(base.D_rad)
    away = turn @ seen.q_m
    by_base, by_seen = np.eye(3), np.eye(3)
    by_base[0, 2], by_base[1, 2] = away[1], -away[0]
    by_seen[:2, :2] = turn
    own_part = by_seen @ seen.covariance @ by_seen.T
    covariance = by_base @ base.covariance @ by_base.T + own_part
    frame = OwnAxesFrame(base.q_m + away, wrap_pi(base.D_rad + seen.D_rad), covariance)
    return frame, by_base, own_part


def own_alone(sigma_drift_mps: float, sigma_bias_m: float, sigma_scale: float = 0.0) -> JointFrames:
    """The own carrier before any other is known."""
    variances = np.square([0.0] * 3 + [sigma_drift_mps] * 2 + [sigma_bias_m, sigma_scale])
    return JointFrames(np.zeros((1, WIDTH)), np.diag(variances))


class Elapsed(NamedTuple):
    """What happened to N carriers between two instants.

    Attributes:
        seconds: between them.
        travel_m: (N, 2) of each by its own reckoning, in its own axes.
        kept: (N,) correlation of each drift with what it was.
        sigma_drift_mps: (N,) of the drifts in general.
        wandered_m: (N,) sigma per axis of what else the places have gone astray.
        wandered_rad: (N,) sigma of each north's wander.
    """

    seconds: float
    travel_m: Array
    kept: Array
    sigma_drift_mps: Array
    wandered_m: Array
    wandered_rad: Array


def carried_on(joint: JointFrames, elapsed: Elapsed) -> JointFrames:
    """The frames at the later instant."""
    count, mean = joint.carriers, joint.mean.copy()
    turned = (rotation_clockwise(mean[:, 2]) @ elapsed.travel_m[..., None])[..., 0]
    mean[1:, :2] += turned[1:] - turned[0]
    mean[1:, :2] += elapsed.seconds * (mean[1:, 3:5] - mean[0, 3:5])
    mean[:, 3:5] *= elapsed.kept[:, None]

    forward = np.eye(WIDTH * count).reshape(count, WIDTH, count, WIDTH)
    every, others = np.arange(count), np.arange(1, count)
    for axis in range(2):
        forward[every, 3 + axis, every, 3 + axis] = elapsed.kept
        forward[others, axis, others, 3 + axis] = elapsed.seconds
        forward[others, axis, 0, 3 + axis] = -elapsed.seconds
    forward[others, 0, others, 2], forward[others, 1, others, 2] = turned[1:, 1], -turned[1:, 0]
    flat = forward.reshape(joint.covariance.shape)
    covariance = flat @ joint.covariance @ flat.T + _noise(mean, elapsed)
    return JointFrames(mean, covariance)


def _noise(mean: Array, elapsed: Elapsed) -> Array:
    """(7 N, 7 N) what the drifts, the places and the norths have done unseen."""
    count, others = len(mean), np.arange(1, len(mean))
    every = np.arange(count)
    # each carrier's own (place, drift) per axis, and its north
    by = np.zeros((count, WIDTH, count, 5))
    for axis in range(2):
        by[others, axis, others, axis] = 1.0
        by[others, axis, 0, axis] = -1.0
        by[every, 3 + axis, every, 2 + axis] = 1.0
    by[others, 2, others, 4], by[others, 2, 0, 4] = 1.0, -1.0
    by[others, 0, 0, 4], by[others, 1, 0, 4] = -mean[1:, 1], mean[1:, 0]
    changed = np.square(elapsed.sigma_drift_mps) * (1 - np.square(elapsed.kept))
    seconds = elapsed.seconds
    own = np.zeros((count, 5, 5))
    for axis in range(2):
        own[:, axis, axis] = changed * seconds**2 / 3 + np.square(elapsed.wandered_m)
        own[:, axis, 2 + axis] = own[:, 2 + axis, axis] = changed * seconds / 2
        own[:, 2 + axis, 2 + axis] = changed
    own[:, 4, 4] = np.square(elapsed.wandered_rad)
    whole = np.zeros((count, 5, count, 5))
    whole[every, :, every, :] = own
    flat = by.reshape(WIDTH * count, 5 * count)
    noise: Array = flat @ whole.reshape(5 * count, 5 * count) @ flat.T
    return noise


@dataclass(frozen=True, eq=False, slots=True)
class JointUpdate:
    """Frames improved by the logs of one instant.

    Attributes:
        joint: the frames.
        target_chi2: (T,) misclosure of each target, zero where it took no part.
        target_dof: (T,) two less than the coordinates logged of it.
        used: (T,) whether it took part: neither silent nor out of line with all others.
        targets_m: (T, 2) in own axes.
        chi2: misclosure of what was used and of the frames before, together.
        converged: False: not to be used.
    """

    joint: JointFrames
    target_chi2: Array
    target_dof: NDArray[np.int_]
    used: NDArray[np.bool_]
    targets_m: Array
    chi2: float
    converged: bool
    _before: JointFrames
    _end: Adjusted

    def said_of(self, carrier: int, pairs: int) -> OwnAxesInformation:
        """What the logs alone say of one carrier's frame, the others being as they were expected.

        Args:
            pairs: how many pairs it is to be counted as.
        """
        width, count = len(LOGS), self.joint.carriers
        mine = np.arange(width * carrier, width * carrier + 3)
        rest = np.delete(np.arange(width * count), mine)
        matrix, vector = self._end.normal.matrix, self._end.normal.vector
        before, which = self._before, _frame_rows(count)
        root = root_of(before.covariance[np.ix_(which, which)][np.ix_(rest, rest)])
        off = (before.mean[:, LOGS] - self._end.frames).ravel()[rest]
        inner = np.eye(len(rest)) + root.T @ matrix[np.ix_(rest, rest)] @ root
        cross = matrix[np.ix_(mine, rest)]
        through = cross @ root @ inverse(inner) @ root.T
        return OwnAxesInformation(
            point=self._end.frames[carrier, :3].copy(),
            matrix=matrix[np.ix_(mine, mine)] - through @ cross.T,
            vector=vector[mine]
            - cross @ off
            + through @ (matrix[np.ix_(rest, rest)] @ off - vector[rest]),
            chi2=np.asarray(self.chi2),
            pairs=pairs,
        )

    def range_score(self, carrier: int) -> tuple[float, float]:
        """What these logs say of a bias of a carrier's ranges that nobody declares.

        Returns:
            Score g [1/m] and information I [1/m^2] of it, all else as it is believed: the bias is
            g / I, and g has variance I where there is none, independent from instant to instant.
        """
        row = len(LOGS) * carrier + 3
        matrix, tangent = self._end.normal.matrix, self._end.tangent
        through = tangent.T @ matrix[:, row]
        known = through @ solved(self._end.whole, through[:, None])[:, 0]
        return float(self._end.normal.vector[row]), float(matrix[row, row] - known)


def improved_by(joint: JointFrames, logs: NetworkLogs, gate: float = 0.999) -> JointUpdate:
    """The frames with the logs of one instant taken in; exact, relinearised until nothing moves.

    Targets out of line are left out, as long as they are few: many of them are a frame that has
    jumped, and must not be hidden.

    Args:
        logs: of targets that two or more of the N carriers saw; carriers numbered as in `joint`.
        gate: probability of a right target's misclosure to be no larger than one that stays in.
    """
    everyone = found = _improved(joint, logs)
    limit, most = _quantile(gate, everyone.target_dof), _MINORITY * everyone.used.sum()
    out = np.zeros_like(everyone.used)
    while (wrong := found.used & (found.target_chi2 > limit)).any():
        # the worst spoil the others: they go first
        out |= wrong & (found.target_chi2 > found.target_chi2[wrong].max() / 4)
        if out.sum() > most:
            return everyone
        found = _improved(joint, logs.take(~out[logs.target]), len(out))
    return found


def _improved(joint: JointFrames, logs: NetworkLogs, targets: int = 0) -> JointUpdate:
    """The same with every log; of so many targets at least."""
    telling = informative(logs)
    root, which = root_of(joint.covariance), _frame_rows(joint.carriers)
    start, tangent = joint.mean[:, LOGS], root[which]

    def at(z: Array) -> tuple[Array, Array]:
        return start + (tangent @ z).reshape(start.shape), tangent

    sure = np.zeros(joint.carriers)
    end = adjusted(telling, at, len(root), lambda _: sure, still=_STILL)
    mean = joint.mean + (root @ end.z).reshape(joint.mean.shape)
    mean[:, 2] = wrap_pi(mean[:, 2])
    targets = max(int(logs.target.max(initial=-1)) + 1, targets)
    chi2, coordinates = np.zeros(targets), np.zeros(targets, dtype=int)
    np.add.at(chi2, telling.target, np.square(end.residual).sum(axis=1))
    np.add.at(coordinates, telling.target, 1 + np.isfinite(telling.range_m))
    places = np.zeros((targets, 2))
    places[: len(end.targets_m)] = end.targets_m
    return JointUpdate(
        joint=JointFrames(mean, root @ solved(end.whole, root.T)),
        target_chi2=chi2,
        target_dof=np.maximum(coordinates - 2, 0),
        used=coordinates > 0,
        targets_m=places,
        chi2=float(chi2.sum() + end.z @ end.z),
        converged=end.converged,
        _before=joint,
        _end=end,
    )


def _quantile(probability: float, dof: NDArray[np.int_]) -> Array:
    """(T,) of chi-squared; infinite for none."""
    from scipy.special import chdtri  # noqa: PLC0415  (0.1 s, at the first use)

    limit = chdtri(np.maximum(dof, 1), 1 - probability)
    return np.asarray(np.where(dof > 0, limit, np.inf), dtype=float)


def _block(carrier: int) -> Indices:
    return np.arange(WIDTH * carrier, WIDTH * carrier + WIDTH)


def _frame_rows(carriers: int) -> Indices:
    """Rows of the state on which logs depend."""
    rows: Indices = (WIDTH * np.arange(carriers)[:, None] + LOGS).ravel()
    return rows
