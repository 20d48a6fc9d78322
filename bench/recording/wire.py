"""From a publisher over the hub into the file: gaps, processor time, and the callback's share."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np

from bench.figures import Figure, at_most, told
from schemas import keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.limits import weigh
from schemas.recording.reader import open_recording

from .processes import await_ready, cpu_s, end, hub, publish, publisher, recorder, started
from .samples import ENCODING, KEYS, LARGE_BYTES, SMALL_BYTES, payloads
from .subscriber import drain

SETTLE_S = 1.0
STATISTICS_BYTES = 4096
DEADLINE_S = 60.0
TURNS = 3
LISTENERS = {
    "plain": "a callback of Zenoh's that counts",
    "ours": "a bare subscriber of ours",
    "gathering": "a bare subscriber of ours that lets gather",
}
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
            yield from shares(folder, [message_s * hz], round(hz * seconds), hz, seed)
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


def shares(
    folder: Path, of_recorder: list[float], count: int, hz: float, seed: int
) -> Iterator[Figure]:
    """What of a core the recorder takes, and in turn with it who only listens."""
    listeners: dict[str, list[float]] = {"plain": [], "ours": [], "gathering": []}
    for turn in range(TURNS):
        if turn:
            path = folder / f"turn{turn}.mcap"
            of_recorder.append(hz * recorded(path, SMALL_BYTES, count, hz, seed)[0])
        for kind, took in listeners.items():
            took.append(hz * heard(kind, SMALL_BYTES, count, hz, seed))
    name = "40 k msg/s of 200 B, of a core"
    yield at_most(f"recorder at {name}: median of {TURNS}", median(of_recorder), 0.5)
    yield told(f"recorder at {name}: least", min(of_recorder))
    for kind, took in listeners.items():
        yield told(f"{LISTENERS[kind]} at {name}: median of {TURNS}", median(took))
        yield told(f"{LISTENERS[kind]} at {name}: least", min(took))


def heard(kind: str, length: int, count: int, hz: float, seed: int) -> float:
    """Processor time of a process that only takes the samples, for one of them [s]."""
    with (
        hub() as endpoint,
        started(*publisher(endpoint, length, count, hz, seed)) as speaker,
        started("-m", "bench.recording.subscriber", endpoint, kind) as listener,
    ):
        await_ready(speaker)
        await_ready(listener)
        before_s = cpu_s(listener)
        publish(speaker)
        return (cpu_s(listener) - before_s) / count


def missing(path: Path, count: int) -> int:
    """Messages of the publisher that are not in the file, or there twice."""
    with open_recording(path) as recording:
        recording.check()
        found = Counter((m.key, m.sequence) for m in recording.messages(topics=(keys.REPORT,)))
    twice = sum(times - 1 for times in found.values())
    return count - len(found) + twice


def hand_over_s(seed: int) -> float:
    """Time to hand a sample over at 99 %, while a thread empties the inbox as the recorder does."""
    inbox: Inbox[Sample] = Inbox(256 * 1024 * 1024)
    over = threading.Event()
    thread = threading.Thread(target=drain, args=(inbox, over))
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


def _await_whole(path: Path) -> None:
    """Give the recorder the time to fetch what it has missed: until only statistics are written."""
    deadline_s = time.monotonic() + DEADLINE_S
    size = 0
    while path.stat().st_size > size + STATISTICS_BYTES and time.monotonic() < deadline_s:
        size = path.stat().st_size
        time.sleep(SETTLE_S)
