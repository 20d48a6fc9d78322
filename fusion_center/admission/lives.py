"""Who takes part, by tokens, and what is kept of those who show none: a bounded amount.

Anybody can publish under any name. A life (one boot of one process) takes part once it has shown
its liveliness token; until then it is a stranger, held back, counted, and forgotten when newer
strangers need the room.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Container, Iterable
from typing import Protocol

from schemas import keys
from schemas.bus.ledger import StreamKey
from schemas.bus.roster import Life

MAX_LIVES = 512
MAX_PROCESSES = 1024
"""Names that have ever taken part in a run."""
MAX_STRANGERS = 64
MAX_STREAMS = 512
"""Of one life."""


class Known(Protocol):
    """Lives that take part."""

    def __contains__(self, life: object, /) -> bool:
        """Whether this one does."""

    def has(self, process: str) -> bool:
        """Whether any life of a process ever did."""


class Everyone:
    """For a caller that chooses its messages itself: nobody is a stranger."""

    def __contains__(self, life: object) -> bool:
        return True

    def has(self, process: str) -> bool:
        """True."""
        del process
        return True


class Lives:
    """Lives that have shown their token in this run, even if it is gone since; for all threads.

    Args:
        declared: processes there is always room for.
    """

    def __init__(self, declared: Iterable[str] = ()) -> None:
        self._declared = {*declared, *keys.RESERVED_PROCESSES}
        self._lives: OrderedDict[Life, None] = OrderedDict()
        self._processes: set[str] = set()
        self._world = ""
        self._lock = threading.Lock()

    def __contains__(self, life: object) -> bool:
        return life in self._lives

    def has(self, process: str) -> bool:
        """Whether any life of a process has ever shown a token."""
        return process in self._processes

    def is_world(self, boot: str) -> bool:
        """Whether a boot may be this run's world: the first that showed a token is the only one."""
        return not self._world or boot == self._world

    def show(self, present: Container[Life], news: Iterable[Life]) -> list[Life]:
        """Take in lives that have come; those there is no room for, which stay strangers.

        Args:
            present: whose token is there now; of the others the oldest makes room.
        """
        with self._lock:
            return [life for life in sorted(news) if not self._take(life, present)]

    def _take(self, life: Life, present: Container[Life]) -> bool:
        is_new = life.process not in self._processes
        has_room = len(self._lives) < MAX_LIVES or self._make_room(present)
        has_room &= not (is_new and len(self._processes) >= MAX_PROCESSES)
        if not (has_room or life.process in self._declared):
            return False
        if life.process == keys.WORLD and not self._world:
            self._world = life.boot
        self._processes.add(life.process)
        self._lives[life] = None
        return True

    def _make_room(self, present: Container[Life]) -> bool:
        gone = next((old for old in self._lives if old not in present), None)
        if gone is not None:
            del self._lives[gone]
        return gone is not None


class Door:
    """Says of which streams one receiver keeps account, so that their number is bounded.

    Args:
        known: lives that take part; every one may have `MAX_STREAMS` streams.
        forget: is told of each stream that had to make room.
    """

    def __init__(self, known: Known, forget: Callable[[StreamKey], None]) -> None:
        self._known, self._forget = known, forget
        self._members: dict[Life, set[str]] = {}
        self._strangers: OrderedDict[Life, set[str]] = OrderedDict()

    def admit(self, key: StreamKey) -> str:
        """Why a stream cannot be heard; empty if it can."""
        life = Life(key.process, key.boot)
        streams = self._members.get(life)
        if streams is None:
            streams = self._newcomer(life)
        if key.stream not in streams:
            if len(streams) >= MAX_STREAMS:
                return f"more than {MAX_STREAMS} streams of one boot"
            streams.add(key.stream)
        return ""

    def _newcomer(self, life: Life) -> set[str]:
        """The streams of a life that is not known as a member yet; it may be one by now."""
        streams = self._strangers.get(life)
        if life in self._known:
            self._strangers.pop(life, None)
            self._members[life] = streams or set()
            self._clear_members()
            return self._members[life]
        if streams is None:
            streams = self._strangers[life] = set()
            if len(self._strangers) > MAX_STRANGERS:
                self._drop(*self._strangers.popitem(last=False))
        return streams

    def _clear_members(self) -> None:
        if len(self._members) > 2 * MAX_LIVES:
            for life in [life for life in self._members if life not in self._known]:
                self._drop(life, self._members.pop(life))

    def _drop(self, life: Life, streams: Iterable[str]) -> None:
        for stream in streams:
            self._forget(StreamKey(*life, stream))


def twins(present: Iterable[Life]) -> dict[str, list[str]]:
    """Processes of which more than one life is here: their boots, by name."""
    boots: dict[str, list[str]] = {}
    for process, boot in sorted(present):
        boots.setdefault(process, []).append(boot)
    return {name: found for name, found in boots.items() if len(found) > 1}
