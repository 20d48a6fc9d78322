"""Which messages a Closed names, whether they are of its time, and in which order they count."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import NamedTuple

from msgspec.structs import replace

from schemas.keys import RESERVED_STREAMS
from schemas.messages import Closed, Event, Input, SourceInfo, StreamSpan

from .state import Boots, Timeline

BOOTS_KEPT = 8
"""Lives of a carrier whose streams are remembered; an older one that spoke again would be new."""
SPANS_KEPT = 1000
"""Spans given up beyond what a manifest has reached yet."""


BACK_NS = 2_000_000_000
"""How much later than clocks may be wrong a message may come and still be fused."""
_Identity = tuple[str, str, str, int]
_MOST = 2**62
"""What a count may come to; a stream may be given up in spans of any length."""


class Instant(NamedTuple):
    """What was said of one instant: first what sources and carriers are, then what they saw."""

    t_ns: int
    messages: list[Input]


class Batch(NamedTuple):
    """The messages of one Closed.

    Attributes:
        events: of operators, in order.
        instants: what is fused, in order of time.
        late: messages not fused because they came, or were stamped, too late.
        future: messages not fused because they are stamped too far after the closing.
        late_count, gave_up_count: messages not fused for that reason, those never had included.
    """

    events: list[Event]
    instants: list[Instant]
    late: list[Input]
    future: list[Input]
    late_count: int
    gave_up_count: int

    @property
    def fused(self) -> int:
        """How many messages are fused."""
        return sum(len(instant.messages) for instant in self.instants)


def take(
    timeline: Timeline, closed: Closed, messages: Iterable[Input | Event], max_clock_error_s: float
) -> tuple[Timeline, Batch]:
    """Sort out what a Closed names; whatever else is among the messages is left alone.

    What comes later than others of its time is fused all the same, if it is not older than
    `max_clock_error_s` and `BACK_NS` before the last closing; see `rollback`. A SourceInfo is
    never late or early: it tells what a source is, not what was at an instant.

    Raises:
        ValueError: a message that the Closed names is not there; the caller must wait for it, or
            write it into `gave_up`.
    """
    inputs = {_identity(m): m for m in messages if isinstance(m, Input)}
    events = [m for m in messages if isinstance(m, Event) and m.step == closed.step]
    after = close(timeline, closed)
    tolerance_ns = round(max_clock_error_s * 1e9)
    on_time: list[Input] = []
    future: list[Input] = []
    late: list[Input] = []
    stragglers = [m for name, m in sorted(inputs.items()) if _is_in(closed.late, name)]
    for message in (*_all_of(named(timeline, closed), inputs), *stragglers):
        if isinstance(message, SourceInfo):
            on_time.append(message)
        elif message.t_ns < timeline.t_ns - tolerance_ns - BACK_NS:
            late.append(message)
        elif message.t_ns > closed.t_ns + tolerance_ns:
            future.append(message)
        else:
            on_time.append(message)
    events.sort(key=lambda event: event.seq)
    missing = _size(closed.late) - len(stragglers)
    return after, Batch(
        events, instants(after, on_time), late, future, len(late) + missing, _size(closed.gave_up)
    )


def named(timeline: Timeline, closed: Closed) -> list[StreamSpan]:
    """The messages a Closed has fused: news of its manifest, less what was given up."""
    spans: list[StreamSpan] = []
    seen = dict(timeline.seen)
    gave_up = (*timeline.gave_up, *closed.gave_up)
    for end in closed.manifest:
        stream = _stream(end.carrier, end.boot, end.stream)
        first = seen.get(stream, 0) + 1
        if end.last_seq >= first:
            seen[stream] = end.last_seq
            news = StreamSpan(
                carrier=end.carrier,
                boot=end.boot,
                stream=end.stream,
                first=first,
                last=end.last_seq,
            )
            spans += _less(news, gave_up)
    return spans


def close(timeline: Timeline, closed: Closed) -> Timeline:
    """The timeline after a Closed."""
    boots, seen = dict(timeline.boots), dict(timeline.seen)
    for end in closed.manifest:
        life = boots.get(end.carrier, Boots())
        if end.boot not in life.recent:
            recent = (*life.recent, end.boot)[-BOOTS_KEPT:]
            for forgotten in set(life.recent) - set(recent):
                prefix = _stream(end.carrier, forgotten, "")
                seen = {s: seq for s, seq in seen.items() if not s.startswith(prefix)}
            boots[end.carrier] = Boots(life.count + 1, recent)
        stream = _stream(end.carrier, end.boot, end.stream)
        seen[stream] = max(seen.get(stream, 0), end.last_seq)
    ahead = [
        span
        for span in (*timeline.gave_up, *closed.gave_up)
        if span.last > seen.get(_stream(span.carrier, span.boot, span.stream), 0)
    ]
    t_ns = max(timeline.t_ns, closed.t_ns)
    return Timeline(
        t_ns=t_ns,
        boots=dict(sorted(boots.items())),
        seen=dict(sorted(seen.items())),
        gave_up=tuple(ahead[-SPANS_KEPT:]),
    )


def ordinal(timeline: Timeline, carrier: str, boot: str) -> int:
    """Which life of its carrier a boot is, counted from 1 in the order of Closed; 0 = unknown."""
    life = timeline.boots.get(carrier, Boots())
    if boot not in life.recent:
        return 0
    return life.count - (len(life.recent) - 1 - life.recent.index(boot))


def instants(timeline: Timeline, messages: Iterable[Input]) -> list[Instant]:
    """Messages by instant, in the one order that counts.

    At one instant the reserved streams come first: a report is placed by its carrier's navigation.
    """

    def rank(message: Input) -> tuple[int, bool, str, int, str, int]:
        boot = ordinal(timeline, message.carrier, message.boot)
        about_target = message.stream not in RESERVED_STREAMS
        return message.t_ns, about_target, message.carrier, boot, message.stream, message.seq

    grouped = groupby(sorted(messages, key=rank), key=lambda message: message.t_ns)
    return [Instant(t_ns, list(group)) for t_ns, group in grouped]


def _all_of(spans: Iterable[StreamSpan], inputs: dict[_Identity, Input]) -> list[Input]:
    """Every message of the spans.

    Raises:
        ValueError: one is not there.
    """
    found = []
    for span in spans:
        for seq in range(span.first, span.last + 1):
            message = inputs.get((span.carrier, span.boot, span.stream, seq))
            if message is None:
                raise ValueError(f"the Closed names {span}, but message {seq} is not there")
            found.append(message)
    return found


def _is_in(spans: Iterable[StreamSpan], name: _Identity) -> bool:
    return any(
        (span.carrier, span.boot, span.stream) == name[:3] and span.first <= name[3] <= span.last
        for span in spans
    )


def _size(spans: Iterable[StreamSpan]) -> int:
    return min(_MOST, sum(span.last - span.first + 1 for span in spans))


def _less(span: StreamSpan, taken: Iterable[StreamSpan]) -> list[StreamSpan]:
    """What is left of a span without what others of its stream cover."""
    left = [span]
    for other in taken:
        if (other.carrier, other.boot, other.stream) == (span.carrier, span.boot, span.stream):
            left = [
                replace(piece, first=first, last=last)
                for piece in left
                for first, last in (
                    (piece.first, min(piece.last, other.first - 1)),
                    (max(piece.first, other.last + 1), piece.last),
                )
                if first <= last
            ]
    return left


def _identity(message: Input) -> _Identity:
    return message.carrier, message.boot, message.stream, message.seq


def _stream(carrier: str, boot: str, stream: str) -> str:
    return f"{carrier}/{boot}/{stream}"
