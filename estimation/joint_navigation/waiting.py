"""Ranges that may be far off wait until others of the same link bear them out.

Where a prediction is unsure by hundreds of metres, one range cannot be told from its echo, and
whichever is believed first makes the other look wrong. So a range that cannot be judged yet is not
taken in, but remembered: as a block `waiting/...` of one slot, by how many sigmas the right range
exceeds the measured one. The slot stays tied to the state of its own instant; once the range is
believed, maybe some instants later, it is measured to be zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices
from estimation.joint_navigation.online import (
    NOTHING,
    SURE,
    Foretold,
    Improved,
    Joint,
    Rows,
    foretold,
    joined,
    weighed,
    weights,
    without,
)
from estimation.joint_navigation.online_rows import LINK, Range, RowsAt, link_of

_KIND = "waiting/"
_SHARE = 0.1  # of ranges by a detour, before anything is known of them
_DETOUR = 30.0  # sigmas of a range by which these err, or as the prediction does where that is more
_CERTAIN = 0.98  # from which a range is believed; of being by a detour: refused
_LONGEST_S = 30.0
_MOST_OF_LINK = 4  # that wait; the oldest is then decided by what is likelier, as beyond 30 s
_VAGUE = 1e12  # variance of a prediction, in that of the noise, with which nothing can wait
_MOST = 256  # of all links; what is more is decided so at once


class Believed(NamedTuple):
    """A group with the ranges of an instant.

    Attributes:
        joint: with those that are believed, and with those that wait.
        taken: of the new ranges, then those that waited: what was believed.
        waits: (m,) which of the new ranges now wait.
    """

    joint: Joint
    taken: Improved
    waits: NDArray[np.bool_]


def believed(joint: Joint, t_ns: int, ranges: Sequence[Range], rows_at: RowsAt) -> Believed:
    """A group with what is sure to be no detour of new ranges and of those that wait.

    Args:
        rows_at: of the m new ranges, about any mean.
    """
    held, new = [n for n in joint.names if n.startswith(_KIND)], len(ranges)
    every = _with_held(joint, held, rows_at)
    first = foretold(joint, every(joint.mean))
    ages_s = np.concatenate([np.zeros(new), _ages_s(held, t_ns)])
    take, wait = _decided(first, [*map(_link, ranges), *map(_link_of, held)], ages_s)
    taken = weighed(joint, every, first, np.where(take, weights(first), NOTHING))
    gone = [name for name, waits in zip(held, wait[new:], strict=True) if not waits]
    after = _with_waiting(taken.joint, t_ns, ranges, wait[:new], rows_at)
    return Believed(without(after, gone), taken, wait[:new])


def waiting_for(joint: Joint, carrier: str) -> list[str]:
    """Blocks of waiting ranges that a carrier is an end of."""
    return [n for n in joint.names if n.startswith(_KIND) and carrier in _link_of(n).split("|")]


def _with_held(joint: Joint, held: Sequence[str], rows_at: RowsAt) -> RowsAt:
    """Rows of new ranges, then of those that wait."""
    slots = [joint.first(name) for name in held]
    by_held = np.eye(len(joint.mean))[slots]

    def rows(mean: Array) -> Rows:
        new = rows_at(mean)
        residual = np.concatenate([new.residual, -mean[slots]])
        return Rows(residual, np.vstack([new.by, by_held]), np.arange(len(residual)))

    return rows


def _decided(
    first: Foretold, links: Sequence[str], ages_s: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which ranges to take in, and which to let wait; the rest is refused."""
    residual, variance = first.rows.residual, np.diag(first.spread)
    sure = variance < SURE
    last = (ages_s > _LONGEST_S) | (np.cumsum(~sure) > _MOST) | (variance > _VAGUE)
    likely = np.ones(len(links))
    for which in _alike(links, ages_s):
        if not sure[which].all():
            likely[which] = _no_detour(residual[which], first.spread[np.ix_(which, which)])
        last[which[:-_MOST_OF_LINK]] = True
    take = sure | (likely >= np.where(last, 0.5, _CERTAIN))
    return take, ~take & ~last & (likely > 1 - _CERTAIN)


def _alike(links: Sequence[str], ages_s: Array) -> Iterator[Indices]:
    """Which ranges are of one link, the oldest first; as many as can be weighed together."""
    of_link: dict[str, list[int]] = {}
    for i in np.argsort(-ages_s, kind="stable").tolist():
        of_link.setdefault(links[i], []).append(i)
    for which in of_link.values():
        for start in range(0, len(which), _MOST_OF_LINK + 1):
            yield np.array(which[start : start + _MOST_OF_LINK + 1], dtype=np.intp)


def _no_detour(residual: Array, spread: Array) -> Array:
    """(k,) probability that each of some ranges came straight, given all of them.

    Every set of detours is weighed: its share, times how likely the residuals are with it.
    """
    straight = np.array(list(product([True, False], repeat=len(residual))))
    noise = 1.0 + np.where(straight, 0.0, _DETOUR**2 + np.diag(spread))
    covariance = spread + noise[:, :, None] * np.eye(len(residual))
    chi2 = np.linalg.solve(covariance, np.broadcast_to(residual, straight.shape)[..., None])
    log = np.log(np.where(straight, 1 - _SHARE, _SHARE)).sum(axis=1)
    log -= (np.linalg.slogdet(covariance)[1] + chi2[..., 0] @ residual) / 2
    share = np.exp(log - log.max())
    return np.asarray(share @ straight / share.sum())


def _with_waiting(
    joint: Joint, t_ns: int, ranges: Sequence[Range], waits: NDArray[np.bool_], rows_at: RowsAt
) -> Joint:
    """A group with some of the new ranges as blocks."""
    which = np.flatnonzero(waits).tolist()
    if not which:
        return joint
    rows = rows_at(joint.mean)
    exact = np.zeros((len(which), len(which)))
    after = joined(joint, _KIND, -rows.residual[which], rows.by[which], exact)
    number = len(joint.names)  # no two that wait are named alike, be they of one instant
    names = [f"{_KIND}{t_ns}/{number + i}/{_link(ranges[i])}" for i in which]
    return after._replace(names=(*joint.names, *names))


def _link(log: Range) -> str:
    return link_of(log).removeprefix(LINK)


def _link_of(block: str) -> str:
    return block.split("/", 3)[3]


def _ages_s(held: Sequence[str], t_ns: int) -> Array:
    """(k,) since when ranges wait."""
    since_ns = [int(block.split("/")[1]) for block in held]
    return np.asarray((t_ns - np.array(since_ns, dtype=np.int64)) * 1e-9)
