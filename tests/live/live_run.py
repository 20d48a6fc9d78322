"""A run as real processes over real Zenoh, for tests that kill and watch them."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import msgspec

from crossfix.commands.run import RunOptions
from crossfix.launch import Launch
from crossfix.running import processes
from schemas import codec, keys
from schemas.bus.interface import Inbox, Liveness, Sample
from schemas.bus.zenoh_bus import open_bus
from schemas.messages import Health, Step
from sim_world.scenario import load_scenario

DEADLINE_S = 60.0
T = TypeVar("T", bound=msgspec.Struct)


class LiveRun:
    """Launches a scenario; `with` ends whatever still runs.

    Args:
        held: the last carrier starts only with `begin_with`, and the world waits for it.
    """

    def __init__(
        self,
        scenario: Path,
        output: Path,
        options: RunOptions | None = None,
        *,
        held: bool = False,
    ) -> None:
        self.output = output
        self.lines: list[str] = []
        self.declared = load_scenario(scenario).declared
        self.run = self.declared.name
        self.launch = Launch(lambda name, line: self.lines.append(f"{name} {line}"))
        self.endpoint = self.launch.start_hub("tcp/127.0.0.1:0")
        options = options or RunOptions()
        self._children = processes(
            scenario, self.declared, self.run, output, self.endpoint, options
        )
        self._held = self._children[-1:] if held else []
        self._inbox: Inbox[Sample] = Inbox()
        self._heard: dict[type, deque[Sample]] = defaultdict(deque)
        self._watching = threading.Thread(target=self._watch, daemon=True)
        self.code: int | None = None

    def __enter__(self) -> LiveRun:
        self.launch.start(self._children[: len(self._children) - len(self._held)])
        self._bus = open_bus(self.endpoint, DEADLINE_S)
        for topic in (keys.STEP, keys.HEALTH, keys.CLOSED_WORLD):
            self._bus.subscribe(topic.every(self.run), self._inbox)
        if not self._held:
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

    def begin_with(self, *guests: str) -> None:
        """Let a run that was held begin, once carriers of others are here."""
        here: Inbox[Liveness] = Inbox()
        self._bus.watch(keys.every_alive(self.run), here)
        missing, deadline_s = set(guests), time.monotonic() + DEADLINE_S
        while missing:
            assert time.monotonic() < deadline_s, f"never came: {missing}; {self.lines[-20:]}"
            missing -= {keys.parse_alive(token.key)[1] for token in here.take(0.05)}
        self.launch.start(self._held)
        self._watching.start()

    def await_message(self, kind: type[T], wanted: Callable[[T], bool]) -> T:
        """The next message of a kind that is as wanted; those of other kinds are kept."""
        deadline_s = time.monotonic() + DEADLINE_S
        while time.monotonic() < deadline_s:
            while self._heard[kind]:
                message = codec.decode(kind, self._heard[kind].popleft().payload)
                if wanted(message):
                    return message
            for sample in self._inbox.take(0.05):
                self._heard[keys.parse(sample.key).topic.message].append(sample)
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
        self._watching.join(DEADLINE_S)
        assert self.code is not None, f"the run did not end; {self.lines[-20:]}"
        return self.code

    def _watch(self) -> None:
        self.code = self.launch.watch(lambda: None)


def _peak_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text()
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(peak.split()[1]) / 1024
