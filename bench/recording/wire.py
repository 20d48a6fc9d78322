"""From a publisher over the hub into the file: gaps, processor time, and the callback's share."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.figures import Figure, at_most, told
from schemas import keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.limits import weigh
from schemas.bus.zenoh_bus import open_bus
from schemas.recording.reader import open_recording

from .processes import await_ready, cpu_s, end, hub, publish, publisher, recorder, started
from .samples import ENCODING, KEYS, LARGE_BYTES, RUN, SMALL_BYTES, payloads

SETTLE_S = 1.0
STATISTICS_BYTES = 4096
DEADLINE_S = 60.0
LOADS = ((SMALL_BYTES, 40_000.0, "40 k msg/s of 200 B"), (LARGE_BYTES, 25_000.0, "50 MB/s of 2 kB"))


def figures(folder: Path, seed: int, size: float) -> Iterator[Figure]:
    """End to end, at the rates demanded and flat out."""
    seconds = max(1.0, 6 * size)
    for number, (length, hz, name) in enumerate(LOADS):
        path = folder / f"wire{number}.mcap"
        message_s, passed_s = recorded(path, length, round(hz * seconds), hz, seed)
        lost = missing(path, round(hz * seconds))
        yield at_most(f"end to end, {name}: messages missing", lost, 0)
        yield told(f"end to end, {name}: published in", passed_s / seconds, "of its time")
        if length == SMALL_BYTES:
            yield at_most(f"end to end, {name}: of a core", message_s * hz, 0.5)
            bare_s = heard(length, round(hz * seconds), hz, seed)
            yield told("a bare subscriber at that rate: of a core", bare_s * hz)
    path, count = folder / "flat.mcap", round(200_000 * max(size, 0.1))
    _, passed_s = recorded(path, SMALL_BYTES, count, 0.0, seed)
    yield told("flat out, published", count / passed_s, "msg/s")
    yield at_most("flat out: messages missing after recovery", missing(path, count), 0)
    yield at_most("hand-over in the callback, 99 %", 1e6 * hand_over_s(seed), 50, "us")


def recorded(path: Path, length: int, count: int, hz: float, seed: int) -> tuple[float, float]:
    """Processor time of the recorder for a message [s], and how long publishing took."""
    with (
        hub() as endpoint,
        started(*publisher(endpoint, length, count, hz, seed)) as speaker,
        recorder(endpoint, path, "--max-loss", "0.25") as process,
    ):
        await_ready(speaker)
        before_s, started_s = cpu_s(process), time.monotonic()
        publish(speaker)
        passed_s = time.monotonic() - started_s
        _await_whole(path)
        took_s = cpu_s(process) - before_s
        assert end(process) == 0
    return took_s / count, passed_s


def heard(length: int, count: int, hz: float, seed: int) -> float:
    """Processor time of a process that only takes the samples, for one of them [s]."""
    inbox: Inbox[Sample] = Inbox()
    with (
        hub() as endpoint,
        started(*publisher(endpoint, length, count, hz, seed)) as speaker,
        open_bus(endpoint) as bus,
    ):
        bus.subscribe(keys.everything(RUN), inbox)
        await_ready(speaker)
        over = threading.Event()
        thread = threading.Thread(target=_drain, args=(inbox, over))
        thread.start()
        before_s = time.process_time()
        publish(speaker)
        took_s = time.process_time() - before_s
        over.set()
        thread.join()
    return took_s / count


def missing(path: Path, count: int) -> int:
    """Messages of the publisher that are not in the file, or there twice."""
    with open_recording(path) as recording:
        recording.check()
        found = Counter((m.key, m.sequence) for m in recording.messages(topics=(keys.REPORT,)))
    twice = sum(times - 1 for times in found.values())
    return count - len(found) + twice


def hand_over_s(seed: int) -> float:
    """Time of a callback at 99 %, while another thread empties the inbox as the recorder does."""
    inbox: Inbox[Sample] = Inbox(256 * 1024 * 1024)
    over = threading.Event()
    thread = threading.Thread(target=_drain, args=(inbox, over))
    thread.start()
    times_s = []
    samples = [Sample(KEYS[n % 10], data, ENCODING) for n, data in enumerate(_data(seed))]
    for sample in samples:
        started_s = time.perf_counter()
        inbox.put(sample, weigh(sample.key, sample.payload))
        times_s.append(time.perf_counter() - started_s)
        if len(times_s) % 40 == 0:
            time.sleep(0.001)
    over.set()
    thread.join()
    return float(np.percentile(times_s, 99))


def _data(seed: int) -> list[bytes]:
    return payloads(seed, SMALL_BYTES, 20_000)


def _drain(inbox: Inbox[Sample], over: threading.Event) -> None:
    while not over.is_set():
        inbox.take(0.05)


def _await_whole(path: Path) -> None:
    """Give the recorder the time to fetch what it has missed: until only statistics are written."""
    deadline_s = time.monotonic() + DEADLINE_S
    size = 0
    while path.stat().st_size > size + STATISTICS_BYTES and time.monotonic() < deadline_s:
        size = path.stat().st_size
        time.sleep(SETTLE_S)
