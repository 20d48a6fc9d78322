"""Out of the file: both orders, memory, seeks and `info`, on a file of up to a gigabyte.

What is timed computes in one thread on a file in memory: its processor time is what a quiet machine
would take, and the neighbours on this one do not matter.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from bench.figures import Figure, at_least, at_most, told
from schemas.recording.reader import open_recording, summary

from .samples import LARGE_BYTES, SMALL_BYTES, payloads, stream
from .writing import resident_kib, write

SEEKS = 300
GIGABYTE = 10**9
PART = 1_000_000
MEASURED = """
import json, sys
from bench.recording.reading import measured
print(json.dumps(measured(sys.argv[1], sys.argv[2], int(sys.argv[3]))))
"""


def figures(folder: Path, seed: int, size: float) -> Iterator[Figure]:
    """Each measurement in a process of its own, for its memory."""
    small, large = folder / "small.mcap", folder / "large.mcap"
    data = payloads(seed, SMALL_BYTES, 20_000)
    write(small, stream(data, max(20_000, round(PART * size))))
    write(large, stream(payloads(seed, LARGE_BYTES, 200), 1000))
    grow(large, seed, round(GIGABYTE * max(size, 0.01)))
    for order, demand in (("file", 400_000), ("log_time", 300_000)):
        found = asked(small, order, seed)
        yield at_least(f"read, order of {order}, 200 B", found["per_s"], demand, "msg/s")
        found = asked(large, order, seed)
        yield told(f"read, order of {order}, 2 kB", found["per_s"], "msg/s")
        name = f"resident memory, order of {order}, {large.stat().st_size / 1e9:.2f} GB"
        yield at_most(name, found["peak_mb"], 100, "MB")
    theirs = asked(small, "mcap", seed)["per_s"]
    yield told("read by mcap's make_reader, 200 B", theirs, "msg/s")
    seeks = asked(large, "seek", seed)
    yield told("seek, median", 1000 * seeks["median_s"], "ms")
    yield at_most("seek, 95 %", 1000 * seeks["p95_s"], 15, "ms")
    yield at_most("info", 1000 * asked(large, "info", seed)["took_s"], 50, "ms")


def grow(path: Path, seed: int, size: int) -> None:
    """Write a recording of a size: of noise, which no compression makes smaller."""
    noise = np.random.default_rng(seed)
    data = [noise.bytes(LARGE_BYTES) for _ in range(500)]
    write(path, stream(data, max(1000, size // LARGE_BYTES), hz=25_000.0))


def asked(path: Path, what: str, seed: int) -> dict[str, float]:
    """What a process of its own measures."""
    command = [sys.executable, "-c", MEASURED, str(path), what, str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    found: dict[str, float] = json.loads(done.stdout)
    return found


def measured(path: str, what: str, seed: int) -> dict[str, float]:
    """One measurement, in the process it is asked in."""
    if what in ("file", "log_time"):
        return _read(lambda: _count(path, what))
    if what == "mcap":
        return _read(lambda: _count_plainly(path))
    if what == "seek":
        return _seeks(path, seed)
    summary(path)
    started_s = time.process_time()
    summary(path)
    return {"took_s": time.process_time() - started_s}


def _read(count: Callable[[], int]) -> dict[str, float]:
    best_s, messages = float("inf"), 0
    for _ in range(3):
        started_s = time.process_time()
        messages = count()
        best_s = min(best_s, time.process_time() - started_s)
    return {"per_s": messages / best_s, "peak_mb": resident_kib("VmHWM") / 1024}


def _count(path: str, order: str) -> int:
    with open_recording(path) as recording:
        return sum(1 for _ in recording.messages(order="file" if order == "file" else "log_time"))


def _count_plainly(path: str) -> int:
    with Path(path).open("rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages())


def _seeks(path: str, seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    times_s = []
    with open_recording(path) as recording:
        start_ns, end_ns = recording.index.spans[0].start_ns, recording.index.spans[-1].end_ns
        for t_ns in rng.integers(start_ns, end_ns, SEEKS).tolist():
            started_s = time.process_time()
            next(recording.messages(order="log_time", start_ns=t_ns))
            times_s.append(time.process_time() - started_s)
    median_s, p95_s = np.percentile(times_s, [50, 95]).tolist()
    return {"median_s": median_s, "p95_s": p95_s}
