"""Calls that happen later, for the bus in memory."""

from __future__ import annotations

import heapq
import threading
import time
from collections.abc import Callable
from itertools import count
from typing import NamedTuple


class _Call(NamedTuple):
    due_s: float
    number: int  # keeps the order of calls that are due together
    action: Callable[[], None]


class Delayed:
    """Calls things when their time has come, in one thread that starts with the first of them."""

    def __init__(self) -> None:
        self._calls: list[_Call] = []
        self._numbers = count()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False
        self._calling = False

    def __len__(self) -> int:
        """Calls still to come, or not yet over."""
        with self._changed:
            return len(self._calls) + self._calling

    def call(self, delay_s: float, action: Callable[[], None]) -> None:
        """Call `action` after `delay_s`, unless closed by then."""
        with self._changed:
            due_s = time.monotonic() + delay_s
            heapq.heappush(self._calls, _Call(due_s, next(self._numbers), action))
            self._changed.notify()
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._run, name="delayed", daemon=True)
                self._thread.start()

    def close(self) -> None:
        """Forget what was still to come."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while (call := self._next()) is not None:
            call.action()

    def _next(self) -> _Call | None:
        with self._changed:
            self._calling = False
            while not self._closed:
                wait_s = self._calls[0].due_s - time.monotonic() if self._calls else None
                if wait_s is not None and wait_s <= 0:
                    self._calling = True
                    return heapq.heappop(self._calls)
                self._changed.wait(wait_s)
            return None
