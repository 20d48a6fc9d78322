"""The wire: is the usual port free, and how long does a message through a hub take?"""

from __future__ import annotations

import secrets
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from crossfix.children import spawn
from crossfix.commands import ENDPOINT
from schemas import keys
from schemas.bus.interface import Bus, Inbox, Sample
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import BusError, LaunchError, WireError
from schemas.qos import CONTROL

from .finding import Finding

DEFAULT_PORT = int(ENDPOINT.rpartition(":")[2])
HUB_S = 3.0
LISTENS = "listening on "
PINGS, WARM_UP = 300, 20
ANSWER_S = 2.0
SLOW_MEDIAN_S, SLOW_LATE_S = 5e-3, 50e-3
_LISTENING = "0A"


def port(number: int = DEFAULT_PORT) -> Finding:
    """Whether a hub can listen where everybody looks for it."""
    what = f"port {number}"
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", number))
        except OSError:
            pass
        else:
            return Finding(what, "ok", "free")
    who = listener(number) or "another program"
    try:
        with open_bus(f"tcp/127.0.0.1:{number}", 1.0) as bus:
            return Finding(what, "ok", f"a hub listens ({who}); {alive(bus)}")
    except BusError:
        advice = f"`crossfix run` takes another; by hand pass --listen tcp/127.0.0.1:{number + 1}"
        return Finding(what, "warn", f"taken by {who}, which is no hub", advice)


@contextmanager
def hub(connect: str | None) -> Iterator[str]:
    """The endpoint of the hub to examine: the one that is named, or one of our own.

    Raises:
        LaunchError: our own did not start.
    """
    if connect:
        yield connect
        return
    process = spawn(["schemas.bus.hub", "--listen", "tcp/127.0.0.1:0"])
    assert process.stdout is not None  # noqa: S101 (a pipe was asked for)
    try:
        said = process.stdout.readline().strip()
        if not said.startswith(LISTENS):
            raise LaunchError("the hub did not start", got=said)
        yield said.removeprefix(LISTENS)
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(HUB_S)
        process.stdout.close()


def round_trip(endpoint: str) -> Finding:
    """Messages from one session to another and back, through the hub."""
    what = "round trip"
    try:
        with open_bus(endpoint, HUB_S) as here, open_bus(endpoint, HUB_S) as there:
            times_s = sorted(_pings(here, there))
            who = alive(here)
    except BusError as error:
        if error.got is not None:  # not an endpoint at all
            raise
        advice = f"start one: crossfix hub --listen {endpoint}; or look at what blocks the way"
        return Finding(what, "bad", f"no hub answers at {endpoint}", advice)
    if len(times_s) < PINGS:
        found = f"{PINGS - len(times_s)} of {PINGS} messages through {endpoint} did not come back"
        return Finding(what, "bad", found, "look for what blocks the hub or the network")
    median_s, late_s = times_s[PINGS // 2], times_s[PINGS * 99 // 100]
    found = f"p50 {median_s * 1e3:.2f} ms, p99 {late_s * 1e3:.2f} ms through {endpoint}; {who}"
    if median_s > SLOW_MEDIAN_S or late_s > SLOW_LATE_S:
        advice = "a step in lock-step takes two; end other work here, or look at the network"
        return Finding(what, "warn", found, advice)
    return Finding(what, "ok", found)


def alive(bus: Bus) -> str:
    """The runs on a hub and who takes part, in words."""
    runs: dict[str, set[str]] = {}
    for token in bus.tokens(keys.every_alive("*")):
        with suppress(WireError):
            run, process, _ = keys.parse_alive(token)
            runs.setdefault(run, set()).add(process)
    return "; ".join(f"run {n}: {', '.join(sorted(who))}" for n, who in runs.items()) or "no run"


def listener(number: int) -> str:
    """Process id and command of who listens on a port; empty where that cannot be known."""
    sockets = {f"socket:[{inode}]" for inode in _inodes(number)}
    for entry in Path("/proc").glob("[0-9]*/fd/*") if sockets else ():
        with suppress(OSError):
            if str(entry.readlink()) in sockets:
                command = (entry.parents[1] / "cmdline").read_text().replace("\0", " ")
                return f"pid {entry.parents[1].name}, {command.strip()[:60]}"
    return ""


def _pings(here: Bus, there: Bus) -> Iterator[float]:
    """Seconds of every message that came back."""
    run = f"doctor-{secrets.token_hex(4)}"
    out, back = keys.ACK.key(run, "ping"), keys.ACK.key(run, "pong")
    to_there: Inbox[Sample] = Inbox()
    to_here: Inbox[Sample] = Inbox()
    there.subscribe(out, to_there)
    here.subscribe(back, to_here)
    over = threading.Event()
    echo = threading.Thread(target=_echo, args=(there, to_there, back, over), daemon=True)
    echo.start()
    try:
        for number in range(PINGS + WARM_UP):
            started_s = time.perf_counter()
            here.publish(out, b"", "", CONTROL)
            if not to_here.take(ANSWER_S):
                return
            if number >= WARM_UP:
                yield time.perf_counter() - started_s
    finally:
        over.set()
        echo.join()


def _echo(bus: Bus, inbox: Inbox[Sample], key: str, over: threading.Event) -> None:
    while not over.is_set():
        for _ in inbox.take(0.05):
            bus.publish(key, b"", "", CONTROL)


def _inodes(number: int) -> Iterator[str]:
    """Of the sockets that listen on a TCP port (Linux)."""
    for table in (Path("/proc/net/tcp"), Path("/proc/net/tcp6")):
        with suppress(OSError):
            for line in table.read_text().splitlines()[1:]:
                words = line.split()
                if words[3] == _LISTENING and int(words[1].rpartition(":")[2], 16) == number:
                    yield words[9]
