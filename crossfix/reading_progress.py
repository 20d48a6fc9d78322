"""Shows how far a recording has been read, by its own time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from crossfix.progress import new_console
from schemas.recording.reader import Recording

EVERY = 256
Show = Callable[[int, int], None]
"""Is told how many messages have been read, and the log time [ns] of the last."""


def unseen(count: int, t_ns: int) -> None:
    """A `Show` for when nobody looks."""


@contextmanager
def reading(recording: Recording, doing: str) -> Iterator[Show]:
    """A bar on stderr with scenario time, count and multiple of real time; only on a terminal."""
    spans = recording.index.spans
    start_ns = min((span.start_ns for span in spans), default=0)
    total_s = (max((span.end_ns for span in spans), default=0) - start_ns) * 1e-9
    started_s = time.monotonic()
    console = new_console()
    with Progress(
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=32),
        TextColumn("{task.completed:.0f}/{task.total:.0f} s, {task.fields[note]}"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task(doing, total=total_s, note="starting")

        def show(count: int, t_ns: int) -> None:
            if count % EVERY == 0:
                done_s = (t_ns - start_ns) * 1e-9
                rate = done_s / max(1e-9, time.monotonic() - started_s)
                progress.update(task, completed=done_s, note=f"{count} messages, {rate:.0f} x")

        yield show
