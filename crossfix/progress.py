"""What people see while a run goes on: a bar, who is there, and what happened."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from schemas import codec, keys
from schemas.bus.interface import Bus, Inbox, Sample
from schemas.errors import WireError
from schemas.messages import Health, Step

COLOURS = ("cyan", "green", "yellow", "magenta", "blue", "bright_cyan", "bright_green")
LINE_EVERY = 10
"""Without a terminal a line is printed every so many per cent."""


class Watcher:
    """Follows a run over a session of its own and shows it; slow or closed, it holds up nothing."""

    def __init__(self, run: str, steps: int, console: Console) -> None:
        self.steps_seen = self.steps_fused = 0
        self._run, self._steps, self._console = run, steps, console
        self._inbox: Inbox[Sample] = Inbox(4 * 1024 * 1024)
        self._started_s = time.monotonic()
        self._printed = 0
        self._health: Health | None = None
        self._bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=32),
            TextColumn("{task.completed:.0f}/{task.total:.0f} steps"),
            TextColumn("{task.fields[note]}"),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._task: TaskID = self._bar.add_task(run, total=steps, note="starting")

    def __enter__(self) -> Watcher:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def follow(self, bus: Bus) -> None:
        """Begin to listen."""
        bus.subscribe(keys.STEP.key(self._run), self._inbox)
        bus.subscribe(keys.HEALTH.every(self._run), self._inbox)

    def say(self, name: str, line: str) -> None:
        """A line of one process, with its name before it."""
        colour = COLOURS[sum(name.encode()) % len(COLOURS)]
        self._console.print(Text.assemble((f"{name:>8} ", colour), line), soft_wrap=True)

    def turn(self) -> None:
        """Take in what came and show it."""
        for sample in self._inbox.take():
            try:
                message = codec.decode(
                    keys.parse(sample.key).topic.message, sample.payload, sample.encoding
                )
            except WireError:
                continue
            if isinstance(message, Step):
                self.steps_seen = max(self.steps_seen, message.step)
            elif isinstance(message, Health):
                self._on_health(message)
        self._show()

    def _on_health(self, health: Health) -> None:
        self._health = health
        self.steps_fused = health.step
        for sentence in health.news:
            self.say("health", sentence)

    def _show(self) -> None:
        step = self.steps_seen
        note = ""
        if self._health:
            lost = f", lost: {', '.join(self._health.lost)}" if self._health.lost else ""
            note = f"{len(self._health.alive)} carriers{lost}"
        self._bar.update(self._task, completed=step, note=note or "starting")
        percent = 100 * step // max(1, self._steps)
        if not self._console.is_terminal and percent // LINE_EVERY > self._printed:
            self._printed = percent // LINE_EVERY
            passed_s = time.monotonic() - self._started_s
            self.say("run", f"step {step} of {self._steps} after {passed_s:.1f} s; {note}")


def new_console() -> Console:
    """A console on stderr: stdout is for results."""
    return Console(file=sys.stderr)
