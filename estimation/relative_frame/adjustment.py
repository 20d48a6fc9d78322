"""Exact adjustment of a relative frame: the conditions (2) as they are, iterated, in own axes.

The closed form linearises once, at the reported values: enough at a degree of heading error and
up to a hundred pairs, 2 x off at ten degrees and L = 7. Here the same criterion (5) is minimised
under the nonlinear conditions. Own axes and a c1 carried as a weakly known gauge keep the
covariance honest at any heading error. Two starts, the prior and a rigid fit of the two pictures:
the first knows what two targets at one place cannot say, the second any heading.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.frames import wrap_pi
from estimation.relative_frame.gauge import Gauge, gauge, gaussian
from estimation.relative_frame.gauss_helmert import Measured, measured
from estimation.relative_frame.iteration import Solution, iterate
from estimation.relative_frame.logs import (
    OwnAxesFrame,
    PolarLogs,
    RelativeFrame,
    RelativeFramePrior,
    in_own_axes,
)
from estimation.relative_frame.own_axes_information import OwnAxesInformation

_SAME = 1e-9  # of chi2: ends of one minimum differ by less, other minima by more


class Registration(NamedTuple):
    """What a pairwise method found.

    Attributes:
        own_axes: (q, D) and its covariance: what fusion needs.
        fixed: the same in true-north axes, with chi2, dof and pairs.
        converged: (...) False: the iteration went on moving, and the result is not to be used.
    """

    own_axes: OwnAxesFrame
    fixed: RelativeFrame
    converged: NDArray[np.bool_]


class Update(NamedTuple):
    """A frame in own axes improved by pairs.

    Attributes:
        frame: (q, D) and its covariance.
        information: what the pairs alone say, about `frame`.
        pair_chi2: (..., L) of each pair at `frame`, chi-squared of 2 in all but few pairs.
        chi2: (...) of the pairs and the prior together, chi-squared of 2 L.
        converged: (...) as in `Registration`.
    """

    frame: OwnAxesFrame
    information: OwnAxesInformation
    pair_chi2: Array
    chi2: Array
    converged: NDArray[np.bool_]


def adjustment(own: PolarLogs, other: PolarLogs, prior: RelativeFramePrior) -> Registration:
    """Corrections of the other carrier's relative frame from L associated target logs, exactly.

    O(L) a step, three to six steps. L = 0 gives the prior back. A geometry that determines
    nothing is a large covariance, never an exception.

    Args:
        own: (..., L) logs in own axes.
        other: (..., L) logs of the same targets in the other carrier's axes.
        prior: reported offset and the sigmas of it and of both norths, up to pi.

    Raises:
        ValueError: own and other differ in length.
    """
    batch = batch_of(own, other, prior)
    given, navigation = measured(own, other, batch), gauge(prior, batch)
    starts = [np.zeros((len(navigation.root), 4)), rigid_fit(given, navigation)]
    return registration(_best_of(given, navigation, starts), navigation, prior, batch, own.count)


def registration(
    end: Solution,
    navigation: Gauge,
    prior: RelativeFramePrior,
    batch: tuple[int, ...],
    pairs: int,
) -> Registration:
    """The end of an iteration from navigation's prior, in both axis systems."""
    covariance = navigation.root @ end.covariance @ transposed(navigation.root)
    theta = navigation.theta(end.z).reshape(*batch, 4)
    fixed = RelativeFrame(
        offset_correction_m=theta[..., :2],
        c1_rad=theta[..., 2],
        c2_rad=theta[..., 3],
        covariance=covariance.reshape(*batch, 4, 4),
        chi2=end.criterion.reshape(batch),
        dof=2 * pairs,
        pairs=pairs,
    )
    seen = in_own_axes(fixed, prior)
    return Registration(
        seen._replace(D_rad=wrap_pi(seen.D_rad)), fixed, end.converged.reshape(batch)
    )


def updated(own: PolarLogs, other: PolarLogs, frame: OwnAxesFrame) -> Update:
    """A frame known in own axes, improved by L pairs; relinearised until nothing moves.

    Args:
        own: (..., L) logs in own axes.
        other: (..., L) logs of the same targets in the other carrier's axes.
        frame: (q, D) before, with its covariance as a Gaussian prior.

    Raises:
        ValueError: own and other differ in length.
    """
    batch = np.broadcast_shapes(
        own.range_m.shape[:-1], other.range_m.shape[:-1], np.shape(frame.D_rad)
    )
    given, before = measured(own, other, batch), gaussian(frame, batch)
    end = iterate(given, before, np.zeros((len(before.mean), 3)))
    point, _ = before.at(end.z)
    covariance = before.root @ end.covariance @ transposed(before.root)
    return Update(
        frame=frame_of(point, covariance, batch),
        information=OwnAxesInformation(
            point.reshape(*batch, 3),
            end.information.reshape(*batch, 3, 3),
            end.vector.reshape(*batch, 3),
            end.pair_chi2.sum(axis=1).reshape(batch),
            own.count,
        ),
        pair_chi2=end.pair_chi2.reshape(*batch, own.count),
        chi2=end.criterion.reshape(batch),
        converged=end.converged.reshape(batch),
    )


def rigid_fit(given: Measured, navigation: Gauge) -> Array:
    """Whitened coordinates (N, 4) at the turn and shift that lay one picture on the other.

    The weighted Procrustes fit in closed form (points as complex numbers north + i east, so that
    a bearing is an argument), its turn held by the prior as far as that counts, and then the c1
    that the prior finds likeliest.
    """
    points = given.range_m * np.exp(1j * given.bearing_rad)
    weights = 1 / (given.q_dd + given.q_bb * given.range_m**2).sum(axis=0)
    total = weights.sum(axis=1, keepdims=True) + 1e-12
    centres = (weights * points).sum(axis=2) / total[:, 0]
    own, other = points - centres[..., None]
    s1, s2 = navigation.root[:, 2, 2], navigation.root[:, 3, 3]
    turn = (weights * own * other.conj()).sum(axis=1) + 1 / (s1**2 + s2**2 + 1e-12)
    turn /= np.abs(turn)
    q = centres[0] - turn * centres[1]

    offset = navigation.offset_m[:, 1] + 1j * navigation.offset_m[:, 0]
    spread = np.square(navigation.root[:, :2, :2]).sum(axis=(1, 2)) / 2 + 1e-12
    c1 = np.angle(offset * q.conj() / spread + 1 / (s1**2 + 1e-12) + turn.conj() / (s2**2 + 1e-12))
    norths = np.stack([c1, wrap_pi(c1 + np.angle(turn))], axis=1)
    sigmas = np.stack([s1, s2], axis=1)
    z = np.divide(norths, sigmas, out=np.zeros_like(norths), where=sigmas > 0)
    return navigation.with_q(
        np.concatenate([np.zeros_like(z), z], axis=1), np.stack([q.imag, q.real], axis=1)
    )


def _best_of(given: Measured, navigation: Gauge, starts: list[Array]) -> Solution:
    """The lowest end of all starts; of several at one minimum, that of the first that arrived.

    Two ends of one minimum differ by their last steps, and rounding alone would choose.
    """
    tries, count = len(starts), len(navigation.root)
    every = np.tile(np.arange(count), tries)
    ends = iterate(given.of(every), navigation.of(every), np.concatenate(starts))
    cost = ends.criterion.reshape(tries, count)
    least = cost.min(axis=0)
    lowest = cost <= least + _SAME * (1 + least)
    arrived = lowest & ends.converged.reshape(tries, count)
    first = np.argmax(np.where(arrived.any(axis=0), arrived, lowest), axis=0)
    pick = first * count + np.arange(count)
    return Solution(*(array[pick] for array in ends))


def frame_of(point: Array, covariance: Array, batch: tuple[int, ...]) -> OwnAxesFrame:
    """A flat (q, D) and its covariance in the shape of a batch."""
    return OwnAxesFrame(
        point[:, :2].reshape(*batch, 2),
        wrap_pi(point[:, 2]).reshape(batch),
        covariance.reshape(*batch, 3, 3),
    )


def batch_of(own: PolarLogs, other: PolarLogs, prior: RelativeFramePrior) -> tuple[int, ...]:
    """The common batch shape of the logs and the prior."""
    return np.broadcast_shapes(
        own.range_m.shape[:-1],
        other.range_m.shape[:-1],
        prior.offset_m.shape[:-1],
        prior.offset_covariance.shape[:-2],
        np.shape(prior.sigma_c1_rad),
        np.shape(prior.sigma_c2_rad),
    )
