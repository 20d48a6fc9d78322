"""The messages of two recordings in pairs: the same place in the same channel of both."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from typing import NamedTuple

from schemas.recording.reader import Recorded


class Place(NamedTuple):
    """Where a message stands in a recording, whatever the run is called.

    Attributes:
        channel: its key after the run.
        sequence: as its sender counts; repetition: how often this one came before.
    """

    channel: str
    sequence: int
    repetition: int


class Pair(NamedTuple):
    """One place of two recordings; None where one of them has nothing there."""

    place: Place
    before: Recorded | None
    after: Recorded | None


def channel_of(key: str) -> str:
    """A key after the run."""
    return key.split("/", 3)[3]


def pairs(before: Iterable[Recorded], after: Iterable[Recorded]) -> Iterator[Pair]:
    """Every place of either recording once.

    Both are read side by side, and only what has come in one and not yet in the other is held: in
    recordings of like order next to nothing.
    """
    was, became = _Side(), _Side()
    for one, other in zip_longest(before, after):
        if one is not None:
            place = was.place_of(one)
            if (found := became.waiting.pop(place, None)) is not None:
                yield Pair(place, one, found)
            else:
                was.waiting[place] = one
        if other is not None:
            place = became.place_of(other)
            if (found := was.waiting.pop(place, None)) is not None:
                yield Pair(place, found, other)
            else:
                became.waiting[place] = other
    for place, message in was.waiting.items():
        yield Pair(place, message, None)
    for place, message in became.waiting.items():
        yield Pair(place, None, message)


class _Side:
    """What has been read of one recording."""

    def __init__(self) -> None:
        self.waiting: dict[Place, Recorded] = {}
        self._seen: Counter[tuple[str, int]] = Counter()

    def place_of(self, message: Recorded) -> Place:
        """The place of the next message."""
        channel = channel_of(message.key)
        name = (channel, message.sequence)
        self._seen[name] += 1
        return Place(channel, message.sequence, self._seen[name] - 1)
