"""The machine: shared memory, open files, disk and clocks."""

from __future__ import annotations

import ctypes
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from .finding import Finding, judged

SHARED = Path("/dev/shm")  # noqa: S108 (looked at, not written)
MB, GB = 10**6, 10**9
BLOCK_BYTES, BLOCKS = 256 * 1024, 64
"""What a recorder writes at a time, and how often here."""
SYNCS = 20
STEP_S = 0.02
_TIMEX_BYTES, _STATUS_OFFSET, _UNSYNCHRONISED, _MAX_ERROR_OFFSET = 208, 40, 0x40, 24


class Clocks(NamedTuple):
    """Wall clock and monotonic clock at one instant [s]."""

    wall_s: float
    monotonic_s: float

    @classmethod
    def read(cls) -> Clocks:
        """Now."""
        return cls(time.time(), time.monotonic())


def shared_memory() -> Finding:
    """Its size, which does not matter: Zenoh's shared memory is off."""
    try:
        size_mb = shutil.disk_usage(SHARED).total / MB
    except OSError:
        return Finding("shared memory", "ok", "none; not needed")
    return Finding("shared memory", "ok", f"{size_mb:.0f} MB in {SHARED}; not needed")


def open_files() -> Finding:
    """How many files a process may have open: the launcher has three for every carrier."""
    if sys.platform == "win32":
        return Finding("open files", "ok", "not limited")
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if limit == resource.RLIM_INFINITY:
        return Finding("open files", "ok", "not limited")
    advice = f"ulimit -n 4096 before a run with more than {limit // 4} carriers"
    return judged("open files", limit, f"at most {limit}", advice, warn_below=1024, bad_below=64)


def disk(folder: Path) -> Iterator[Finding]:
    """Space and speed where recordings go; the folder need not be there yet."""
    place = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    free_mb = shutil.disk_usage(place).free / MB
    yield judged(
        "disk space",
        free_mb,
        f"{free_mb / 1000:.1f} GB free in {place}",
        "make room, or record elsewhere with --output: ten simulated minutes take 3 to 30 MB",
        warn_below=1000,
        bad_below=50,
    )
    yield _disk_speed(place)


def resolution() -> Finding:
    """The smallest step of the wall clock, by which messages are stamped."""
    readings = [time.time_ns() for _ in range(2000)]
    steps_ns = [b - a for a, b in pairwise(readings) if b > a]
    finest_s = min(steps_ns, default=10**9) * 1e-9
    advice = "messages of one source within a tick get one stamp; use another clock source"
    found = f"{finest_s * 1e6:.1f} us" if finest_s >= 1e-7 else f"{finest_s * 1e9:.0f} ns"
    return judged(
        "clock step", -finest_s, f"finest {found}", advice, warn_below=-1e-3, bad_below=-0.1
    )


def synchronised() -> Finding:
    """Whether the kernel's clock is held to a time source (Linux tells)."""
    what = "clock is set"
    if not sys.platform.startswith("linux") or sys.maxsize < 2**32:
        return Finding(what, "ok", "unknown here; matters for live carriers on several machines")
    state = ctypes.create_string_buffer(_TIMEX_BYTES)
    if ctypes.CDLL(None).adjtimex(state) < 0:
        return Finding(what, "ok", "unknown: the kernel does not say")
    status = int.from_bytes(state.raw[_STATUS_OFFSET : _STATUS_OFFSET + 4], sys.byteorder)
    error_us = int.from_bytes(state.raw[_MAX_ERROR_OFFSET : _MAX_ERROR_OFFSET + 8], sys.byteorder)
    if status & _UNSYNCHRONISED:
        advice = "run chrony or ntpd where live carriers are on several machines; else no matter"
        return Finding(what, "warn", "by no time source", advice)
    return Finding(what, "ok", f"by a time source, to {error_us / 1000:.0f} ms at worst")


def steps(before: Clocks) -> Finding:
    """Whether the wall clock was set while the doctor worked."""
    now = Clocks.read()
    passed_s = now.monotonic_s - before.monotonic_s
    jump_s = (now.wall_s - before.wall_s) - passed_s
    found = f"{jump_s * 1000:+.1f} ms in {passed_s:.1f} s"
    advice = "let chrony or ntpd slew it (makestep only at boot): live stamps jump with it"
    return judged("clock jumps", -abs(jump_s), found, advice, warn_below=-STEP_S, bad_below=-1.0)


def _disk_speed(place: Path) -> Finding:
    """Write as the recorder does, and wait for the disk as it does with fsync."""
    what = "disk speed"
    block = os.urandom(BLOCK_BYTES)
    try:
        with tempfile.TemporaryFile(dir=place, buffering=0) as file:
            started_s = time.perf_counter()
            for _ in range(BLOCKS):
                file.write(block)
            os.fsync(file.fileno())
            rate_mb_s = BLOCKS * BLOCK_BYTES / MB / (time.perf_counter() - started_s)
            sync_s = statistics.median(_sync_s(file.fileno()) for _ in range(SYNCS))
    except OSError as error:
        advice = f"make {place} writable for this user, or record elsewhere with --output"
        return Finding(what, "bad", f"cannot write in {place}: {error.strerror}", advice)
    found = f"{rate_mb_s:.0f} MB/s written, {sync_s * 1000:.1f} ms to sync a record"
    advice = "record to a faster disk with --output: a slow one holds up the run"
    return judged(what, rate_mb_s, found, advice, warn_below=20, bad_below=1)


def _sync_s(descriptor: int) -> float:
    started_s = time.perf_counter()
    os.write(descriptor, b"x" * 4096)
    os.fsync(descriptor)
    return time.perf_counter() - started_s
