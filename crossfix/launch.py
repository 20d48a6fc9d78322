"""Starts the processes of a run, watches over them, and ends them together."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import NoReturn

from schemas.bus.entry import THREADS
from schemas.errors import LaunchError

from .children import Nursery, Process, spawn

LEAVE_S = 15.0
"""How long processes may take to leave once the run has ended and the last step is fused."""
FAIL_S = 6.0
"""The same after the world or the fusion centre has failed: the others notice by themselves."""
KILL_S = 5.0
"""Between the request to leave and the kill."""
POLL_S = 0.02
HUB_PAUSE_S = 1.0
"""Between two starts of a hub that dies each time."""
LISTENS = "listening on "
INTERRUPTED = 128 + signal.SIGINT
"""Exit code of a run that Ctrl-C has ended before its recording was finished."""


@dataclass
class Child:
    """One process of the run."""

    name: str
    arguments: Sequence[str]
    vital: bool = False
    """The run ends with it."""
    process: Process = field(init=False)
    ended: bool = False

    def start(self, nursery: Nursery) -> None:
        """Start it: a carrier from the nursery, anything else on its own."""
        module, *rest = self.arguments
        self.process = nursery.start(rest) if module == "carriers" else spawn(self.arguments)

    def send(self, number: signal.Signals) -> None:
        """Signal it, if it still runs."""
        if self.process.poll() is None:
            self.process.send_signal(number)


class Launch:
    """The processes of a run: hub, world, carriers, fusion centre.

    Args:
        say: takes a line for people, and the name of the process it comes from.
    """

    def __init__(self, say: Callable[[str, str], None]) -> None:
        self._say = say
        self._hub: Child | None = None
        self._hub_started_s = 0.0
        self._nursery = Nursery()
        self._children: list[Child] = []
        self._readers: list[threading.Thread] = []
        self._interrupts = 0
        self._asked = False
        self._leave_by_s = float("inf")
        self.exit_code = 0
        self.failed = ""

    def __enter__(self) -> Launch:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill()

    def start_hub(self, listen: str | None = None) -> str:
        """Start a hub of our own and wait until it listens; should it die, it is started again.

        The hub itself takes its port, so two launches at one time never share one.

        Args:
            listen: endpoint, port 0 takes a free one; by default the usual port, or a free one
                where that is taken.

        Returns:
            The endpoint it listens on.

        Raises:
            LaunchError: it cannot listen there.
        """
        where = ["--listen", listen] if listen else []
        hub = Child("hub", ["schemas.bus.hub", *where])
        hub.start(self._nursery)
        assert hub.process.stdout is not None  # noqa: S101 (a pipe was asked for)
        line = hub.process.stdout.readline().rstrip()
        if not line.startswith(LISTENS):
            hub.process.stdout.close()
            hub.process.wait()
            advice = "a hub that starts: `crossfix doctor` tells what is wrong"
            raise LaunchError("the hub did not start", got=line, expected=advice)
        self._say(hub.name, line)
        endpoint = line.removeprefix(LISTENS)
        hub.arguments = ["schemas.bus.hub", "--listen", endpoint]
        self._hub, self._hub_started_s = hub, time.monotonic()
        self._listen_to(hub)
        return endpoint

    def start(self, children: Sequence[Child]) -> None:
        """Start processes, which wait for their hub by themselves; more may follow later."""
        self._children += children
        for child in children:
            self._start(child)

    def watch(self, turn: Callable[[], None]) -> int:
        """Wait until the run is over, calling `turn` often; the first failed process's code."""
        while any(not child.ended for child in self._children):
            turn()
            self._poll()
            if time.monotonic() > self._leave_by_s:
                self._end_stragglers()
            time.sleep(POLL_S)
        self._stop_hub()
        self._join_readers()
        return self.exit_code

    def has_fused(self) -> None:
        """Another step is fused: who is at work is not hurried, unless the run has failed."""
        if self._leave_by_s < float("inf") and not (self._asked or self.exit_code):
            self._leave_by_s = time.monotonic() + LEAVE_S

    def interrupt(self, *, begun: bool = True) -> None:
        """First call: ask the world for a clean end; second: kill everything.

        Args:
            begun: there has been a step; before that there is nothing to finish, and all end.
        """
        self._interrupts += 1
        if self._interrupts > 1:
            self.exit_code = self.exit_code or INTERRUPTED
            self.kill()
            return
        if not begun:
            self._call_off()
            return
        self._say("launch", "ending: the recording is finished first (Ctrl-C again kills)")
        for child in self._children:
            if child.vital:
                child.send(signal.SIGTERM)
                break
        self._leave_by_s = min(self._leave_by_s, time.monotonic() + LEAVE_S)

    def _call_off(self) -> None:
        self._say("launch", "ending before the first step")
        self.exit_code, self._asked = INTERRUPTED, True
        for child in self._children:
            child.send(signal.SIGTERM)
        self._leave_by_s = time.monotonic() + KILL_S

    def kill(self) -> None:
        """End everything at once."""
        for child in self._all():
            if hasattr(child, "process"):
                child.send(signal.SIGKILL)
                child.process.wait()
        self._join_readers()

    def pid(self, name: str) -> int:
        """Process id of a child."""
        return next(child.process.pid for child in self._all() if child.name == name)

    def _all(self) -> Sequence[Child]:
        return [*self._children, self._hub] if self._hub else self._children

    def _start(self, child: Child) -> None:
        child.start(self._nursery)
        self._listen_to(child)

    def _listen_to(self, child: Child) -> None:
        reader = threading.Thread(target=self._read, args=(child,), daemon=True)
        reader.start()
        self._readers.append(reader)

    def _read(self, child: Child) -> None:
        assert child.process.stdout is not None  # noqa: S101 (a pipe was asked for)
        with child.process.stdout as lines:
            for line in lines:
                self._say(child.name, line.rstrip())

    def _join_readers(self) -> None:
        self._nursery.close()
        for reader in self._readers:
            reader.join(timeout=1)

    def _poll(self) -> None:
        for child in self._children:
            if not child.ended and (code := child.process.poll()) is not None:
                child.ended = True
                self._on_end(child, code)
        if self._hub and self._hub.process.poll() is not None:
            self._restart(self._hub)

    def _restart(self, hub: Child) -> None:
        if time.monotonic() - self._hub_started_s > HUB_PAUSE_S:
            self._say("launch", "the hub has died; starting it again")
            self._hub_started_s = time.monotonic()
            self._start(hub)

    def _on_end(self, child: Child, code: int) -> None:
        if code and self.exit_code != INTERRUPTED:
            self._say("launch", f"{child.name} ended with {_meaning(code)}")
            if not self.exit_code:
                self.exit_code, self.failed = exit_code(code), child.name
        if child.vital:
            patience_s = FAIL_S if code else LEAVE_S
            self._leave_by_s = min(self._leave_by_s, time.monotonic() + patience_s)

    def _end_stragglers(self) -> None:
        number = signal.SIGKILL if self._asked else signal.SIGTERM
        self._asked = True
        self._leave_by_s = time.monotonic() + KILL_S
        for child in self._children:
            if not child.ended:
                word = "killed" if number is signal.SIGKILL else "asked to"
                self._say("launch", f"{child.name} did not leave; {word}")
                child.send(number)

    def _stop_hub(self) -> None:
        if self._hub is None:
            return
        self._hub.send(signal.SIGTERM)
        try:
            self._hub.process.wait(timeout=2)
        except subprocess.TimeoutExpired:
            self._hub.send(signal.SIGKILL)
            self._hub.process.wait()


def become(module: str, arguments: Sequence[str]) -> NoReturn:
    """Go on as `python -m module`: the same process, its output and signals untouched."""
    environment = os.environ | dict.fromkeys(THREADS, "1")
    sys.stdout.flush()
    os.execve(  # noqa: S606 (our own modules)
        sys.executable, [sys.executable, "-m", module, *arguments], environment
    )


def exit_code(code: int) -> int:
    """The exit code a shell would show: 128 + signal for a killed process."""
    return 128 - code if code < 0 else code


def _meaning(code: int) -> str:
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
