"""Holds what has come until a Closed names it, for whoever fuses a recorded sequence."""

from __future__ import annotations

from collections.abc import Iterable

from schemas.messages import Closed, Event, Input, StreamSpan

from . import timeline
from .state import Timeline

CLOSINGS_KEPT = 1000
"""What no Closed has named for so many of them never will be."""
_SWEEP = 100


class Holding:
    """Messages by stream and seq; duplicates are one."""

    def __init__(self) -> None:
        self._inputs: dict[tuple[str, str, str, int], tuple[Input, int]] = {}
        self._events: dict[int, Event] = {}
        self._closings = 0

    def __len__(self) -> int:
        return len(self._inputs) + len(self._events)

    def put(self, message: Input | Event) -> None:
        """Take a message in, whatever the order."""
        if isinstance(message, Event):
            self._events.setdefault(message.seq, message)
            return
        name = (message.carrier, message.boot, message.stream, message.seq)
        self._inputs.setdefault(name, (message, self._closings))

    def missing(self, before: Timeline, closed: Closed) -> StreamSpan | None:
        """The first message a Closed names that is not here, as a span of one."""
        for span in (*timeline.named(before, closed), *closed.late):
            for seq in range(span.first, span.last + 1):
                if (span.carrier, span.boot, span.stream, seq) not in self._inputs:
                    return StreamSpan(
                        carrier=span.carrier,
                        boot=span.boot,
                        stream=span.stream,
                        first=seq,
                        last=seq,
                    )
        return None

    def release(self, before: Timeline, closed: Closed) -> list[Input | Event]:
        """What a Closed names and the events of its step, which are forgotten here."""
        self._closings += 1
        found: list[Input | Event] = [e for e in self._events.values() if e.step == closed.step]
        self._events = {seq: e for seq, e in self._events.items() if e.step > closed.step}
        names = [*_names((*timeline.named(before, closed), *closed.late))]
        found += [self._inputs.pop(name)[0] for name in names if name in self._inputs]
        if self._closings % _SWEEP == 0:
            oldest = self._closings - CLOSINGS_KEPT
            self._inputs = {n: held for n, held in self._inputs.items() if held[1] >= oldest}
        return found


def _names(spans: Iterable[StreamSpan]) -> Iterable[tuple[str, str, str, int]]:
    for span in spans:
        for seq in range(span.first, span.last + 1):
            yield span.carrier, span.boot, span.stream, seq
