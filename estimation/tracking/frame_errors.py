"""What the frames of carriers get wrong, and how much of it is in each track: nothing is forgotten.

The error b of a carrier's frame is common to all its plots and hardly changes from scan to scan.
It is considered, not estimated: each track keeps the covariance of its state with every b, so that
more plots of one carrier never make a track surer than the frame they came in.

Source: Schmidt, Application of state-space methods to navigation problems, Advances in Control
Systems 3, 1966 (the consider filter).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.tracking.imm import Bank
from estimation.tracking.innovations import Common

SIZE = 3
"""Errors of a frame: q east, q north [m], D clockwise [rad] about the middle of the picture. Those
of the ranges of its sources follow them, two each."""
MOST = 8
"""Frames remembered; of one that was not heard for longest, tracks forget what it has given."""


class Frames(NamedTuple):
    """The frames whose errors tracks remember, the one heard longest ago first.

    Attributes:
        names: of the frames.
        covariances: (K, K) of each when it was heard last.
    """

    names: tuple[str, ...]
    covariances: tuple[Array, ...]

    def columns(self, frame: int) -> slice:
        """Which of what tracks remember is of a frame."""
        sizes = [len(covariance) for covariance in self.covariances[: frame + 1]]
        return slice(sum(sizes[:-1]), sum(sizes))


_LEAST = 1e-3, 1e-3, 1e-7  # sigmas [m, m, rad]: no frame is known better
_LEAST_RANGES = 1e-3, 1e-8  # and no ranges [m, a metre of range]
NONE = Frames((), ())


class Met(NamedTuple):
    """The frames with the one of a scan last, the bank and the scan's common error in their terms.

    Attributes:
        common: with `slot`, about the middle of the picture; as it was if it has no name.
    """

    frames: Frames
    bank: Bank
    common: Common | None


def met(frames: Frames, bank: Bank, common: Common | None) -> Met:
    """What is known of frames when the scan of one of them comes."""
    if common is None or not common.name:
        return Met(frames, bank, common)
    now = _about_the_middle(common)
    mine = np.zeros((4, len(now), *bank.model.shape))
    others = [k for k, name in enumerate(frames.names) if name != common.name]
    if len(others) < len(frames.names):
        row = frames.names.index(common.name)
        if len(frames.covariances[row]) == len(now):
            still = kept(frames.covariances[row], now)
            mine = np.einsum("aimn,ij->ajmn", bank.shared[:, frames.columns(row)], still)
    others = others[-(MOST - 1) :]
    remembered = [bank.shared[:, frames.columns(k)] for k in others]
    after = Frames(
        (*(frames.names[k] for k in others), common.name),
        (*(frames.covariances[k] for k in others), now),
    )
    told = common._replace(
        covariance=now,
        pivot_m=np.zeros(2),
        slot=after.columns(len(others)).start,
        site_m=common.pivot_m,
    )
    return Met(after, bank._replace(shared=np.concatenate([*remembered, mine], axis=1)), told)


def kept(before: Array, now: Array) -> Array:
    """What (K, K) turns the covariance of a state with b as it was into that with b as it is.

    Where b is known better than it was, something has been learnt: what was learnt is
    independent of what is left. Where it is known worse, it has wandered off by itself. Hence the
    covariance of the two is the lesser of theirs, in the directions in which both are plain.
    """
    root = np.linalg.cholesky(now)
    half = np.linalg.solve(root, np.linalg.solve(root, before).T)
    ratio, axes = np.linalg.eigh((half + half.T) / 2)
    ratio = np.maximum(ratio, 1e-12)
    along = root @ axes
    inverse = np.linalg.inv(along)
    share = np.minimum(ratio, 1.0) / ratio
    turned: Array = inverse.T @ np.diag(share) @ along.T
    return turned


def begun(bank: Bank, common: Common | None, columns: int) -> Bank:
    """Tracks of one plot each: they have the whole error of the plot's frame."""
    shared = np.zeros((4, columns, *bank.model.shape))
    if common is None:
        return bank._replace(shared=shared)
    by_frame = common.displaces(bank.mean)
    error = np.einsum("aimn,ij->ajmn", by_frame, common.covariance)
    covariance = bank.covariance.copy()
    covariance[:2, :2] += np.einsum("aimn,bimn->abmn", error, by_frame)
    if common.slot >= 0:
        shared[:2, common.slot : common.slot + len(common.covariance)] = -error
    return bank._replace(covariance=covariance, shared=shared)


def _about_the_middle(common: Common) -> Array:
    """The covariance of q and D about the middle instead of the carrier's place."""
    east, north = common.pivot_m
    turn = np.eye(len(common.covariance))
    turn[:2, 2] = -north, east
    least = [*_LEAST, *_LEAST_RANGES * ((len(turn) - SIZE) // 2)]
    about: Array = turn @ (common.covariance + np.diag(least) ** 2) @ turn.T
    return about
