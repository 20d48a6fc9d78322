"""Whether a run goes on: its steps, and the token of its world."""

from __future__ import annotations

import logging

from schemas import codec, keys
from schemas.bus.interface import Bus, Inbox, Liveness, Sample
from schemas.bus.roster import Roster
from schemas.errors import WireError
from schemas.messages import Step

from .run_clock import RunClock

log = logging.getLogger("bridge")

LATCHED_S = 0.3


class RunWatch:
    """Follows the steps of a run until its world has left.

    A hub often goes with its run, and takes the news of the world's leaving with it: once the
    world has said that the run has ended, a lost link is the end too.
    """

    def __init__(self, bus: Bus, run: str, clock: RunClock) -> None:
        self._bus, self._clock = bus, clock
        self._steps: Inbox[Sample] = Inbox()
        self._tokens: Inbox[Liveness] = Inbox()
        self._roster = Roster()
        self._ended = False
        bus.subscribe(keys.STEP.key(run), self._steps)
        bus.watch(keys.every_alive(run), self._tokens)
        for latched in bus.query(keys.STEP.key(run), b"", "", LATCHED_S):
            self._steps.put(latched)
        self._listen()

    def is_over(self, now_s: float) -> bool:
        """Whether the run has ended; to be asked often."""
        self._listen()
        up = self._bus.link_up()
        lost = self._roster.update(self._tokens.take(), up, now_s)
        gone = any(life.process == keys.WORLD for life in lost)
        return gone or (self._ended and not up)

    def _listen(self) -> None:
        for sample in self._steps.take():
            try:
                step = codec.decode(Step, sample.payload, sample.encoding)
            except WireError as error:
                log.warning("refused a step: %s", error)
                continue
            self._clock.hear(step)
            self._ended = self._ended or bool(step.ended)
