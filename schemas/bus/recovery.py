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
from .limits import weigh

OVERTAKING_S = 0.05
"""A closed step often overtakes its data on another session: wait this long before asking."""
ATTEMPT_S = 0.3
ATTEMPTS = 3
MOST_ATTEMPT_S = 1.2
"""A slow owner is given more time from question to question, up to this."""
MAX_DOUBLINGS = 3
"""The pause before a silent owner is asked again grows to 8 attempts."""
AT_ONCE = 8
"""Questions to one owner under way, while it answers."""
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


@dataclass(slots=True)
class _Owner:
    asked: int = 0
    """Questions under way."""
    silent: int = 0
    """Questions in a row without an answer."""


class Recovery:
    """Asks for gaps until they are filled or hopeless; what comes goes into the inbox.

    The receiver calls `pursue` in its loop with the gaps that are left after it has emptied the
    inbox, and gives up those that come back. An owner that does not answer is asked one thing at a
    time and ever less often: it must not hold up the others.

    Args:
        patience_s: with an owner that does not answer; a busy one may not for seconds.

    Attributes:
        fetched: messages that came so.
        refused: records in an answer that are not of the stream asked for: an owner speaks for
            its own streams only.
    """

    def __init__(
        self, run: str, bus: Bus, inbox: Inbox[Sample], patience_s: float = RELINK_S
    ) -> None:
        self.fetched = self.refused = 0
        self._run, self._bus, self._inbox, self._patience_s = run, bus, inbox, patience_s
        self._cases: dict[StreamKey, _Case] = {}
        self._owners: dict[str, _Owner] = {}
        self._lock = threading.Lock()
        self._orders: queue.SimpleQueue[tuple[Gap, _Case, _Owner] | None] = queue.SimpleQueue()
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
        busy = {name: owner for name, owner in self._owners.items() if owner.asked}
        names = {key.process for key in first_of}
        self._owners = busy | {name: self._owners.get(name) or _Owner() for name in names}
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
            case.attempts >= ATTEMPTS
            and now_s - max(self._linked_s, case.noticed_s) > self._patience_s
        ):
            return True
        owner = self._owners[key.process]
        if now_s >= _due_s(owner, case) and owner.asked < (1 if owner.silent else AT_ONCE):
            case.asked_s, case.in_flight = now_s, True
            with self._lock:
                owner.asked += 1
            self._orders.put((gap, case, owner))
        return False

    def _work(self) -> None:
        while (order := self._orders.get()) is not None:
            gap, case, owner = order
            case.answered = self._ask(gap, min(_pause_s(owner), MOST_ATTEMPT_S))
            case.attempts += 1
            case.in_flight = False
            owner.silent = 0 if case.answered else owner.silent + 1
            with self._lock:
                owner.asked -= 1

    def _ask(self, gap: Gap, timeout_s: float) -> bool:
        """Whether the owner answered; what it still had is in the inbox by then."""
        key, first, last = gap
        request = BackfillRequest(boot=key.boot, stream=key.stream, first=first, last=last)
        samples = self._bus.query(
            keys.BACKFILL.key(self._run, key.process),
            codec.encode(request),
            codec.encoding_of(BackfillRequest),
            timeout_s,
        )
        taken = [self._take(key, sample) for sample in samples]
        return any(taken)

    def _take(self, asked: StreamKey, answer: Sample) -> bool:
        """Put what an answer holds into the inbox; whether it was an answer at all."""
        try:
            reply = codec.decode(BackfillReply, answer.payload, answer.encoding)
        except WireError:
            return False
        is_of = {key: self._is_of(asked, key) for key in {record.key for record in reply.records}}
        found = [
            Sample(record.key, record.payload, record.encoding)
            for record in reply.records
            if is_of[record.key]
        ]
        self.fetched += len(found)
        self.refused += len(reply.records) - len(found)
        self._inbox.put_all(found, [weigh(sample.key, sample.payload) for sample in found])
        return True

    def _is_of(self, asked: StreamKey, key: str) -> bool:
        """Whether a record's key belongs to the stream that was asked for."""
        try:
            address = keys.parse(key)
        except WireError:
            return False
        if (address.run, keys.stream(address)) != (self._run, asked.stream):
            return False
        if address.topic.role is keys.Role.INPUT and "carrier" in address.ids:
            return address.ids["carrier"] == asked.process
        return asked.process in keys.RESERVED_PROCESSES


def _due_s(owner: _Owner, case: _Case) -> float:
    """When to ask next: at once, then after an attempt's time, of a silent owner ever later."""
    if not case.asked_s and owner.silent < ATTEMPTS:
        return case.noticed_s + OVERTAKING_S
    return max(case.asked_s, case.noticed_s) + _pause_s(owner)


def _pause_s(owner: _Owner) -> float:
    beyond = min(max(owner.silent - ATTEMPTS, 0), MAX_DOUBLINGS)
    return float(ATTEMPT_S * 2.0**beyond)
