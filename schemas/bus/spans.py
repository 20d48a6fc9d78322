"""Sets of whole numbers kept as spans: as cheap for 10**18 numbers in a row as for one."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator

Span = tuple[int, int]
"""First and last of a run of numbers, both included."""


class Spans:
    """A set of integers; what it costs is the number of runs in it, never their length."""

    __slots__ = ("_firsts", "_lasts")

    def __init__(self) -> None:
        self._firsts: list[int] = []
        self._lasts: list[int] = []

    def __contains__(self, number: int) -> bool:
        place = bisect_left(self._lasts, number)
        return place < len(self._lasts) and self._firsts[place] <= number

    def __iter__(self) -> Iterator[Span]:
        """Its runs, in order."""
        return zip(self._firsts, self._lasts, strict=True)

    def __len__(self) -> int:
        """How many runs there are, not how many numbers."""
        return len(self._firsts)

    @property
    def last(self) -> int:
        """The greatest number; 0 in an empty set."""
        return self._lasts[-1] if self._lasts else 0

    def touches(self, number: int) -> bool:
        """Whether a number is in the set or next to one that is: adding it makes no new run."""
        place = bisect_left(self._lasts, number - 1)
        return place < len(self._lasts) and self._firsts[place] <= number + 1

    def add(self, first: int, last: int) -> None:
        """Put first .. last in; runs that touch become one."""
        if first > last:
            return
        if self._lasts and first == self._lasts[-1] + 1:  # the next one, as nearly always
            self._lasts[-1] = last
            return
        start, end = bisect_left(self._lasts, first - 1), bisect_right(self._firsts, last + 1)
        if start < end:
            first = min(first, self._firsts[start])
            last = max(last, self._lasts[end - 1])
        self._firsts[start:end], self._lasts[start:end] = [first], [last]

    def extend(self, number: int) -> bool:
        """Put a number in if it is the one after the greatest; whether it is."""
        if not self._lasts or self._lasts[-1] + 1 != number:
            return False
        self._lasts[-1] = number
        return True

    def discard(self, first: int, last: int) -> None:
        """Take first .. last out, as far as they are in."""
        start, end = bisect_left(self._lasts, first), bisect_right(self._firsts, last)
        if start >= end or first > last:
            return
        left = (self._firsts[start], first - 1)
        right = (last + 1, self._lasts[end - 1])
        kept = [span for span in (left, right) if span[0] <= span[1]]
        self._firsts[start:end] = [span[0] for span in kept]
        self._lasts[start:end] = [span[1] for span in kept]

    def holes(self, first: int, last: int) -> Iterator[Span]:
        """The runs of first .. last that are not in the set, in order."""
        place = bisect_left(self._lasts, first)
        while first <= last:
            if place == len(self._firsts) or self._firsts[place] > last:
                yield first, last
                return
            if self._firsts[place] > first:
                yield first, self._firsts[place] - 1
            first = self._lasts[place] + 1
            place += 1

    def forget_first(self) -> None:
        """Take the lowest run out."""
        del self._firsts[0], self._lasts[0]
