"""kill -9 of `crossfix record`: what is lost, and that what is left has no hole."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from pathlib import Path

from bench.figures import Figure, at_least, at_most, told
from schemas import codec, keys
from schemas.bus.interface import Bus
from schemas.bus.zenoh_bus import open_bus
from schemas.messages import SourceReport
from schemas.qos import DATA
from schemas.recording.reader import open_recording

from .processes import hub, recorder
from .samples import ENCODING, KEYS

MAX_LOSS_S = 0.25
GRACE_S = 0.05
HZ = 1000


def figures(folder: Path, seed: int, kills: int) -> Iterator[Figure]:
    """Over so many kills at any moment."""
    rng = random.Random(seed)  # noqa: S311 - when to kill
    losses_s, gapless = [], 0
    with hub() as endpoint:
        for number in range(kills):
            path = folder / f"kill{number}.mcap"
            killed_ns = kill(endpoint, path, rng.uniform(0.6, 1.4))
            loss_s, whole = left(path, killed_ns)
            losses_s.append(loss_s)
            gapless += whole
    small = sum(loss_s <= MAX_LOSS_S + GRACE_S for loss_s in losses_s)
    yield at_least("kill -9: lost no more than max-loss + 50 ms", small, kills, f"of {kills}")
    yield at_least("kill -9: a gapless prefix is left", gapless, kills, f"of {kills}")
    yield told("kill -9: most that was lost", 1000 * max(losses_s), "ms")
    yield at_most("kill -9: refused to read", sum(loss == float("inf") for loss in losses_s), 0)


def kill(endpoint: str, path: Path, after_s: float) -> int:
    """Publish a thousand messages a second, kill the recorder; when that was [Unix ns]."""
    with (
        open_bus(endpoint) as bus,
        recorder(endpoint, path, "--max-loss", str(MAX_LOSS_S)) as process,
    ):
        speak(bus, after_s)
        killed_ns = time.time_ns()
        process.kill()
        process.wait()
    return killed_ns


def speak(bus: Bus, seconds: float) -> None:
    """Publish reports stamped by the wall clock."""
    deadline_s, seq = time.monotonic() + seconds, 0
    while time.monotonic() < deadline_s:
        seq += 1
        report = SourceReport(
            carrier="c0", boot="b", stream="radar", seq=seq, t_ns=time.time_ns(), bearing_rad=[0.1]
        )
        bus.publish(KEYS[0], codec.encode(report), ENCODING, DATA)
        time.sleep(1 / HZ)


def left(path: Path, killed_ns: int) -> tuple[float, bool]:
    """Seconds before the kill that are lost, and whether the rest is a gapless prefix."""
    with open_recording(path) as recording:
        found = list(recording.messages(topics=(keys.REPORT,)))
    gapless = [m.sequence for m in found] == list(range(1, len(found) + 1))
    last_ns = found[-1].publish_time_ns if found else 0
    return (killed_ns - last_ns) / 1e9, gapless and bool(found)
