"""How many lines of JSON a second become messages on the bus.

Run `python -m bench.bridge [--seed N] [--runs N] [--json]`; `--runs` is lines by the thousand. The
lines are bytes as a socket brings them; what is timed ends when Zenoh has taken the messages, on a
real session to a hub in a process of its own. The reference is the least that a program without
us would do: `json.loads`, `msgpack.packb` and a put of each line, unchecked, on the same session.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import msgpack
import numpy as np

from bench.figures import Figure, at_least, at_most, options, report, scaled_seconds, time_ratio
from carriers.bridges.bridge import Bridge, Station
from carriers.bridges.feeds import CHUNK_BYTES, Arrival
from carriers.bridges.jsonl import JsonLines
from carriers.bridges.node import MemberOutlet
from schemas import codec, keys
from schemas.bus.member import Buses, Member
from schemas.bus.zenoh_bus import open_bus
from schemas.messages import Pose, SourceReport
from schemas.qos import DATA

NOW_NS = 1_767_225_600 * 10**9
LOGS = 3
"""In a line, as of a radar that sends what it has every tenth of a turn."""
LEAST_LINES_PER_S = 20_000
MOST_RATIO = 5.0
REPEATS = 5


def main() -> None:
    """Measure, print."""
    given = options(__doc__ or "", runs=20)
    report(figures(given.seed, given.runs), given)


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Lines a second, and the time of a line by that of a program that checks nothing."""
    lines = lines_of(np.random.default_rng(seed), runs * 1000)
    pieces = pieces_of(b"".join(lines))

    with member() as sender:

        def bridged() -> None:
            bridge = Bridge("harbour", MemberOutlet(sender), STATION, lambda: NOW_NS)
            decode = JsonLines("harbour", "radar")
            for piece in pieces:
                for found in decode(piece):
                    bridge.take(found)
            assert bridge.counts.decoded == len(lines), bridge.counts

        def unchecked() -> None:
            for line in lines:
                sender.buses.data.publish(KEY, msgpack.packb(json.loads(line)), ENCODING, DATA)

        per_s = len(lines) / scaled_seconds(bridged, REPEATS)
        ratio = time_ratio(bridged, unchecked, REPEATS)
    yield at_least("lines of JSON to the bus, scaled", per_s, LEAST_LINES_PER_S, "lines/s")
    yield at_most("time of a line / without us and unchecked", ratio, MOST_RATIO)


KEY = keys.REPORT.key("bench", "unchecked", "radar")
ENCODING = codec.encoding_of(SourceReport)
STATION = Station(pose=Pose(latitude_rad=0.6, longitude_rad=-0.1))


def lines_of(rng: np.random.Generator, count: int) -> list[bytes]:
    """Lines as a radar might say them, one report each."""
    bearings, ranges = rng.uniform(0, 360, (count, LOGS)), rng.uniform(500, 30_000, (count, LOGS))
    return [
        json.dumps(
            {
                "t_ns": NOW_NS,
                "bearing_deg": [round(b, 2) for b in bearing],
                "range_m": [round(r, 1) for r in range_m],
                "track_id": [f"{n % 40 + i}" for i in range(LOGS)],
            }
        ).encode()
        + b"\n"
        for n, (bearing, range_m) in enumerate(zip(bearings.tolist(), ranges.tolist(), strict=True))
    ]


def pieces_of(data: bytes) -> Sequence[Arrival]:
    """The same bytes as a connection brings them."""
    starts = range(0, len(data), CHUNK_BYTES)
    return [Arrival(1, data[start : start + CHUNK_BYTES]) for start in starts]


@contextmanager
def member() -> Iterator[Member]:
    """A process of a run on a real hub."""
    command = [sys.executable, "-m", "schemas.bus.hub", "--listen", "tcp/127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as hub:  # noqa: S603
        try:
            assert hub.stdout is not None
            endpoint = hub.stdout.readline().split()[-1]
            with (
                open_bus(endpoint) as control,
                open_bus(endpoint) as data,
                Member("bench", "harbour", Buses(control, data)) as sender,
            ):
                yield sender
        finally:
            hub.kill()


if __name__ == "__main__":
    main()
