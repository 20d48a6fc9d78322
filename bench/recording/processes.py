"""Processes of a measurement: a hub, a publisher at a pace, the recorder as its user starts it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

Process = subprocess.Popen[str]
DEADLINE_S = 120
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@contextmanager
def started(*command: str, quiet: bool = True) -> Iterator[Process]:
    """A Python process, killed at the end if it still runs."""
    process = subprocess.Popen(  # noqa: S603 - ours
        [sys.executable, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL if quiet else subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def hub() -> Iterator[str]:
    """A hub; its endpoint."""
    with started("-m", "schemas.bus.hub", "--listen", "tcp/127.0.0.1:0") as process:
        assert process.stdout is not None
        yield process.stdout.readline().split()[-1]


@contextmanager
def recorder(endpoint: str, path: Path, *options: str) -> Iterator[Process]:
    """`crossfix record`, from the moment it listens."""
    arguments = ["record", "--run", "bench", "--output", str(path), "--connect", endpoint]
    command = ["-m", "crossfix", *arguments, "--wait", "0", *options]
    with started(*command, quiet=False) as process:
        assert process.stderr is not None
        assert "recording" in process.stderr.readline()
        yield process


def end(process: Process) -> int:
    """Ask a process to end, as Ctrl-C does; its exit code."""
    process.send_signal(signal.SIGINT)
    return process.wait(DEADLINE_S)


def cpu_s(process: Process) -> float:
    """Time that all threads of a process have computed."""
    fields = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rpartition(") ")[2]
    user, system = fields.split()[11:13]
    return (int(user) + int(system)) / TICKS_PER_S


def publisher(endpoint: str, size: int, count: int, hz: float, seed: int) -> Sequence[str]:
    """Command of a publisher that starts at a line on stdin and says when it is done."""
    numbers = (str(size), str(count), str(hz), str(seed))
    return ("-m", "bench.recording.publisher", endpoint, *numbers)


def publish(process: Process) -> None:
    """Let a publisher go, and wait until it is done."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write("go\n")
    process.stdin.flush()
    assert process.stdout.readline().strip() == "done"


def await_ready(process: Process) -> None:
    """Wait until a publisher has made its messages."""
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "ready"
