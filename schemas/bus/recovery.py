"""Fetches what a receiver has missed from its owner, in a thread of its own."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable
from dataclasses import dataclass

from .. import codec, keys
from ..errors import WireError
from ..messages import BackfillReply, BackfillRequest
from .interface import Bus, Inbox, Sample
from .ledger import StreamKey

OVERTAKING_S = 0.05
"""A closed step often overtakes its data on another session: wait this long before asking."""
ATTEMPT_S = 0.3
ATTEMPTS = 3
RELINK_S = 3.0
"""After a lost link its owner may need this long to be back."""

Gap = tuple[StreamKey, int, int]


@dataclass(slots=True)
class _Case:
    first: int
    noticed_s: float
    asked_s: float = 0.0
    attempts: int = 0
    in_flight: bool = False
    answered: bool = False
    """What is still missing once the inbox has been emptied, the owner no longer has."""
    weighed: bool = False


class Recovery:
    """Asks for gaps until they are filled or hopeless; what comes goes into the inbox.

    The receiver calls `pursue` in its loop with the gaps that are left after it has emptied the
    inbox, and gives up those that come back.
    """

    def __init__(self, run: str, bus: Bus, inbox: Inbox[Sample]) -> None:
        self.fetched = 0
        self._run, self._bus, self._inbox = run, bus, inbox
        self._cases: dict[StreamKey, _Case] = {}
        self._orders: queue.SimpleQueue[tuple[Gap, _Case] | None] = queue.SimpleQueue()
        self._linked_s = float("-inf")
        self._was_up = True
        self._thread = threading.Thread(target=self._work, name="recovery", daemon=True)
        self._thread.start()

    def pursue(self, gaps: Iterable[Gap], now_s: float) -> list[Gap]:
        """Ask for the first gap of every stream; the gaps that cannot be had."""
        self._watch_link(now_s)
        first_of: dict[StreamKey, Gap] = {}
        for gap in gaps:
            first_of.setdefault(gap[0], gap)
        for key in self._cases.keys() - first_of.keys():
            del self._cases[key]
        return [gap for gap in first_of.values() if self._is_hopeless(gap, now_s)]

    def close(self) -> None:
        """End the thread."""
        self._orders.put(None)
        self._thread.join(timeout=2 * ATTEMPT_S)

    def _watch_link(self, now_s: float) -> None:
        up = self._bus.link_up()
        if up and not self._was_up:
            self._linked_s = now_s
        self._was_up = up

    def _is_hopeless(self, gap: Gap, now_s: float) -> bool:
        key, first, _ = gap
        case = self._cases.get(key)
        if case is None or case.first != first:
            case = self._cases[key] = _Case(first, now_s)
        if case.in_flight or not self._was_up:
            return False
        if case.answered and not case.weighed:
            case.weighed = True
            return False
        if case.weighed or (
            case.attempts >= ATTEMPTS and now_s - max(self._linked_s, case.noticed_s) > RELINK_S
        ):
            return True
        due_s = case.asked_s + ATTEMPT_S if case.asked_s else case.noticed_s + OVERTAKING_S
        if now_s >= due_s:
            case.asked_s, case.in_flight = now_s, True
            self._orders.put((gap, case))
        return False

    def _work(self) -> None:
        while (order := self._orders.get()) is not None:
            gap, case = order
            case.answered = self._ask(gap)
            case.attempts += 1
            case.in_flight = False

    def _ask(self, gap: Gap) -> bool:
        """Whether the owner answered; what it still had is in the inbox by then."""
        key, first, last = gap
        request = BackfillRequest(boot=key.boot, stream=key.stream, first=first, last=last)
        samples = self._bus.query(
            keys.BACKFILL.key(self._run, key.process),
            codec.encode(request),
            codec.encoding_of(BackfillRequest),
            ATTEMPT_S,
        )
        for sample in samples:
            try:
                reply = codec.decode(BackfillReply, sample.payload, sample.encoding)
            except WireError:
                continue
            for record in reply.records:
                self.fetched += 1
                self._inbox.put(
                    Sample(record.key, record.payload, record.encoding), len(record.payload)
                )
        return bool(samples)
