"""When a device of a carrier looks: at a period of its own, between the steps of the world."""

from __future__ import annotations

from typing import NamedTuple


class Look(NamedTuple):
    """One look that is due: its number since the start, and when, after the step (<= 0)."""

    number: int
    after_step_ns: int


def looks(step: int, step_ns: int, *, period_s: float, phase_s: float) -> list[Look]:
    """The looks after the step before, up to this one."""
    period, phase = round(period_s * 1e9), round(phase_s * 1e9)
    now = step * step_ns
    first = max((now - step_ns - phase) // period + 1, 0)
    last = (now - phase) // period
    return [Look(n, phase + n * period - now) for n in range(first, last + 1)]
