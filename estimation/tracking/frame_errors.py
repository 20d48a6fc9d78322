"""What the frames of carriers get wrong, and how much of it is in each track: nothing is forgotten.

The error b of a carrier's frame is common to all its plots and hardly changes from scan to scan.
It is considered, not estimated: each track keeps the covariance of its state with every b, so that
more plots of one carrier never make a track surer than the frame they came in. Errors of frames
that are known together hang together: a scale that all ranges share is no less for many carriers.

Source: Schmidt, Application of state-space methods to navigation problems, Advances in Control
Systems 3, 1966 (the consider filter).
"""

from __future__ import annotations

from collections.abc import Sequence
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
        sizes: how many errors each has.
        covariance: (errors, errors) of all, as they were known last.
    """

    names: tuple[str, ...]
    sizes: tuple[int, ...]
    covariance: Array

    def rows(self, name: str) -> list[int]:
        """Which of the errors are of a frame."""
        which = self.names.index(name)
        first = sum(self.sizes[:which])
        return list(range(first, first + self.sizes[which]))


_LEAST = 1e-3, 1e-3, 1e-7  # sigmas [m, m, rad]: no frame is known better
_LEAST_RANGES = 1e-3, 1e-8  # and no ranges [m, a metre of range]
NONE = Frames((), (), np.zeros((0, 0)))


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
    now = _known(common)
    others = [name for name in frames.names if name != common.name][-(MOST - 1) :]
    after = _after(frames, now, [*others, common.name])
    shared = np.zeros((4, len(after.covariance), *bank.model.shape))
    silent = [name for name in others if name not in now.names]
    shared[:, _rows(after, silent)] = bank.shared[:, _rows(frames, silent)]
    still = [name for name in after.names if name in now.names and _stays(frames, now, name)]
    if still:
        was, at = _rows(frames, still), _rows(after, still)
        first = _rows(
            after, [name for name in after.names if name in now.names and name not in still]
        )
        lasting = after.covariance[np.ix_(at, at)]
        turned = kept(frames.covariance[np.ix_(was, was)], lasting)
        # of a frame not heard before tracks have what it shares with those that were
        shares = np.linalg.solve(lasting, after.covariance[np.ix_(at, first)])
        turned = np.hstack([turned, turned @ shares])
        shared[:, at + first] = np.tensordot(turned, bank.shared[:, was], (0, 1)).swapaxes(0, 1)
    mine = after.rows(common.name)
    told = common._replace(
        covariance=after.covariance[np.ix_(mine, mine)],
        pivot_m=np.zeros(2),
        slot=mine[0],
        site_m=common.pivot_m,
        crossed=after.covariance[:, mine],
    )
    return Met(after, bank._replace(shared=shared), told)


def _known(common: Common) -> Frames:
    """What a scan says of frames, about the middle of the picture."""
    alone = (common.name,), (len(common.covariance),), common.pivot_m[None], common.covariance
    names, sizes, pivots, covariance = common.together or alone
    turn, least, first = np.eye(len(covariance)), list[float](), 0
    for size, (east, north) in zip(sizes, pivots, strict=True):
        turn[first : first + 2, first + 2] = -north, east
        least += [*_LEAST, *_LEAST_RANGES * ((size - SIZE) // 2)]
        first += size
    return Frames(names, sizes, turn @ (covariance + np.diag(least) ** 2) @ turn.T)


def _after(before: Frames, now: Frames, names: list[str]) -> Frames:
    """These frames, as they are known now or were before."""
    known = {
        name: size
        for said in (before, now)
        for name, size in zip(said.names, said.sizes, strict=True)
    }
    after = Frames(tuple(names), tuple(known[name] for name in names), np.zeros((0, 0)))
    covariance = np.zeros((sum(after.sizes),) * 2)
    told = [name for name in names if name in now.names]
    silent = [name for name in names if name not in now.names]
    for said, which in ((before, silent), (now, told)):
        rows, at = _rows(said, which), _rows(after, which)
        covariance[np.ix_(at, at)] = said.covariance[np.ix_(rows, rows)]
    return after._replace(covariance=covariance)


def _stays(before: Frames, now: Frames, name: str) -> bool:
    """Whether a frame was remembered with the errors that it has now."""
    return name in before.names and len(before.rows(name)) == len(now.rows(name))


def _rows(frames: Frames, names: Sequence[str]) -> list[int]:
    return [row for name in names for row in frames.rows(name)]


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
    if common.crossed is not None:
        shared[:2] = -np.einsum("aimn,ei->aemn", by_frame, common.crossed)
    return bank._replace(covariance=covariance, shared=shared)
