"""Where names stand beside their marks: on the side where they hide the least."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array

GAP_PX, RISE_PX, PADDING_PX = 8, 5, 4
CHARACTER = 0.56
"""Width of a character, by the size of the font."""
NEIGHBOUR = 1000.0
"""A name upon another name or mark, in points of a line that it would hide."""


class Mark(NamedTuple):
    """A mark on the screen [px, down] and the name it is to have."""

    x: float
    y: float
    text: str
    size_px: int


class Side(NamedTuple):
    """Where the name goes, as bokeh wants to know: its offsets [px, down] and its alignment."""

    dx: int
    dy: int
    align: str


class Box(NamedTuple):
    """On the screen [px, down]."""

    left: float
    top: float
    right: float
    bottom: float

    def overlaps(self, other: Box) -> bool:
        """Whether the two have anything in common."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )

    def within(self, other: Box) -> bool:
        """Whether all of it is in the other."""
        return (
            other.left <= self.left
            and self.right <= other.right
            and other.top <= self.top
            and self.bottom <= other.bottom
        )

    def holds(self, points: Array) -> int:
        """How many of the points (n, 2) are in it."""
        x, y = points.T
        inside = (x > self.left) & (x < self.right) & (y > self.top) & (y < self.bottom)
        return int(np.count_nonzero(inside))


EVERYWHERE = Box(-inf, -inf, inf, inf)


def sides(marks: Sequence[Mark], lines: Array, shown: Box = EVERYWHERE) -> dict[Mark, Side]:
    """A side for the name of every mark, chosen one after the other.

    Args:
        marks: those that matter most come first.
        lines: points (n, 2) [px, down] of what had better not be hidden.
        shown: what can be seen; a name beyond it is cut off.
    """
    around = [_around(mark) for mark in marks]
    taken: list[Box] = []
    chosen: dict[Mark, Side] = {}
    for number, mark in enumerate(marks):
        others = [*taken, *around[:number], *around[number + 1 :]]
        side, box = min(_candidates(mark), key=lambda found: _cost(found[1], others, lines, shown))
        chosen[mark] = side
        taken.append(box)
    return chosen


def _candidates(mark: Mark) -> Iterator[tuple[Side, Box]]:
    """Right above, right below, left above, left below; the first of equals is taken."""
    width = CHARACTER * mark.size_px * len(mark.text) + PADDING_PX
    height = mark.size_px + PADDING_PX
    for align in ("left", "right"):
        for dy in (-RISE_PX, RISE_PX + height):
            dx = GAP_PX if align == "left" else -GAP_PX
            left = mark.x + dx if align == "left" else mark.x + dx - width
            bottom = mark.y + dy
            yield Side(dx, dy, align), Box(left, bottom - height, left + width, bottom)


def _cost(box: Box, others: Sequence[Box], lines: Array, shown: Box) -> float:
    spoilt = sum(box.overlaps(other) for other in others) + (not box.within(shown))
    return NEIGHBOUR * spoilt + box.holds(lines)


def _around(mark: Mark) -> Box:
    half = GAP_PX / 2
    return Box(mark.x - half, mark.y - half, mark.x + half, mark.y + half)
