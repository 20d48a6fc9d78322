"""Child processes of a launch: plain ones, and carriers forked from a nursery."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from io import TextIOWrapper
from typing import IO, Protocol

from schemas.bus.entry import LAUNCHER, THREADS

PACKET_BYTES = 65536
PAUSE_S = 0.005


class Process(Protocol):
    """What is asked of a child, however it was started."""

    @property
    def pid(self) -> int:
        """Process id."""

    @property
    def stdout(self) -> IO[str] | None:
        """What it prints, errors included."""

    def poll(self) -> int | None:
        """Exit code, negative for a signal; None while it runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the exit code."""

    def send_signal(self, number: int) -> None:
        """Signal it."""


def environment() -> Mapping[str, str]:
    """Of every child: one BLAS thread, and whose child it is."""
    ours = {"PYTHONUNBUFFERED": "1", LAUNCHER: str(os.getpid())}
    return os.environ | ours | dict.fromkeys(THREADS, "1")


def spawn(arguments: Sequence[str]) -> Process:
    """`python -m ...` in a session of its own: Ctrl-C reaches the launcher alone."""
    return subprocess.Popen(  # noqa: S603 (our own modules)
        [sys.executable, "-m", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment(),
        start_new_session=True,
    )


class Nursery:
    """The launcher's end of `carriers.nursery`; on systems without its sockets, a plain spawn."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._started: list[int] = []
        self._codes: dict[int, int] = {}
        self._asked = 0

    def start(self, arguments: Sequence[str]) -> Process:
        """Start a carrier with these arguments; returns before it runs."""
        if not sys.platform.startswith("linux"):
            return spawn(["carriers", *arguments])
        requests = self._socket or self._open()
        read, write = os.pipe()
        socket.send_fds(requests, [json.dumps(list(arguments)).encode()], [write])
        os.close(write)
        self._asked += 1
        return _Forked(self, self._asked - 1, os.fdopen(read, encoding="utf-8", errors="replace"))

    def pid(self, number: int) -> int | None:
        """Process id of the n-th carrier, once it is known."""
        self._drain()
        return self._started[number] if number < len(self._started) else None

    def code(self, number: int) -> int | None:
        """Exit code of the n-th carrier; that of a kill if the nursery has died with it."""
        pid = self.pid(number)
        if pid is not None and pid in self._codes:
            return self._codes[pid]
        return -signal.SIGKILL if self._is_dead() else None

    def close(self) -> None:
        """End the nursery; its children are left alone."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._process is not None:
            self._process.wait()

    def _open(self) -> socket.socket:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._process = subprocess.Popen(  # noqa: S603 (our own module)
            [sys.executable, "-m", "carriers.nursery", str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            env=environment(),
            start_new_session=True,
        )
        theirs.close()
        ours.setblocking(False)
        self._socket = ours
        return ours

    def _is_dead(self) -> bool:
        return self._process is not None and self._process.poll() is not None

    def _drain(self) -> None:
        while self._socket is not None:
            try:
                packet = self._socket.recv(PACKET_BYTES)
            except (BlockingIOError, ConnectionResetError):
                return
            if not packet:
                return
            news = json.loads(packet)
            if "started" in news:
                self._started.append(news["started"])
            else:
                self._codes[news["ended"]] = news["code"]


class _Forked:
    """A carrier of the nursery; known by its number until its pid has come."""

    def __init__(self, nursery: Nursery, number: int, output: TextIOWrapper) -> None:
        self._nursery, self._number = nursery, number
        self._ended: int | None = None
        self.stdout: IO[str] | None = output

    @property
    def pid(self) -> int:
        while (pid := self._nursery.pid(self._number)) is None:
            if self.poll() is not None:
                raise ProcessLookupError("never started")
            time.sleep(PAUSE_S)
        return pid

    def poll(self) -> int | None:
        if self._ended is None:
            self._ended = self._nursery.code(self._number)
        return self._ended

    def wait(self, timeout: float | None = None) -> int:
        deadline_s = time.monotonic() + (float("inf") if timeout is None else timeout)
        while (code := self.poll()) is None:
            if time.monotonic() > deadline_s:
                raise subprocess.TimeoutExpired("carriers", timeout or 0.0)
            time.sleep(PAUSE_S)
        return code

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)
