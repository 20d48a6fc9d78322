"""Carries out a bridge: finds the run, joins it, and takes the feed there; or only shows it."""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from typing import NamedTuple, TextIO

import msgspec

from schemas import codec, keys
from schemas.bus.entry import on_signal
from schemas.bus.latched import fetch
from schemas.bus.member import Buses, Member
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import BusError, LaunchError
from schemas.messages import DeclaredScenario, ProcessState

from .bridge import Bridge, Station
from .feeds import Feed
from .listening import Listener, topic_of
from .node import BridgeNode, Complaints, MemberOutlet
from .records import Decoder
from .run_clock import RunClock

log = logging.getLogger("bridge")

PUMP_S = 0.1
STATUS_S = 1.0
HUB_S = 3.0
NO_RUN_S = 1e9
"""Without a run no stamp is late or early."""


class Place(NamedTuple):
    """Where a bridge takes part."""

    run: str
    carrier: str
    connect: str
    start_timeout_s: float


def publish_feed(place: Place, station: Station, decode: Decoder, feed: Feed) -> int:
    """Publish a feed until it or the run ends; the exit code.

    Raises:
        BusError: no hub, or no run of that name in time.
        LaunchError: a process of that name takes part already.
    """
    control = open_bus(place.connect, place.start_timeout_s)
    data = open_bus(place.connect, place.start_timeout_s)
    with control, data, Member(place.run, place.carrier, Buses(control, data)) as member:
        sample = fetch(data, keys.SCENARIO, place.run, timeout_s=place.start_timeout_s)
        scenario = codec.decode(DeclaredScenario, sample.payload, sample.encoding)
        _refuse_if_alive(member)
        clock = RunClock(scenario.epoch_ns)
        bounded = station._replace(max_clock_error_s=scenario.max_clock_error_s)
        bridge = Bridge(place.carrier, MemberOutlet(member), bounded, clock.now_ns)
        node = BridgeNode(member, feed, decode, bridge, clock)
        on_signal(node.stop)
        log.info("%s takes part in %s", place.carrier, place.run)
        reason = node.run()
        log.info("%s: %s", reason, bridge.counts)
    return 0


def show_feed(carrier: str, run: str, station: Station, decode: Decoder, feed: Feed) -> int:
    """Print what would be published, to the end of the feed; 1 if a record was refused."""
    timeless = station._replace(max_clock_error_s=NO_RUN_S)
    bridge = Bridge(carrier, Printer(run), timeless, RunClock(None).now_ns)
    complaints = Complaints()
    stopped: list[bool] = []
    on_signal(lambda: stopped.append(True))
    while not feed.ended and not stopped:
        for arrival in feed.take(PUMP_S):
            for found in decode(arrival):
                if (error := bridge.take(found)) is not None:
                    complaints.tell(error, time.monotonic())
    log.info("the feed has ended: %s", bridge.counts)
    return int(bridge.counts.rejected > 0)


def print_run(connect: str, run: str, topics: Iterable[str], count: int | None) -> int:
    """Print messages of a run as JSON lines, until it ends or `count` have been printed.

    Raises:
        CrossfixError: no such topic, or no hub.
    """
    wanted = [topic_of(name) for name in topics]
    stopped: list[bool] = []
    with open_bus(connect, HUB_S) as bus:
        listener = Listener(bus, run, wanted)
        on_signal(lambda: stopped.append(True))
        log.info("listening to %s", run)
        lines = chain.from_iterable(_batches(listener, stopped))
        try:
            for line in islice(lines, count):
                sys.stdout.buffer.write(line + b"\n")
                sys.stdout.buffer.flush()
        except BrokenPipeError:  # whoever read it has had enough; nothing is left to flush
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if listener.refused or listener.drops:
        log.warning("%d messages were none, %d too many", listener.refused, listener.drops)
    return 0


def _batches(listener: Listener, stopped: list[bool]) -> Iterator[Iterator[bytes]]:
    """What has come, again and again, until the run is over or somebody has stopped it."""
    over = False
    while not over and not stopped:
        over = listener.is_over(time.monotonic())
        yield listener.lines()


def status(connect: str, run: str, carrier: str) -> ProcessState:
    """What a bridge has counted so far.

    Raises:
        BusError: there is none of that name.
    """
    with open_bus(connect, HUB_S) as bus:
        for sample in bus.query(keys.STATE.key(run, carrier), b"", "", STATUS_S):
            return codec.decode(ProcessState, sample.payload, sample.encoding)
    raise BusError(f"no bridge {carrier} in run {run}", expected="one started with --as carrier=")


class Printer:
    """What a bridge would publish, a line of JSON each, as `crossfix peek --json` has them."""

    boot = "dry-run"

    def __init__(self, run: str, out: TextIO | None = None) -> None:
        self._run, self._out = run, out or sys.stdout  # as it is now, not at the import

    def send(self, topic: keys.Topic, ids: Iterable[str], message: msgspec.Struct) -> None:
        """Print one message."""
        line = {
            "key": topic.key(self._run, *ids),
            "encoding": codec.encoding_of(type(message)),
            "message": msgspec.to_builtins(message),
        }
        self._out.write(json.dumps(line) + "\n")


def _refuse_if_alive(member: Member) -> None:
    expression = f"{keys.alive(member.run, member.process, 'x').removesuffix('x')}*"
    if member.buses.control.tokens(expression):
        raise LaunchError(
            f"{member.process} takes part in {member.run} already",
            expected="another name (--as carrier=NAME), or the end of that process",
        )
