"""A process as a member of a run: its boot, token, state, outbox and acknowledgements."""

from __future__ import annotations

import secrets
import time
from contextlib import ExitStack
from types import TracebackType
from typing import NamedTuple

from .. import keys
from ..messages import Ack, ProcessState, StreamEnd
from .interface import Bus
from .outbox import Outbox

BEAT_S = 1.0


class Buses(NamedTuple):
    """The two sessions of a process: what steers the run must not queue behind the data."""

    control: Bus
    data: Bus

    def close(self) -> None:
        """Leave the bus."""
        self.data.close()
        self.control.close()


class Member:
    """One life of a process; `reboot` starts the next one."""

    def __init__(self, run: str, process: str, buses: Buses) -> None:
        self.run, self.process, self.buses = run, process, buses
        self.boot = secrets.token_hex(8)
        self.outbox = Outbox(run, process, self.boot, buses.control, buses.data)
        self._token = ExitStack()
        self._beat_s = float("-inf")

    def __enter__(self) -> Member:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._token.close()

    def announce(self) -> None:
        """Show the liveliness token: from here on the run counts on this process."""
        token = keys.alive(self.run, self.process, self.boot)
        self._token.enter_context(self.buses.control.announce(token))

    def reboot(self) -> None:
        """Begin a new life: a new boot, with every stream counting from 1 again."""
        self._token.close()
        self._token = ExitStack()
        self.boot = secrets.token_hex(8)
        self.outbox.begin(self.boot)

    def ack(self, step: int, manifest: list[StreamEnd] | None = None) -> None:
        """Say that all of a step is done; step 0 says ready."""
        message = Ack(process=self.process, boot=self.boot, step=step, manifest=manifest or [])
        self.outbox.send(keys.ACK, (self.process,), message)

    def beat(self, step: int, phase: str = "running", **counters: int) -> None:
        """Publish the state of the process, at most once a second."""
        now_s = time.monotonic()
        if now_s - self._beat_s < BEAT_S:
            return
        self._beat_s = now_s
        state = ProcessState(
            process=self.process,
            boot=self.boot,
            t_ns=time.time_ns(),
            step=step,
            phase=phase,
            counters=counters,
        )
        self.outbox.send(keys.STATE, (self.process,), state)
