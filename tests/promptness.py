"""Laws of promptness on a busy machine: it holds up any one attempt, a wait in the code all."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

prompt = pytest.mark.flaky(reruns=4, only_rerun=["LateError"])
"""A test that is carried out anew, up to five times, when it was late; for nothing else."""


class LateError(AssertionError):
    """Something took longer than it may."""


@contextmanager
def within(limit_s: float) -> Iterator[None]:
    """What must be done in so many seconds.

    Raises:
        LateError: it took longer.
    """
    begun_s = time.monotonic()
    yield
    took_s = time.monotonic() - begun_s
    if took_s >= limit_s:
        raise LateError(f"{took_s:.2f} s, not within {limit_s:g} s")
