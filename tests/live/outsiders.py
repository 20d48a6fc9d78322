"""Sensors outside of a run, for live tests: what they see goes over real sockets."""

from __future__ import annotations

import json
import random
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import degrees

import msgpack

from examples import external_publisher as example
from schemas import keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.zenoh_bus import open_bus
from tests.live.live_run import LiveRun

DEADLINE_S = 60


@contextmanager
def started(*command: str) -> Iterator[subprocess.Popen[str]]:
    """A program as its user starts it, killed at the end if it still runs."""
    with subprocess.Popen(
        [sys.executable, *command], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def await_line(process: subprocess.Popen[str], words: str) -> str:
    """The first line of a program's output that holds these words."""
    assert process.stdout is not None
    for line in process.stdout:
        if words in line:
            return line
    raise AssertionError(f"it never said {words!r}")


def bridge_options(run: LiveRun) -> list[str]:
    """Where the bridge stands and what its radar is: those of the example, errors included."""
    origin = run.declared.origin
    there = {"latitude_rad": origin.latitude_rad, "longitude_rad": origin.longitude_rad}
    pose = example.believed_pose(there)
    place = [degrees(pose["latitude_rad"]), degrees(pose["longitude_rad"]), pose["altitude_m"]]
    return [
        *("--run", run.run, "--connect", run.endpoint, "--as", "carrier=visitor,source=radar"),
        *("--position", ",".join(map(str, place))),
        *("--sigma-position", str(example.SIGMA_POSITION_M)),
        *("--sigma-north", str(degrees(example.SIGMA_NORTH_RAD))),
        *("--sigma-bearing", str(degrees(example.RADAR["sigma_bearing_rad"]))),
        *("--sigma-range", str(example.RADAR["sigma_range_m"])),
    ]


@contextmanager
def seen(run: LiveRun, tell: Callable[[bytes], None]) -> Iterator[None]:
    """Tell what the example's radar sees, a line of JSON each step, while the context lasts."""
    inbox: Inbox[Sample] = Inbox()
    over = threading.Event()

    def follow() -> None:
        while not over.is_set():
            for sample in inbox.take(0.05):
                tell(line_of(msgpack.unpackb(sample.payload)))

    with open_bus(run.endpoint, 20.0) as bus:
        bus.subscribe(keys.TRUTH_TARGETS.key(run.run), inbox)
        thread = threading.Thread(target=follow, daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join(DEADLINE_S)


def line_of(truth: dict[str, object]) -> bytes:
    """What the radar sees of the truth, as a line."""
    logs = example.look(truth, random.Random(f"outside {truth['step']}"))
    bearings = [degrees(bearing) for bearing in logs.pop("bearing_rad", [])]
    return json.dumps({"t_ns": truth["t_ns"], "bearing_deg": bearings, **logs}).encode() + b"\n"


class FaultyServer:
    """A receiver that lines can be read from over TCP; it can die in the middle of one."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(DEADLINE_S)
        self.address = "{}:{}".format(*self._server.getsockname())
        self._peer: socket.socket | None = None

    def __enter__(self) -> FaultyServer:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.close()
        if self._peer:
            self._peer.close()

    def tell(self, line: bytes) -> None:
        """Send a line to whoever is connected, and wait for somebody first."""
        if self._peer is None:
            self._peer = self._server.accept()[0]
        self._peer.sendall(line)

    def die_in_the_middle_of(self, line: bytes) -> None:
        """Send half a line and break off."""
        self.tell(line[: len(line) // 2])
        assert self._peer is not None
        self._peer.close()
        self._peer = None
