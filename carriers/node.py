"""A simulated carrier as a process: waits for the truth of a step, observes it, answers."""

from __future__ import annotations

import logging
import random
import time
from collections import deque
from typing import Any

from msgspec.structs import replace

from schemas import keys
from schemas.bus.interface import Inbox, Liveness, Sample
from schemas.bus.ledger import StreamKey
from schemas.bus.member import Member
from schemas.bus.patience import HUB_TIMEOUT_S, HubPatience
from schemas.bus.recovery import Gap, Recovery
from schemas.bus.roster import Roster
from schemas.errors import WireError
from schemas.messages import Correction, Step, TruthCarriers, TruthTargets
from schemas.received import receive

from .carrier import Carrier, Stamp
from .feedback import Corrections

log = logging.getLogger("carrier")

PUMP_S = 0.05
READY_S = 0.5
PATIENCE_S = 3.0
"""How long the world may be missing before a carrier leaves without having heard of the end."""
AHEAD = 64
"""The world grants no step so far ahead of an answer in lock-step."""


class CarrierNode:
    """Observes every step it is granted, until the world leaves.

    Args:
        delay_s: waits a random time up to this long in every step (to test that it changes
            nothing).
        hub_timeout_s: that the hub may be away.
    """

    def __init__(
        self,
        member: Member,
        carrier: Carrier,
        *,
        delay_s: float = 0.0,
        hub_timeout_s: float = HUB_TIMEOUT_S,
    ) -> None:
        self._member, self._carrier, self._delay_s = member, carrier, delay_s
        self._stamp = Stamp(member.boot)
        self._samples: Inbox[Sample] = Inbox()
        self._tokens: Inbox[Liveness] = Inbox()
        self._roster = Roster()
        self._hub = HubPatience(hub_timeout_s)
        self._world = ""
        self._recovery = Recovery(member.run, member.buses.data, self._samples)
        self._granted: deque[Step] = deque()
        self._targets: dict[int, TruthTargets] = {}
        self._carriers: dict[int, TruthCarriers] = {}
        self._corrections = Corrections(member.process)
        self._done: int | None = None
        self._ready_s = float("-inf")
        self._missed_s = float("inf")
        self._ended = False
        self._stop = False

    def stop(self) -> None:
        """Ask for an early end; safe from a signal handler or another thread."""
        self._stop = True
        self._samples.wake()

    def run(self) -> str:
        """The whole life of the carrier; the reason why it ended.

        Raises:
            BusError: the hub has gone and has not come back.
        """
        self._open()
        while not self._stop:
            for sample in self._samples.take(PUMP_S):
                self._note(sample)
            while self._granted and not self._missing():
                self._observe(self._granted.popleft())
            now_s = time.monotonic()
            self._recovery.pursue(self._missing(), now_s)
            self._be_ready(now_s)
            self._member.beat(self._done or 0, drops=self._samples.drops)
            if self._world_is_gone(now_s):
                return "the world has left"
        return "stopped"

    def _open(self) -> None:
        run = self._member.run
        control, data = self._member.buses
        control.watch(keys.every_alive(run), self._tokens)
        control.subscribe(keys.STEP.key(run), self._samples)
        for topic in (keys.TRUTH_TARGETS, keys.TRUTH_CARRIERS):
            data.subscribe(topic.key(run), self._samples)
        if self._carrier.uses_corrections:
            key = keys.CORRECTION.key(run, keys.FUSION, self._member.process)
            data.subscribe(key, self._samples)
        self._member.announce()

    def _observe(self, step: Step) -> None:
        """Publish everything this carrier sees in a step, then say so."""
        if self._delay_s:
            time.sleep(random.uniform(0, self._delay_s))  # noqa: S311 (no secret: a test's delay)
        targets, carriers = self._targets.pop(step.step), self._carriers.pop(step.step)
        correction = self._correction(step)
        for topic, ids, message in self._carrier.step(targets, carriers, self._stamp, correction):
            stepped = message if step.mode == "lockstep" else replace(message, step=0)
            self._member.outbox.send(topic, ids, stepped)
        self._done = step.step
        self._answer()

    def _correction(self, step: Step) -> Correction | None:
        """The correction to apply in a step; `_missing` has seen to it that it is here."""
        lockstep = step.mode == "lockstep"
        return self._corrections.of(step.step) if lockstep else self._corrections.newest()

    def _answer(self) -> None:
        manifest = self._stamp.manifest(self._member.process)
        self._member.ack(self._done or 0, manifest)

    def _be_ready(self, now_s: float) -> None:
        """Say ready until the first step comes: what is said before the world is there is lost."""
        if self._done is None and not self._granted and now_s - self._ready_s > READY_S:
            self._ready_s = now_s
            self._member.ack(0)

    def _note(self, sample: Sample) -> None:
        try:
            message = receive(sample).message
        except WireError as error:
            log.warning("refused a message: %s", error)
            return
        if isinstance(message, Step):
            self._on_step(message)
        elif isinstance(message, TruthTargets) and self._is_near(message.step):
            self._targets[message.step] = message
        elif isinstance(message, TruthCarriers) and self._is_near(message.step):
            self._carriers[message.step] = message
        elif isinstance(message, Correction) and self._is_near(message.step):
            self._corrections.note(message)

    def _is_near(self, step: int) -> bool:
        """Whether the truth of a step is needed soon: what is refused can be fetched later."""
        newest = self._granted[-1].step if self._granted else self._done
        return len(self._targets) < AHEAD if newest is None else step <= newest + AHEAD

    def _on_step(self, step: Step) -> None:
        if self._world and step.boot != self._world:
            return  # the first is the only one
        if self._member.boot in step.given_up:
            self._restart()
        newest = self._granted[-1].step if self._granted else self._done
        self._ended = bool(step.ended)
        if step.ended or step.step == 0:
            return
        if newest is None or step.step > newest:
            self._granted.append(step)
        elif step.step == self._done:
            self._answer()

    def _restart(self) -> None:
        """Begin a new boot: the run has given this one up while it hung."""
        log.warning("taken for dead; starting a new boot")
        self._member.reboot()
        self._stamp = Stamp(self._member.boot)
        self._granted.clear()
        self._targets.clear()
        self._carriers.clear()
        self._corrections.clear()
        self._done, self._ready_s = None, float("-inf")
        self._member.announce()

    def _missing(self) -> list[Gap]:
        """What the next granted step still waits for; what is older is forgotten."""
        if not self._granted:
            return []
        step = self._granted[0]
        held: dict[keys.Topic, dict[int, Any]] = {
            keys.TRUTH_TARGETS: self._targets,
            keys.TRUTH_CARRIERS: self._carriers,
        }
        gaps: list[Gap] = []
        for topic, truth in held.items():
            for old in [number for number in truth if number < step.step]:
                del truth[old]
            if step.step not in truth:
                key = StreamKey(keys.WORLD, step.boot, topic.template)
                gaps.append((key, step.step, step.step))
        if self._carrier.uses_corrections and step.mode == "lockstep":
            gaps += self._corrections.missing(step.step, self._stamp.first_step() or step.step)
        return gaps

    def _world_is_gone(self, now_s: float) -> bool:
        """At once after the end of the run; else only when the world has stayed away a while.

        A process that was stopped finds its own link lost a moment after the tokens it carried.
        """
        up = self._member.buses.control.link_up()
        if self._hub.is_over(up, now_s):
            self._hub.require()
        lost = self._roster.update(self._tokens.take(), up, now_s)
        self._world = self._world or next(iter(self._roster.boots(keys.WORLD)), "")
        if self._roster.has(keys.WORLD):
            self._missed_s = float("inf")
        elif any(life.process == keys.WORLD for life in lost):
            self._missed_s = min(self._missed_s, now_s)
        return now_s - self._missed_s >= (0.0 if self._ended else PATIENCE_S)
