"""Which points of a plane are in which upright boxes: a sort and two searches, without a tree.

The plane is cut into strips as wide as the boxes are on average; points are sorted by strip and
then along it, so that what a box can hold of a strip is one run.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices

_ROUNDING = 1e-12  # by which runs are looked up longer, of the largest key


class _Strips(NamedTuple):
    """Strips across the first coordinate, and the m points in them.

    Attributes:
        least: (2,) corner; width: of a strip; number: of strips; length: of a strip, as a key.
        key: (m,) ascending; point: (m,) whose it is.
    """

    least: Array
    width: float
    number: int
    length: float
    key: Array
    point: Indices

    def strip(self, first: Array) -> Indices:
        """In which strip a first coordinate is."""
        numbered = np.floor((first - self.least[0]) / self.width).astype(np.intp)
        return np.asarray(np.minimum(numbered, self.number - 1))


def inside(low: Array, high: Array, points: Array) -> tuple[Indices, Indices]:
    """Pairs (box, point), by box, of all points in n boxes, their edges included.

    Args:
        low, high: (2, n) corners; boxes with high < low are empty.
        points: (2, m) finite.
    """
    none = np.empty(0, dtype=np.intp)
    if not points.shape[-1]:
        return none, none
    corners = points.min(axis=1)[:, None], points.max(axis=1)[:, None]
    touching = (high >= low) & (high >= corners[0]) & (low <= corners[1])
    which = np.flatnonzero(touching.all(axis=0))
    if not which.size:
        return none, none
    low, high = (np.clip(edge[:, which], *corners) for edge in (low, high))
    box, point = _in_runs(low, high, _cut(points, high[0] - low[0]))
    first = points[0, point]
    kept = np.flatnonzero((first >= low[0, box]) & (first <= high[0, box]))
    return which[box[kept]], point[kept]


def _cut(points: Array, widths: Array) -> _Strips:
    """Strips over points, for boxes of some widths; no more strips than points."""
    least, extent = points.min(axis=1), np.ptp(points, axis=1)
    width = max(float(widths.mean()), float(extent[0]) / points.shape[-1], 1e-300)
    number, length = int(extent[0] / width) + 1, float(2.0 * extent[1]) or 1.0
    empty = _Strips(least, width, number, length, np.empty(0), np.empty(0, dtype=np.intp))
    key = empty.strip(points[0]) * length + (points[1] - least[1])
    order = np.argsort(key, kind="stable")
    return empty._replace(key=key[order], point=order)


def _in_runs(low: Array, high: Array, cut: _Strips) -> tuple[Indices, Indices]:
    """Pairs (box, point) whose second coordinates agree, of the strips that each box touches."""
    first = cut.strip(low[0])
    box, strip = unfolded(first, cut.strip(high[0]) + 1)
    slack = _ROUNDING * cut.length * cut.number
    ends = [strip * cut.length + (edge[1, box] - cut.least[1]) for edge in (low, high)]
    begin = np.searchsorted(cut.key, ends[0] - slack, side="left")
    end = np.searchsorted(cut.key, ends[1] + slack, side="right")
    run, place = unfolded(begin, end)
    return box[run], cut.point[place]


def unfolded(begin: Indices, end: Indices) -> tuple[Indices, Indices]:
    """Every number from `begin` to before `end` (n,), and whose it is."""
    count = end - begin
    owner = np.repeat(np.arange(len(count)), count)
    before = np.cumsum(count) - count
    return owner, np.arange(len(owner)) + (begin - before)[owner]
