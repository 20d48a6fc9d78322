"""Onto the wire again: how late, how fast, and whether two replays fuse to the same bytes."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from bench.figures import Figure, at_least, at_most, told
from schemas import keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.zenoh_bus import open_bus
from schemas.qos import DATA
from schemas.recording.reader import digests, open_recording
from tests.bad_input.test_running import PATROL
from tests.live.live_run import LiveRun

from .processes import DEADLINE_S, hub, started
from .samples import ENCODING, RUN, SMALL_BYTES, payloads, stream
from .writing import write


def figures(folder: Path, seed: int, size: float) -> Iterator[Figure]:
    """At the recorded pace, flat out, and into a fusion centre."""
    data = payloads(seed, SMALL_BYTES, 20_000)
    paced, flat = folder / "paced.mcap", folder / "flat_out.mcap"
    write(paced, stream(data, max(1000, round(4000 * size)), hz=200.0))
    count = max(20_000, round(400_000 * size))
    write(flat, stream(data, count))
    with hub() as endpoint:
        found = replayed(paced, endpoint)
        yield at_most("replay at rate 1: late, median", 1000 * found["late_median_s"], 0.2, "ms")
        yield at_most("replay at rate 1: late, 99 %", 1000 * found["late_p99_s"], 5, "ms")
        took_s = min(replayed(flat, endpoint, "--rate", "max")["took_s"] for _ in range(3))
        yield at_least("replay flat out over Zenoh", count / took_s, 100_000, "msg/s")
        yield told("bare puts of the same messages", bare_per_s(endpoint, data, count), "msg/s")
        yield told("of a replay flat out, heard", heard(flat, endpoint) / count)
    equal, outputs = refused_twice(folder)
    yield at_least("two replays into a fusion centre: equal bytes", equal, 1)
    yield told("keys of those outputs", outputs)


def replayed(path: Path, endpoint: str, *options: str) -> dict[str, float]:
    """What `crossfix replay --json` says of itself."""
    command = [sys.executable, "-m", "crossfix", "replay", str(path), "--connect", endpoint]
    done = subprocess.run(  # noqa: S603 - ours
        [*command, "--json", *options],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=True,
        timeout=DEADLINE_S,
    )
    found: dict[str, float] = json.loads(done.stdout)
    return found


def bare_per_s(endpoint: str, data: list[bytes], count: int) -> float:
    """Puts a second of a program that does nothing else."""
    messages = stream(data, count)
    with open_bus(endpoint) as bus:
        started_s = time.perf_counter()
        for message in messages:
            bus.publish(message.key, message.payload, ENCODING, DATA)
        return count / (time.perf_counter() - started_s)


def heard(path: Path, endpoint: str) -> int:
    """How many messages of a replay flat out a single listener gets at once, of those put."""
    inbox: Inbox[Sample] = Inbox(1024**3)
    total, over = 0, threading.Event()

    def count() -> None:
        """Take what comes."""
        nonlocal total
        while not over.is_set():
            total += len(inbox.take(0.05))

    with open_bus(endpoint) as bus:
        bus.subscribe(keys.REPORT.every(RUN), inbox)
        thread = threading.Thread(target=count)
        thread.start()
        replayed(path, endpoint, "--rate", "max")
        time.sleep(0.5)
        over.set()
        thread.join()
    return total + len(inbox.take())


def refused_twice(folder: Path) -> tuple[bool, int]:
    """Whether a run and two replays of it give the same outputs, and of how many keys."""
    path = folder / "patrol.mcap"
    with LiveRun(PATROL, path) as run:
        run.await_end()
    again = [fused_again(path, folder / f"again{rate}.mcap", rate) for rate in ("max", "40")]
    with open_recording(path) as recording:
        first = list(digests(recording).values())
    return all(found == first for found in again), len(first)


def fused_again(path: Path, output: Path, rate: str) -> list[str]:
    """Outputs of a fusion centre that a replay feeds."""
    with hub() as endpoint:
        command = ["fusion", "--run", "again", "--output", str(output), "--connect", endpoint]
        with started("-m", "crossfix", *command) as fusion:
            replayed(path, endpoint, "--run", "again", "--as-world", "--rate", rate)
            fusion.wait(DEADLINE_S)
    with open_recording(output) as recording:
        return list(digests(recording).values())
