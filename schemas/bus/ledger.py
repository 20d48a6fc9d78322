"""Which messages of every stream have been seen: duplicates, gaps and what came too late."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple


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


@dataclass(slots=True)
class _Stream:
    through: int = 0
    """Everything up to here is accounted for."""
    ahead: set[int] = field(default_factory=set)
    gave_up: set[int] = field(default_factory=set)


class Ledger:
    """Accounts for the sequence numbers of any number of streams in bounded memory."""

    def __init__(self) -> None:
        self._streams: dict[StreamKey, _Stream] = {}

    def note(self, key: StreamKey, seq: int) -> Seen:
        """Account for one message that came."""
        stream = self._streams.setdefault(key, _Stream())
        if seq in stream.gave_up:
            stream.gave_up.discard(seq)
            return Seen.LATE
        if seq <= stream.through or seq in stream.ahead:
            return Seen.DUPLICATE
        stream.ahead.add(seq)
        _advance(stream)
        return Seen.NEW

    def give_up(self, key: StreamKey, first: int, last: int) -> None:
        """Account for messages that will not be waited for; one that comes all the same is LATE."""
        stream = self._streams.setdefault(key, _Stream())
        lost = set(range(first, last + 1)) - stream.ahead
        stream.gave_up |= {seq for seq in lost if seq > stream.through}
        stream.ahead |= lost
        _advance(stream)

    def through(self, key: StreamKey) -> int:
        """The last sequence number before the first gap; 0 for an unknown stream."""
        stream = self._streams.get(key)
        return stream.through if stream else 0

    def highest(self, key: StreamKey) -> int:
        """The highest sequence number seen."""
        stream = self._streams.get(key)
        return max(stream.ahead, default=stream.through) if stream else 0

    def missing(self, key: StreamKey, last: int) -> list[tuple[int, int]]:
        """Gaps (first, last) up to `last`, in order."""
        stream = self._streams.get(key, _Stream())
        gaps: list[tuple[int, int]] = []
        for seq in range(stream.through + 1, last + 1):
            if seq in stream.ahead:
                continue
            if gaps and gaps[-1][1] == seq - 1:
                gaps[-1] = (gaps[-1][0], seq)
            else:
                gaps.append((seq, seq))
        return gaps

    def gaps(self) -> Iterator[tuple[StreamKey, int, int]]:
        """Every gap below a message that has come, over all streams."""
        for key, stream in self._streams.items():
            if stream.ahead:
                for first, last in self.missing(key, max(stream.ahead)):
                    yield key, first, last

    def streams(self) -> list[StreamKey]:
        """Every stream seen, in order of first appearance."""
        return list(self._streams)


def _advance(stream: _Stream) -> None:
    while stream.through + 1 in stream.ahead:
        stream.through += 1
        stream.ahead.discard(stream.through)
