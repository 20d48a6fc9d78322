"""What every process of a run does first and last: one BLAS thread, logging, signals, exit code."""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

from ..errors import CrossfixError

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


LAUNCHER = "CROSSFIX_LAUNCHER"
"""Environment variable with the process id of the launcher, in what it has started."""
_PR_SET_PDEATHSIG = 1


def leave_with_launcher() -> None:
    """Have the kernel end this process when its launcher dies, however it dies (Linux only)."""
    launcher = os.environ.get(LAUNCHER)
    if launcher is None or not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if str(os.getppid()) != launcher:  # it was gone before we asked
        raise SystemExit(1)


def pin_threads() -> None:
    """Hold BLAS to one thread, before numpy is first imported: sums must not depend on cores."""
    for name in THREADS:
        os.environ[name] = "1"


def run_process(name: str, body: Callable[[], int]) -> int:
    """Run a process's body with logging; a user's error becomes one line and its exit code."""
    leave_with_launcher()
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    try:
        return body()
    except CrossfixError as error:
        logging.getLogger(name).error("error: %s", error)
        return error.exit_code


def leave(code: int) -> NoReturn:
    """End at once: a thread of the bus may still be in Rust, and finalising under it crashes."""
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def on_signal(stop: Callable[[], None]) -> None:
    """Call `stop` on SIGTERM and on the first Ctrl-C; the second one kills."""

    def handle(number: int, frame: FrameType | None) -> None:
        del number, frame
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        stop()

    signal.signal(signal.SIGTERM, handle)
    signal.signal(signal.SIGINT, handle)
