"""A real hub in a process of its own, for live tests."""

import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
DEADLINE_S = 60.0


class HubProcess:
    """`python -m schemas.bus.hub`; ready when made, killed when left."""

    def __init__(self, listen: str = "tcp/127.0.0.1:0", *arguments: str) -> None:
        self._arguments = arguments
        self._start(listen)

    def __enter__(self) -> "HubProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.end(signal.SIGKILL)

    def restart(self) -> None:
        """Start it again where it listened before."""
        self._start(self.endpoint)

    def end(self, number: signal.Signals) -> int:
        """Signal it and wait; the exit code."""
        self.process.send_signal(number)
        code = self.process.wait(timeout=DEADLINE_S)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return code

    def _start(self, listen: str) -> None:
        command = [sys.executable, "-m", "schemas.bus.hub", "--listen", listen, *self._arguments]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line.startswith("listening on "), f"no hub on {listen}"
        self.endpoint = line.split()[-1]
