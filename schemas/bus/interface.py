"""What every process needs of a bus, and no more: publish, subscribe, serve, query, be alive."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from typing import Generic, NamedTuple, Protocol, TypeVar

from ..qos import Qos

T = TypeVar("T")


class Sample(NamedTuple):
    """What arrived: the payload is untouched and may hold anything."""

    key: str
    payload: bytes
    encoding: str


class Liveness(NamedTuple):
    """A liveliness token came or went; `link_up` is whether one's own link to the hub stood."""

    key: str
    alive: bool
    link_up: bool


class Inbox(Generic[T]):
    """A queue between a bus callback and a process, bounded in bytes, that counts what it drops.

    Several subscriptions may share one, so that a process waits in one place.

    Args:
        gather_s: what arrives may gather for so long before it is put in. To wake two threads for
            every sample takes more processor time than all that is done with it.
    """

    def __init__(self, max_bytes: int = 64 * 1024 * 1024, gather_s: float = 0.0) -> None:
        self.max_bytes = max_bytes
        self.gather_s = gather_s
        self.drops = 0
        self._bytes = 0
        self._items: list[T] = []
        self._ready = threading.Condition()

    def put(self, item: T, size: int = 0) -> None:
        """Append, or count a drop where the bound would be passed; never waits for the reader."""
        with self._ready:
            if self._bytes + size > self.max_bytes:
                self.drops += 1
                self.on_drop(item)
                return
            self._items.append(item)
            self._bytes += size
            self._ready.notify()

    def put_all(self, items: Sequence[T], sizes: Sequence[int]) -> None:
        """`put` each of them, and wake the reader once."""
        size = sum(sizes)
        with self._ready:
            if self._bytes + size > self.max_bytes:
                for item, its_size in zip(items, sizes, strict=True):
                    self.put(item, its_size)
                return
            self._items += items
            self._bytes += size
            self._ready.notify()

    def take(self, timeout_s: float = 0.0) -> list[T]:
        """Everything that is here; waits up to `timeout_s` for something."""
        with self._ready:
            if not self._items and timeout_s > 0:
                self._ready.wait(timeout_s)
            taken, self._items = self._items, []
            self._bytes = 0
            return taken

    def on_drop(self, item: T) -> None:
        """Is told, under the lock, of every item dropped; to be overridden."""

    def wake(self) -> None:
        """End a waiting `take` early."""
        with self._ready:
            self._ready.notify_all()

    @property
    def bytes(self) -> int:
        """Size of what waits."""
        return self._bytes

    def __len__(self) -> int:
        return len(self._items)


Handler = Callable[[Sample], Iterable[Sample]]
"""Answers a query, the key of which is the expression asked for."""


class Bus(Protocol):
    """One session. Everything declared on it ends with it."""

    def publish(self, key: str, payload: bytes, encoding: str, qos: Qos) -> None:
        """Send a sample to whoever listens now; never blocks and never fails on a lost link."""

    def subscribe(self, key_expression: str, inbox: Inbox[Sample]) -> None:
        """Put every sample that matches into the inbox, from now on."""

    def serve(self, key: str, handler: Handler) -> None:
        """Answer queries for `key`. The handler runs in a thread of the bus."""

    def query(self, key: str, payload: bytes, encoding: str, timeout_s: float) -> list[Sample]:
        """Ask everyone who serves `key`; the replies that came within the time."""

    def announce(self, token: str) -> AbstractContextManager[None]:
        """Hold a liveliness token until the context is left or the process dies."""

    def watch(self, token_expression: str, inbox: Inbox[Liveness]) -> None:
        """Put every token that is there, comes or goes into the inbox."""

    def tokens(self, token_expression: str, timeout_s: float = 1.0) -> list[str]:
        """Tokens that are there now."""

    def link_up(self) -> bool:
        """Whether the link to the hub stands."""

    def close(self) -> None:
        """Leave; never raises."""
