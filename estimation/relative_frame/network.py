"""Frames of many carriers at once, from every overlap of every two, three or more of them.

In pairs with the own carrier, only targets that it sees itself count. Jointly, a target that
carriers 3 and 5 share ties 3 to 5, and through 5's own targets to the gauge: at partial coverage
that is most of the information. Targets' positions are unknowns of the whole adjustment and are
eliminated one by one (Schur), so the work grows with the logs, not with the targets cubed.

The gauge is the own carrier, number 0: its frame is (0, 0). Carriers may measure bearings only.

Source: Triggs, McLauchlan, Hartley & Fitzgibbon, "Bundle adjustment - a modern synthesis", 2000.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import wrap_pi
from estimation.relative_frame.gauge import root_of
from estimation.relative_frame.logs import OwnAxesFrame
from estimation.relative_frame.matrices import inverse
from estimation.relative_frame.network_equations import (
    NetworkLogs,
    adjusted,
    dof_of,
    informative,
)

__all__ = ["NetworkFrames", "NetworkLogs", "NetworkPrior", "network_adjustment"]

_GRADUAL, _SHARPER = 12, 0.6  # steps in which bearings of near targets are sharpened


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
    root, logs = _root(prior), informative(logs)
    sharp = 0 if np.isfinite(logs.range_m).all() else _GRADUAL
    end = adjusted(
        logs,
        lambda z: _frames(prior, root, z),
        root.shape[1],
        lambda count: _doubt_m(prior, count),
        sharp,
    )
    return NetworkFrames(
        q_m=end.frames[:, :2],
        D_rad=wrap_pi(end.frames[:, 2]),
        covariance=end.tangent @ inverse(end.whole) @ end.tangent.T,
        information=end.normal.matrix,
        prior_covariance=end.tangent @ end.tangent.T,
        targets_m=end.targets_m,
        chi2=float(np.square(end.residual).sum() + end.z @ end.z),
        dof=dof_of(logs, end.normal),
        converged=end.converged,
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
