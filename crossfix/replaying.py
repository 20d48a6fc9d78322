"""Publishes what was recorded, at a pace, and shows how far it is."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from schemas import keys
from schemas.bus.interface import Bus
from schemas.errors import BusError, WireError
from schemas.recording.reader import Recorded, Recording

SHOW_EVERY = 100
Show = Callable[[int, int], None]
"""Is told how many messages went out, and the log time [ns] of the last."""


class Sent(NamedTuple):
    """What a replay did; `latest_s` is how far the most belated message was behind its time."""

    messages: int
    took_s: float
    latest_s: float


class Pace:
    """When each log time is due, counted from the first one that is waited for.

    Args:
        rate: seconds of log time in one second of wall time; None never waits.
    """

    def __init__(self, rate: float | None) -> None:
        self._rate = rate
        self._started_s = 0.0
        self._first_ns: int | None = None

    def wait(self, t_ns: int) -> float:
        """Sleep until `t_ns` is due; how late it is already [s]."""
        if self._rate is None:
            return 0.0
        now_s = time.monotonic()
        if self._first_ns is None:
            self._started_s, self._first_ns = now_s, t_ns
        due_s = self._started_s + (t_ns - self._first_ns) * 1e-9 / self._rate
        if due_s > now_s:
            time.sleep(due_s - now_s)
        return max(0.0, time.monotonic() - due_s)


def publish(messages: Iterable[Recorded], run: str, bus: Bus, pace: Pace, show: Show) -> Sent:
    """Publish messages in their order, under the name of a run."""
    started_s = time.monotonic()
    latest_s, sent = 0.0, 0
    for message in messages:
        latest_s = max(latest_s, pace.wait(message.log_time_ns))
        topic, ids = message.address.topic, message.address.ids
        bus.publish(topic.key(run, *ids.values()), message.payload, message.encoding, topic.qos)
        sent += 1
        show(sent, message.log_time_ns)
    return Sent(sent, time.monotonic() - started_s, latest_s)


def refuse_if_alive(recording: Recording, run: str, bus: Bus) -> None:
    """Do not speak for a process that speaks for itself.

    Raises:
        BusError: one of those recorded is alive in this run; names them.
    """
    alive = {keys.parse_alive(token)[1] for token in bus.tokens(keys.every_alive(run))}
    if speakers := sorted(alive & _carriers(recording)):
        raise BusError(
            f"alive in run {run}: {', '.join(speakers)}", expected="another --run, or their end"
        )


@contextmanager
def showing(recording: Recording, console: Console) -> Iterator[Show]:
    """A line with bar, scenario time and count; only on a terminal."""
    spans = recording.index.spans
    start_ns = min((span.start_ns for span in spans), default=0)
    end_ns = max((span.end_ns for span in spans), default=0)
    with Progress(
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=32),
        TextColumn("{task.completed:.0f}/{task.total:.0f} s, {task.fields[sent]} messages"),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
    ) as progress:
        total_s = (end_ns - start_ns) * 1e-9
        task = progress.add_task(recording.header.run, total=total_s, sent=0)

        def show(sent: int, t_ns: int) -> None:
            if sent % SHOW_EVERY == 0 or t_ns == end_ns:
                progress.update(task, completed=(t_ns - start_ns) * 1e-9, sent=sent)

        yield show


def _carriers(recording: Recording) -> set[str]:
    """Carriers by the channels of the recording."""
    carriers = set[str]()
    for channel in recording.index.channels.values():
        try:
            address = keys.parse(channel.topic)
        except WireError:
            continue
        if address.topic.role is keys.Role.INPUT and "carrier" in address.ids:
            carriers.add(address.ids["carrier"])
    return carriers
