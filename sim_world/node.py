"""The world as a process: publishes the truth, grants steps, and closes time in lock-step."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import NamedTuple

from msgspec.structs import replace

from schemas import keys
from schemas.bus.interface import Inbox, Liveness, Sample
from schemas.bus.member import Member
from schemas.bus.patience import HUB_TIMEOUT_S, HubPatience
from schemas.bus.roster import Life, Roster
from schemas.errors import LaunchError, WireError
from schemas.feedback import WINDOW
from schemas.messages import Ack, Closed, DeclaredScenario, Step, TruthScenario
from schemas.received import receive

from .world import World

log = logging.getLogger("world")

RESEND_S = 0.25
PUMP_S = 0.02
LEAVE_S = 30.0
"""How long the fusion centre may go on without fusing anything more after the end."""
MAX_ANSWERS = 1024
"""Lives whose last answer is remembered; beyond it, only of those that are here."""
LOGGED = frozenset(10**n for n in range(10))
"""Which of many refusals are worth a line."""


class Pace(NamedTuple):
    """How the world proceeds: `rate` times the wall clock, or in lock-step where it is None.

    Attributes:
        hub_timeout_s: that the hub may be away.
    """

    rate: float | None = None
    start_timeout_s: float = 30.0
    step_timeout_s: float = 10.0
    hub_timeout_s: float = HUB_TIMEOUT_S


class WorldNode:
    """Runs a scenario to its end, to a signal, or until nobody is left to fuse it."""

    def __init__(
        self,
        world: World,
        declared: DeclaredScenario,
        truth: TruthScenario,
        member: Member,
        pace: Pace,
    ) -> None:
        self._world, self._declared, self._truth = world, declared, truth
        self._member, self._pace = member, pace
        self._samples: Inbox[Sample] = Inbox()
        self._tokens: Inbox[Liveness] = Inbox()
        self._roster = Roster()
        self._hub = HubPatience(pace.hub_timeout_s)
        self._answers: dict[Life, Ack] = {}
        self._taking_part: list[Life] = []
        self._given_up: list[str] = []
        self._lost: list[str] = []
        self._joined: list[str] = []
        self._current = Step(boot=member.boot, step=0, t_ns=declared.epoch_ns)
        self._granted = self._closed = 0
        self._centre: Life | None = None
        self._refused = 0
        self._sent_s = 0.0
        self._stop = ""

    def stop(self, reason: str) -> None:
        """Ask for an early, clean end; safe from a signal handler or another thread."""
        self._stop = reason
        self._samples.wake()

    def run(self) -> str:
        """The whole life of the world; the reason why it ended.

        Raises:
            LaunchError: somebody needed for the first step did not come in time, or a world of
                this run is alive.
            BusError: the hub has gone and has not come back.
        """
        self._require_alone()
        self._open()
        self._await_start()
        if self._pace.rate is None:
            self._run_lockstep()
        else:
            self._run_paced(self._pace.rate)
        reason = self._stop or "finished"
        self._end(reason)
        return reason

    def _run_lockstep(self) -> None:
        """Grant a step, wait for every answer, close it, and let the fusion centre keep up."""
        for step in range(1, self._declared.steps + 1):
            self._join()
            self._grant(step)
            self._wait(lambda: not self._unanswered(), self._pace.step_timeout_s)
            if self._stop:
                return
            for life in self._unanswered():
                self._give_up(life, f"no answer to step {step} in {self._pace.step_timeout_s:g} s")
            self._close(step)
            self._wait(self._has_room)

    def _run_paced(self, rate: float) -> None:
        """Grant a step when its time has come by the wall clock; nobody is waited for."""
        started_s = time.monotonic()
        for step in range(1, self._declared.steps + 1):
            due_s = started_s + step * self._declared.step_ns * 1e-9 / rate
            self._wait(lambda: False, due_s - time.monotonic())
            if self._stop:
                return
            self._grant(step)

    def _require_alone(self) -> None:
        """Two worlds of one run would talk past each other, and to the same carriers."""
        run = self._member.run
        tokens = self._member.buses.control.tokens(keys.alive_of(run, keys.WORLD))
        if tokens:
            raise LaunchError(
                "a world of this run is alive",
                where=f"run {run}",
                expected="another --run NAME, or the end of that world",
            )

    def _open(self) -> None:
        control = self._member.buses.control
        control.watch(keys.every_alive(self._member.run), self._tokens)
        control.subscribe(keys.ACK.every(self._member.run), self._samples)
        self._member.outbox.send(keys.SCENARIO, (), self._declared)
        self._member.outbox.send(keys.TRUTH_SCENARIO, (), self._truth)
        self._member.announce()

    def _await_start(self) -> None:
        """Wait until every scenario carrier, the fusion centre and the recorder are ready."""
        needed = [carrier.name for carrier in self._declared.carriers] + [keys.FUSION]

        def missing() -> list[str]:
            ready = {life.process for life in self._answers if life in self._roster.present}
            recorder = [] if self._roster.has(keys.RECORDER) else [keys.RECORDER]
            return [name for name in needed if name not in ready] + recorder

        self._wait(lambda: not missing(), self._pace.start_timeout_s)
        if missing() and not self._stop:
            raise LaunchError(
                f"not ready after {self._pace.start_timeout_s:g} s: {', '.join(missing())}",
                where=f"run {self._member.run}",
                expected="start them, or raise --start-timeout",
            )
        self._joined = []

    def _grant(self, step: int) -> None:
        targets, carriers = self._world.step(step)
        boot = self._member.boot
        self._member.outbox.send(keys.TRUTH_TARGETS, (), replace(targets, boot=boot, seq=step))
        self._member.outbox.send(keys.TRUTH_CARRIERS, (), replace(carriers, boot=boot, seq=step))
        self._current = Step(
            boot=boot,
            step=step,
            t_ns=targets.t_ns,
            mode="lockstep" if self._pace.rate is None else "paced",
            final=step == self._declared.steps,
            given_up=self._given_up,
        )
        self._granted = step
        self._say()

    def _close(self, step: int) -> None:
        manifest = [
            end
            for life in sorted(self._taking_part)
            if (answer := self._answers.get(life)) and answer.step >= step
            for end in answer.manifest
        ]
        closed = Closed(
            step=step,
            t_ns=self._current.t_ns,
            manifest=manifest,
            joined=self._joined,
            lost=self._lost,
            final=step == self._declared.steps,
        )
        self._member.outbox.send(keys.CLOSED_WORLD, (), closed)
        self._closed = step
        self._joined, self._lost = [], []

    def _end(self, reason: str) -> None:
        """Say that no step follows, until the fusion centre has finished and left."""
        log.info("ended at step %d: %s", self._current.step, reason)
        closed = self._closed if self._pace.rate is None else self._current.step
        self._current = replace(self._current, step=closed, ended=reason)
        self._say()
        self._stop = ""
        fused = -1
        while self._roster.has(keys.FUSION) and self._fused() > fused:
            fused = self._fused()
            self._wait(lambda: not self._roster.has(keys.FUSION), LEAVE_S)

    def _join(self) -> None:
        """Let everyone in who has said to be ready since the last step."""
        for life in sorted(self._answers):
            if life.process in keys.RESERVED_PROCESSES or life.boot in self._given_up:
                continue
            if life in self._roster.present and life not in self._taking_part:
                self._taking_part.append(life)
                self._joined.append(life.process)

    def _unanswered(self) -> list[Life]:
        step = self._current.step
        return [life for life in self._taking_part if self._answers[life].step < step]

    def _fused(self) -> int:
        return self._answers[self._centre].step if self._centre in self._answers else 0

    def _has_room(self) -> bool:
        """Whether the fusion centre is near enough behind for another step."""
        return self._fused() + WINDOW > self._current.step

    def _give_up(self, life: Life, why: str) -> None:
        log.warning("carrier %s lost: %s", life.process, why)
        self._taking_part.remove(life)
        self._given_up.append(life.boot)
        self._lost.append(life.process)
        self._current = replace(self._current, given_up=self._given_up)

    def _wait(self, done: Callable[[], bool], timeout_s: float = float("inf")) -> None:
        """Turn the loop until `done`, a stop or the time is over; a lost link does not count."""
        now_s = time.monotonic()
        remaining_s = timeout_s
        while not done() and not self._stop and remaining_s > 0:
            self._pump(min(PUMP_S, remaining_s))
            before_s, now_s = now_s, time.monotonic()
            if self._pace.rate is not None or self._member.buses.control.link_up():
                remaining_s -= now_s - before_s

    def _pump(self, timeout_s: float) -> None:
        for sample in self._samples.take(timeout_s):
            self._note(sample)
        now_s = time.monotonic()
        up = self._member.buses.control.link_up()
        if self._hub.is_over(up, now_s):
            self._hub.require()
        for life in self._roster.update(self._tokens.take(), up, now_s):
            self._on_loss(life)
        if self._centre is None and (boots := self._roster.boots(keys.FUSION)):
            self._centre = Life(keys.FUSION, boots[0])  # the first is the only one
        if now_s - self._sent_s > RESEND_S and self._current.step:
            self._say()
        self._member.beat(
            self._current.step, carriers=len(self._taking_part), refused=self._refused
        )

    def _note(self, sample: Sample) -> None:
        try:
            ack = self._understood(sample)
        except WireError as error:
            self._refused += 1
            if self._refused in LOGGED:
                log.warning("refused an acknowledgement: %s", error)
            return
        life = Life(ack.process, ack.boot)
        before = self._answers.get(life)
        if before is None or ack.step >= before.step:
            self._answers[life] = ack
        if len(self._answers) > MAX_ANSWERS:
            kept = self._roster.present.union(self._taking_part)
            self._answers = {who: said for who, said in self._answers.items() if who in kept}

    def _understood(self, sample: Sample) -> Ack:
        """An acknowledgement that its sender may have meant.

        Raises:
            WireError: it is none, speaks for somebody else, or of a step that was never granted.
        """
        ack = receive(sample).message
        if not isinstance(ack, Ack):
            raise WireError("no acknowledgement", got=sample.key)
        if ack.step > self._granted:
            raise WireError("of a step not granted yet", where=ack.process, got=ack.step)
        if foreign := [e for e in ack.manifest if (e.carrier, e.boot) != (ack.process, ack.boot)]:
            raise WireError("names streams of another", where=ack.process, got=foreign[0].carrier)
        return ack

    def _on_loss(self, life: Life) -> None:
        self._answers.pop(life, None)
        if life in self._taking_part:
            self._give_up(life, "its liveliness token is gone")
        elif (
            life.process == keys.FUSION
            and not self._roster.has(keys.FUSION)
            and not self._current.ended
        ):
            self._stop = "the fusion centre is lost"

    def _say(self) -> None:
        """Publish the current step; said again and again, so a lost one costs a moment only."""
        self._sent_s = time.monotonic()
        self._member.outbox.send(keys.STEP, (), self._current)
