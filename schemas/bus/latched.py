"""Fetching the last value of a latched topic from its owner."""

from __future__ import annotations

import time

from .. import keys
from ..errors import BusError
from .interface import Bus, Sample

ATTEMPT_S = 0.3
PAUSE_S = 0.02


def fetch(bus: Bus, topic: keys.Topic, run: str, *ids: str, timeout_s: float = 30.0) -> Sample:
    """The last value of a topic, asked for until its owner is there to answer.

    Raises:
        BusError: nobody answered in time.
    """
    key = topic.key(run, *ids)
    deadline_s = time.monotonic() + timeout_s
    while time.monotonic() < deadline_s:
        for sample in bus.query(key, b"", "", ATTEMPT_S):
            return sample
        time.sleep(PAUSE_S)
    raise BusError(
        f"nobody answered for {key} in {timeout_s:g} s",
        expected=f"a world that runs `{run}` on the same hub",
    )
