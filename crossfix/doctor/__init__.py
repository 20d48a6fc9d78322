"""Examines a machine: is everything here that a run needs, and what to do where it is not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .finding import Finding, Verdict, worst

__all__ = ["Finding", "Verdict", "examine", "worst"]


def examine(connect: str | None, recordings: Path) -> Iterator[Finding]:
    """Every check, one finding after the other, the quick ones first.

    Args:
        connect: the hub that shall serve; None examines one started here.
        recordings: folder that recordings go to.

    Raises:
        BusError: `connect` is no endpoint.
        LaunchError: no hub can be started here.
    """
    from . import installation, machine, rehearsal, wire

    clock = machine.Clocks.read()
    yield from installation.findings()
    yield machine.shared_memory()
    yield machine.open_files()
    yield from machine.disk(recordings)
    yield wire.port()
    with wire.hub(connect) as endpoint:
        reached = wire.round_trip(endpoint)
        yield reached
        if reached.verdict != "bad":
            yield rehearsal.rehearse(endpoint)
    yield machine.resolution()
    yield machine.synchronised()
    yield machine.steps(clock)
