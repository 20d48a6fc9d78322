"""A message as it was recorded, and the two orders in which messages are read."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import msgspec

from .. import codec
from ..keys import Address
from .index import Span


class Recorded(NamedTuple):
    """One message as it was recorded; `sequence` is its lower 32 bits."""

    address: Address
    key: str
    payload: bytes
    encoding: str
    log_time_ns: int
    publish_time_ns: int
    sequence: int

    def decode(self) -> msgspec.Struct:
        """The message itself.

        Raises:
            WireError: the payload was not valid when it was recorded.
        """
        return codec.decode(self.address.topic.message, self.payload, self.encoding)


ReadSpan = Callable[[Span], Iterable[Recorded]]


def in_file_order(spans: Iterable[Span], read: ReadSpan) -> Iterator[Recorded]:
    """Span after span."""
    for span in sorted(spans):
        yield from read(span)


def in_log_time_order(spans: Iterable[Span], read: ReadSpan) -> Iterator[Recorded]:
    """Merge spans whose times overlap, holding only those; ties in the order of the file."""
    waiting: list[tuple[int, int, int, Recorded]] = []
    for span in sorted(spans, key=lambda span: (span.start_ns, span.offset)):
        before = bisect_left(waiting, (span.start_ns, span.offset))
        for *_, message in waiting[:before]:
            yield message
        del waiting[:before]
        waiting += [(m.log_time_ns, span.offset, n, m) for n, m in enumerate(read(span))]
        waiting.sort()
    for *_, message in waiting:
        yield message
