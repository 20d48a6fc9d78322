"""Ends a hub with the run it serves: when everyone who was alive in it has left."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable

from schemas import keys
from schemas.bus.hub import tell
from schemas.bus.interface import Bus, Inbox, Liveness
from schemas.bus.roster import Roster
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import LaunchError

HUB_S = 5.0
TURN_S = 0.1
LEAVE_S = 10.0
"""Carriers leave after the world, and strangers perhaps never."""


class EndOfRun:
    """Follows a run on the hub of this process, and sends the process SIGTERM at its end.

    Attributes:
        error: why the run could not be followed to its end; None if it was.
    """

    def __init__(self, run: str, start_timeout_s: float) -> None:
        self.error: BaseException | None = None
        self._run, self._start_timeout_s = keys.require_id(run), start_timeout_s

    def follow(self, endpoint: str) -> None:
        """Begin, in a thread, and tell where the hub listens; `ready` of `run_hub`."""
        threading.Thread(target=self._follow, args=(endpoint,), daemon=True).start()

    def _follow(self, endpoint: str) -> None:
        try:
            with open_bus(dialled(endpoint), HUB_S) as bus:
                here = attendance(bus, self._run)
                tell(endpoint)  # nobody comes and goes unseen
                await_end(here, self._run, self._start_timeout_s)
        except BaseException as error:  # of the main thread, which is waiting for a signal
            self.error = error
        os.kill(os.getpid(), signal.SIGTERM)


def attendance(bus: Bus, run: str) -> Callable[[], set[str]]:
    """A function that says who is alive in a run, and takes a moment to look."""
    tokens: Inbox[Liveness] = Inbox()
    roster = Roster()
    bus.watch(keys.every_alive(run), tokens)

    def here() -> set[str]:
        roster.update(tokens.take(TURN_S), bus.link_up(), time.monotonic())
        return {life.process for life in roster.present}

    return here


def await_end(
    here: Callable[[], set[str]], run: str, start_timeout_s: float, leave_s: float = LEAVE_S
) -> None:
    """Wait until the world has come, until it and the fusion centre have gone, and for the rest.

    Raises:
        LaunchError: the world did not come in time.
    """
    if not _wait(lambda: keys.WORLD in here(), start_timeout_s):
        raise LaunchError(
            f"no world came in {start_timeout_s:g} s",
            where=f"run {run}",
            expected="`crossfix world` on this hub, or a longer --start-timeout",
        )
    _wait(lambda: here().isdisjoint(keys.RESERVED_PROCESSES), float("inf"))
    _wait(lambda: not here(), leave_s)


def dialled(endpoint: str) -> str:
    """Where a process of this machine reaches a hub that listens on `endpoint`."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")


def _wait(done: Callable[[], bool], timeout_s: float) -> bool:
    deadline_s = time.monotonic() + timeout_s
    while not done():
        if time.monotonic() > deadline_s:
            return False
    return True
