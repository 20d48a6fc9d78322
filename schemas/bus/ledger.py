"""Which messages of every stream have been seen: duplicates, gaps and what came too late."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from .spans import Spans

MAX_SPANS = 4096
"""Separate runs of one stream that are remembered: more gaps than that are a fault of its own."""
MAX_JUMP = 2**20
"""A seq further than this beyond the last is no gap but a fault; nothing is lost so quickly."""
MAX_FIRST = 2**53
"""The greatest seq a stream can be met at: what every language counts exactly."""


class StreamKey(NamedTuple):
    """A sequence of messages counted from 1: one stream of one boot of one process."""

    process: str
    boot: str
    stream: str


class Seen(Enum):
    """What a sequence number turned out to be."""

    NEW = "new"
    DUPLICATE = "duplicate"
    LATE = "late"
    """It had been given up before it came."""
    REFUSED = "refused"
    """It would open one gap more than can be remembered; it counts as not come."""


@dataclass(slots=True)
class _Stream:
    accounted: Spans = field(default_factory=Spans)
    """What has come or been given up."""
    gave_up: Spans = field(default_factory=Spans)


class Ledger:
    """Accounts for the sequence numbers of any number of streams.

    Memory and time grow with the number of gaps, never with their length: a seq of 2**62 costs no
    more than one of 2. A receiver that does not choose its senders bounds the number of streams by
    `forget`.

    Args:
        max_spans: of one stream, before more gaps are refused.
    """

    def __init__(self, max_spans: int = MAX_SPANS) -> None:
        self._streams: dict[StreamKey, _Stream] = {}
        self._max_spans = max_spans

    def note(self, key: StreamKey, seq: int) -> Seen:
        """Account for one message that came."""
        stream = self._streams.get(key)
        if stream is None:
            stream = self._streams[key] = _Stream()
        if seq <= stream.accounted.last:
            if seq in stream.gave_up:
                stream.gave_up.discard(seq, seq)
                return Seen.LATE
            if seq in stream.accounted:
                return Seen.DUPLICATE
        if len(stream.accounted) >= self._max_spans and not stream.accounted.touches(seq):
            return Seen.REFUSED
        stream.accounted.add(seq, seq)
        return Seen.NEW

    def follower(self, key: StreamKey) -> Callable[[int], bool]:
        """Accounts for a message if it is the one after all of its stream, and says whether it is.

        What it does not account for is to be noted. It is of no use once the stream is forgotten.
        """
        return self._streams.setdefault(key, _Stream()).accounted.extend

    def is_absurd(self, key: StreamKey, seq: int) -> bool:
        """Whether a seq is so far from all others of its stream that it cannot be meant."""
        highest = self.highest(key)
        return seq > (highest + MAX_JUMP if highest else MAX_FIRST)

    def give_up(self, key: StreamKey, first: int, last: int) -> None:
        """Account for messages that will not be waited for; one that comes all the same is LATE."""
        stream = self._streams.setdefault(key, _Stream())
        for hole in list(stream.accounted.holes(first, last)):
            stream.gave_up.add(*hole)
        stream.accounted.add(first, last)
        while len(stream.gave_up) > self._max_spans:  # such a late one will count as a duplicate
            stream.gave_up.forget_first()

    def through(self, key: StreamKey) -> int:
        """The last sequence number before the first gap; 0 for an unknown stream."""
        stream = self._streams.get(key)
        first, last = next(iter(stream.accounted), (0, 0)) if stream else (0, 0)
        return last if first == 1 else 0

    def highest(self, key: StreamKey) -> int:
        """The highest sequence number seen."""
        stream = self._streams.get(key)
        return stream.accounted.last if stream else 0

    def missing(self, key: StreamKey, last: int) -> list[tuple[int, int]]:
        """Gaps (first, last) up to `last`, in order."""
        stream = self._streams.get(key)
        return list((stream.accounted if stream else Spans()).holes(1, last))

    def gaps(self) -> Iterator[tuple[StreamKey, int, int]]:
        """Every gap below a message that has come, over all streams."""
        for key, stream in self._streams.items():
            for first, last in stream.accounted.holes(1, stream.accounted.last):
                yield key, first, last

    def given_up(self) -> Iterator[tuple[StreamKey, int, int]]:
        """Everything that was given up and has not come since."""
        for key, stream in self._streams.items():
            for first, last in stream.gave_up:
                yield key, first, last

    def streams(self) -> list[StreamKey]:
        """Every stream seen, in order of first appearance."""
        return list(self._streams)

    def forget(self, key: StreamKey) -> None:
        """Know nothing of a stream any more; what comes of it again is new."""
        self._streams.pop(key, None)
