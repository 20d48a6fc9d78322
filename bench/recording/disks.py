"""A disk that is full in the middle of a run: the alarm, the file, the counts, and the fusion."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.figures import Figure, at_least, at_most, told
from crossfix.commands.run import RunOptions
from schemas.messages import Health
from schemas.recording.reader import digests, open_recording
from schemas.recording.record_file import RESERVE_BYTES
from tests.bad_input.test_running import PATROL
from tests.live.live_run import LiveRun

DISK_FAILED = 3
ROOM_BYTES = 140_000
"""Beside the reserve: for the header and some steps of the run, but not for all."""


def figures(folder: Path) -> Iterator[Figure]:
    """On a file system of 4 MB, where one may be mounted."""
    with small_disk() as disk:
        if disk is None:
            yield told("disk full: no file system can be mounted here", 0)
            return
        yield from _measured(folder, disk)


@contextmanager
def small_disk() -> Iterator[Path | None]:
    """A real file system with room for the reserve and little more; None where there is none."""
    size = RESERVE_BYTES + ROOM_BYTES
    with tempfile.TemporaryDirectory() as folder:
        mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder]
        mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0  # noqa: S603
        try:
            yield Path(folder) if mounted else None
        finally:
            if mounted:
                subprocess.run(["umount", folder], check=True)  # noqa: S603, S607


def _measured(folder: Path, disk: Path) -> Iterator[Figure]:
    options = RunOptions(rate="20")
    path = disk / "full.mcap"
    with LiveRun(PATROL, path, options) as run:
        health = run.await_news("ALARM")
        late_s = time.time() - path.stat().st_mtime
        last = run.await_message(Health, lambda said: said.step >= run.declared.steps)
        code = run.await_end()
    yield at_most("disk full: alarm after", late_s, 1.0, "s")
    yield at_least("disk full: steps fused all the same", last.step, run.declared.steps)
    yield at_most("disk full: exit code of the run", abs(code - DISK_FAILED), 0, "off 3")
    with open_recording(path) as recording:
        recording.check()
        found = sum(1 for _ in recording.messages())
        end = recording.end
        yield told("disk full: steps fused at the alarm", health.step)
        yield told("disk full: kinds of outputs in the file", len(digests(recording)))
    counts = last.recorder
    yield at_most("disk full: recorded less in the file", abs(counts["recorded"] - found), 0)
    yield at_most(
        "disk full: end names another count", abs((end.recorded if end else 0) - found), 0
    )
    accounted = sum(
        counts[name] for name in ("recorded", "rejected", "repeated", "passed_over", "dropped")
    )
    yield at_most("disk full: messages unaccounted for", abs(counts["received"] - accounted), 0)
    del folder
