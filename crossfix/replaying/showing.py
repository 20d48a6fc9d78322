"""Where a replay stands: a line for people, a clock for programs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from schemas import codec, keys
from schemas.bus.interface import Bus
from schemas.messages import Clock, PlayerStatus

from .player import Player

NS = 10**9
REFRESH_S = 0.1


@contextmanager
def progress_line(player: Player, title: str, console: Console) -> Iterator[None]:
    """A line with bar, scenario time, rate and count while the context lasts; on a terminal."""
    status = player.status()
    progress = Progress(
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=32),
        TextColumn("{task.completed:.1f}/{task.total:.1f} s, {task.fields[note]}"),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
    )
    total_s = (status.end_ns - status.start_ns) / NS
    task = progress.add_task(title, total=total_s, note="")

    def show() -> None:
        """Draw the line anew."""
        now = player.status()
        done_s = (now.t_ns - now.start_ns) / NS
        progress.update(task, completed=done_s, note=note(now))

    with progress, repeating(show, REFRESH_S if console.is_terminal else 0.0):
        yield


@contextmanager
def published_clock(player: Player, bus: Bus, run: str, name: str, hz: float) -> Iterator[None]:
    """Publish the time of the replay while the context lasts; 0 Hz = never."""
    key, encoding = keys.CLOCK.key(run, name), codec.encoding_of(Clock)

    def tell() -> None:
        """Publish the time once."""
        now = player.status()
        clock = Clock(player=name, t_ns=now.t_ns, rate=now.rate, state=now.state)
        bus.publish(key, codec.encode(clock), encoding, keys.CLOCK.qos)

    with repeating(tell, 1.0 / hz if hz else 0.0):
        yield


def note(status: PlayerStatus) -> str:
    """Rate and count, in words."""
    rate = f"x {status.rate:g}" if status.rate else "flat out"
    state = f"{status.state}, " if status.state != "playing" else ""
    return f"{state}{rate}, {status.sent} messages"


@contextmanager
def repeating(action: Callable[[], None], period_s: float) -> Iterator[None]:
    """Do something every so often, in a thread of its own, and once at the end; 0 = never."""
    if not period_s:
        yield
        return
    over = threading.Event()

    def repeat() -> None:
        """The life of the thread."""
        while not over.wait(period_s):
            action()

    thread = threading.Thread(target=repeat, name="repeating", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        action()
