"""A message as it was recorded, and the two orders in which messages are read."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from operator import attrgetter
from struct import Struct
from struct import error as StructError  # noqa: N812 - a class, whatever it is called
from typing import NamedTuple

import msgspec

from .. import codec
from ..keys import Address
from .index import Span
from .records import HEAD

_MESSAGE = Struct("<BQHIQQ")
_LEAST_BYTES = _MESSAGE.size - HEAD.size
"""A message without a payload."""


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


class KnownChannel(NamedTuple):
    """What the messages of a channel have in common."""

    address: Address
    key: str
    encoding: str


ReadSpan = Callable[[Span], list[Recorded]]
Channels = Mapping[int, KnownChannel | None]
"""Every channel there is; None where its messages are not wanted."""


def select(data: bytes, channels: Channels, start_ns: int, stop_ns: int) -> list[Recorded]:
    """The messages in a decompressed chunk that are wanted; of the others nothing is copied.

    Raises:
        struct.error: a record is not whole.
        KeyError: a message is on a channel that does not exist.
    """
    found: list[Recorded] = []
    fields, size, offset = _MESSAGE.unpack_from, len(data), 0
    last = size - _MESSAGE.size
    while offset <= last:
        opcode, length, number, sequence, log_time_ns, publish_time_ns = fields(data, offset)
        start, offset = offset + 31, offset + 9 + length
        if opcode != 5:  # Opcode.MESSAGE, whose look-up would take as long as the rest
            continue
        if length < _LEAST_BYTES or offset > size:
            raise StructError("record reaches beyond its chunk")
        channel = channels[number]
        if channel is not None and start_ns <= log_time_ns < stop_ns:
            address, key, encoding = channel
            payload = data[start:offset]
            found.append(
                _make((address, key, payload, encoding, log_time_ns, publish_time_ns, sequence))
            )
    _require_end(data, offset)
    return found


def in_file_order(spans: Iterable[Span], read: ReadSpan) -> Iterator[Recorded]:
    """Span after span."""
    for span in sorted(spans):
        yield from read(span)


TimeOf = Callable[[Recorded], int]


log_time_ns: TimeOf = attrgetter("log_time_ns")
"""When a message arrived, by the recorder's clock."""
stamp_ns: TimeOf = attrgetter("publish_time_ns")
"""When it was sent, by the sender's clock."""


def in_time_order(
    spans: Iterable[Span], read: ReadSpan, time_ns: TimeOf = log_time_ns
) -> Iterator[Recorded]:
    """Merge spans whose times overlap, holding only those; ties in the order of the file."""
    ordered = sorted(spans, key=lambda span: (span.start_ns, span.offset))
    waiting: list[tuple[int, int, int, Recorded]] = []
    for number, span in enumerate(ordered):
        messages = read(span)
        if not waiting and _is_apart(span, ordered[number + 1 : number + 2]):
            yield from sorted(messages, key=time_ns)
            continue
        waiting += [(time_ns(m), span.offset, n, m) for n, m in enumerate(messages)]
        waiting.sort()
        before = len(waiting)
        if number + 1 < len(ordered):
            following = ordered[number + 1]
            before = bisect_left(waiting, (following.start_ns, following.offset))
        for *_, message in waiting[:before]:
            yield message
        del waiting[:before]


def _is_apart(span: Span, following: list[Span]) -> bool:
    """Whether all of a span is due before anything of the next one."""
    return not any((one.start_ns, one.offset) < (span.end_ns, span.offset) for one in following)


def _require_end(data: bytes, offset: int) -> None:
    """Hold the last records, too short for a message, against the end of the chunk.

    Raises:
        struct.error: the last one is not whole.
    """
    while offset < len(data):
        opcode, length = HEAD.unpack_from(data, offset)
        offset += HEAD.size + length
        if opcode == 5:
            raise StructError("record reaches beyond its chunk")
    if offset > len(data):
        raise StructError("record reaches beyond its chunk")


_make = partial(tuple.__new__, Recorded)
"""`Recorded._make` without the check of the length."""
