"""Which points of a plane are in which upright boxes: a sort and a table, without a tree.

The plane is cut into strips as wide as the boxes are on average, and the strips into bins; points
are sorted along the strips, so that what a box can hold of a strip is one run of them, and the
table says where the points of each bin begin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices

_BINS = 4  # to a point: a run is hardly longer than what the box holds of it


class _Strips(NamedTuple):
    """Strips across the first coordinate, cut into bins along the second, and the m points in them.

    Attributes:
        least: (2,) corner; width: of a strip; number: of strips.
        length: of a bin; bins: in a strip.
        point: (m,) whose it is, by bin; begins: (all bins + 1,) where the points of each begin.
    """

    least: Array
    width: float
    number: int
    length: float
    bins: int
    point: Indices
    begins: Indices

    def strip(self, first: Array) -> Indices:
        """In which strip a first coordinate is."""
        numbered = np.floor((first - self.least[0]) / self.width).astype(np.intp)
        return np.asarray(np.minimum(numbered, self.number - 1))

    def along(self, strip: Indices, second: Array) -> Array:
        """How many bins, and what part of one, lie before a second coordinate of a strip."""
        within = np.minimum((second - self.least[1]) / self.length, self.bins - 0.5)
        return np.asarray(strip * self.bins + within)


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
    for axis, values in enumerate(points):
        value = values[point]
        kept = np.flatnonzero((value >= low[axis, box]) & (value <= high[axis, box]))
        box, point = box[kept], point[kept]
    return which[box], point


def _cut(points: Array, widths: Array) -> _Strips:
    """Strips over points, for boxes of some widths; no more strips than points."""
    least, extent = points.min(axis=1), np.ptp(points, axis=1)
    size = points.shape[-1]
    width = max(float(widths.mean()), float(extent[0]) / size, 1e-300)
    number = int(extent[0] / width) + 1
    bins = 1 + _BINS * size // number
    length = float(extent[1]) / bins or 1.0
    none = np.empty(0, dtype=np.intp)
    empty = _Strips(least, width, number, length, bins, none, none)
    along = empty.along(empty.strip(points[0]), points[1])
    each = np.bincount(along.astype(np.intp), minlength=number * bins)
    order = np.argsort(along, kind="stable")
    return empty._replace(point=order, begins=np.concatenate([[0], np.cumsum(each)]))


def _in_runs(low: Array, high: Array, cut: _Strips) -> tuple[Indices, Indices]:
    """Pairs (box, point) whose second coordinates may agree, of the strips each box touches."""
    box, strip = unfolded(cut.strip(low[0]), cut.strip(high[0]) + 1)
    first, last = (cut.along(strip, edge[1, box]).astype(np.intp) for edge in (low, high))
    run, place = unfolded(cut.begins[first], cut.begins[last + 1])
    return box[run], cut.point[place]


def unfolded(begin: Indices, end: Indices) -> tuple[Indices, Indices]:
    """Every number from `begin` to before `end` (n,), and whose it is."""
    count = end - begin
    owner = np.repeat(np.arange(len(count)), count)
    before = np.cumsum(count) - count
    return owner, np.arange(len(owner)) + (begin - before)[owner]
