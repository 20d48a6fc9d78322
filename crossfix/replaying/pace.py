"""When each message of a replay is due, and how late it went."""

from __future__ import annotations

from typing import NamedTuple

MAX = 0.0
"""The rate of a replay that never waits."""
KEPT = 200_000
"""Latenesses that are kept for the percentiles."""


class Lateness(NamedTuple):
    """How far messages were behind their time [s], over the first `KEPT` of them."""

    median_s: float
    p99_s: float
    most_s: float


class Pace:
    """Maps log time to a monotonic clock; time is passed in.

    Args:
        rate: seconds of log time in one second, `MAX` = all are due at once.
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._began: tuple[int, float] | None = None
        self._late_s: list[float] = []
        self._most_s = 0.0

    def restart(self) -> None:
        """Count from the next message: after a pause, a seek, another rate."""
        self._began = None

    def due_s(self, t_ns: int, now_s: float) -> float:
        """When a message of log time `t_ns` is to go."""
        if self.rate == MAX:
            return now_s
        if self._began is None:
            self._began = (t_ns, now_s)
        first_ns, began_s = self._began
        return began_s + (t_ns - first_ns) * 1e-9 / self.rate

    def went(self, late_s: float) -> None:
        """Note how late a message went."""
        self._most_s = max(self._most_s, late_s)
        if len(self._late_s) < KEPT:
            self._late_s.append(late_s)

    def lateness(self) -> Lateness:
        """So far; zeros where nothing was waited for."""
        ordered = sorted(self._late_s) or [0.0]
        return Lateness(ordered[len(ordered) // 2], ordered[len(ordered) * 99 // 100], self._most_s)
