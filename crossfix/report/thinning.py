"""Keeping a bounded, even share of a stream whose length is not known beforehand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")


class _Kept(NamedTuple, Generic[T]):
    number: int
    item: T
    weight: int


class Thinned(Generic[T]):
    """Every k-th item of a stream, with k the least power of two that bounds their weight.

    Args:
        limit: greatest sum of the weights kept; a single item may weigh more.
    """

    def __init__(self, limit: int) -> None:
        self.every = 1
        self._limit = limit
        self._offered = 0
        self._weight = 0
        self._kept: list[_Kept[T]] = []

    def __iter__(self) -> Iterator[T]:
        return (kept.item for kept in self._kept)

    def __len__(self) -> int:
        return len(self._kept)

    def wants_next(self) -> bool:
        """Whether the next item of the stream is to be kept: one that is not need not be made."""
        self._offered += 1
        return (self._offered - 1) % self.every == 0

    def keep(self, item: T, weight: int) -> None:
        """Keep the item that was wanted."""
        self._kept.append(_Kept(self._offered - 1, item, weight))
        self._weight += weight
        while self._weight > self._limit and len(self._kept) > 1:
            self.every *= 2
            self._kept = [kept for kept in self._kept if kept.number % self.every == 0]
            self._weight = sum(kept.weight for kept in self._kept)


def stride(count: int, limit: int) -> slice:
    """The slice that takes every k-th of `count` items so that at most `limit` are left."""
    return slice(None, None, max(1, -(-count // limit)))
