"""A run as real processes over real Zenoh, for tests that kill and watch them."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import msgspec

from crossfix.commands.run import RunOptions
from crossfix.launch import Launch, free_endpoint
from crossfix.running import processes
from schemas import codec, keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.zenoh_bus import open_bus
from schemas.messages import Health, Step
from sim_world.scenario import load_scenario

DEADLINE_S = 60.0
T = TypeVar("T", bound=msgspec.Struct)


class LiveRun:
    """Launches a scenario; `with` ends whatever still runs."""

    def __init__(self, scenario: Path, output: Path, options: RunOptions | None = None) -> None:
        self.output = output
        self.lines: list[str] = []
        self.declared = load_scenario(scenario).declared
        self.run = self.declared.name
        self.endpoint = free_endpoint(port=0)
        self.launch = Launch(self.endpoint, lambda name, line: self.lines.append(f"{name} {line}"))
        options = options or RunOptions()
        self._children = processes(
            scenario, self.declared, self.run, output, self.endpoint, options
        )
        self._inbox: Inbox[Sample] = Inbox()
        self._heard: deque[Sample] = deque()
        self._watching: threading.Thread | None = None
        self.code: int | None = None

    def __enter__(self) -> LiveRun:
        self.launch.start(self._children)
        self._bus = open_bus(self.endpoint, 20.0)
        for topic in (keys.STEP, keys.HEALTH, keys.CLOSED_WORLD):
            self._bus.subscribe(topic.every(self.run), self._inbox)
        self._watching = threading.Thread(target=self._watch, daemon=True)
        self._watching.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bus.close()
        self.launch.kill()

    def await_message(self, kind: type[T], wanted: Callable[[T], bool]) -> T:
        """The next message of a kind that is as wanted."""
        deadline_s = time.monotonic() + DEADLINE_S
        while time.monotonic() < deadline_s:
            self._heard.extend(self._inbox.take(0.0 if self._heard else 0.05))
            while self._heard:
                sample = self._heard.popleft()
                if keys.parse(sample.key).topic.message is kind:
                    message = codec.decode(kind, sample.payload)
                    if wanted(message):
                        return message
        raise AssertionError(f"no such {kind.__name__}; {self.lines[-20:]}")

    def await_step(self, number: int) -> None:
        """Return when the world has granted a step."""
        self.await_message(Step, lambda step: step.step >= number)

    def await_news(self, words: str) -> Health:
        """The health message that says these words."""
        return self.await_message(Health, lambda h: any(words in line for line in h.news))

    def slow_down(self, name: str, delay_s: float) -> None:
        """Have a process waste time in every step; before the start."""
        child = next(child for child in self._children if child.name == name)
        child.arguments = [*child.arguments, "--delay", str(delay_s)]

    def peak_mb(self) -> dict[str, float]:
        """Most memory that each process has had resident so far."""
        names = ["hub", *(child.name for child in self._children)]
        return {name: _peak_mb(self.launch.pid(name)) for name in names}

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to one process."""
        os.kill(self.launch.pid(name), number)

    def await_end(self) -> int:
        """Exit code of the run."""
        assert self._watching is not None
        self._watching.join(DEADLINE_S)
        assert self.code is not None, f"the run did not end; {self.lines[-20:]}"
        return self.code

    def _watch(self) -> None:
        self.code = self.launch.watch(lambda: None)


def _peak_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text()
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(peak.split()[1]) / 1024
