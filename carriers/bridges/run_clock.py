"""What time it is in a run, by the steps its world grants."""

from __future__ import annotations

import time
from collections.abc import Callable

from schemas.messages import Step


class RunClock:
    """Scenario time; between the steps of a paced run it goes on at their rate.

    Args:
        epoch_ns: of the run, the time before its first step; None = there is no run, and the time
            is that of the wall clock.
    """

    def __init__(self, epoch_ns: int | None, wall_ns: Callable[[], int] = time.time_ns) -> None:
        self._epoch_ns, self._wall_ns = epoch_ns, wall_ns
        self._step: Step | None = None
        self._since_ns = 0
        self._rate = 0.0
        self._step_ns = 0

    @property
    def step(self) -> int:
        """The newest step heard of; 0 before the first."""
        return self._step.step if self._step else 0

    def hear(self, step: Step) -> None:
        """The world has spoken; it repeats itself."""
        before, now_ns = self._step, self._wall_ns()
        if before is not None and step.step == before.step and step.boot == before.boot:
            return
        self._rate = 0.0
        if before is not None and step.mode == "paced" and step.step == before.step + 1:
            self._step_ns = step.t_ns - before.t_ns
            self._rate = self._step_ns / max(1, now_ns - self._since_ns)
        self._step, self._since_ns = step, now_ns

    def now_ns(self) -> int:
        """Unix nanoseconds in the run's time."""
        if self._step is None:
            return self._wall_ns() if self._epoch_ns is None else self._epoch_ns
        passed_ns = round((self._wall_ns() - self._since_ns) * self._rate)
        return self._step.t_ns + max(0, min(passed_ns, self._step_ns))
