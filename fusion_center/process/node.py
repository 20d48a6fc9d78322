"""The fusion centre as a process: receive, close, fuse, publish, record."""

from __future__ import annotations

import logging
import time
from typing import Protocol

from schemas import codec, keys
from schemas.bus.interface import Inbox, Liveness, Sample
from schemas.bus.ledger import StreamKey
from schemas.bus.member import Member
from schemas.bus.patience import HUB_TIMEOUT_S, HubPatience
from schemas.bus.recovery import Recovery
from schemas.errors import WireError
from schemas.messages import Closed, DeclaredScenario, Event, Health, Input, Step

from .. import pipeline
from ..admission.steps import refusal
from ..recorder import Recorder
from ..settings import Settings
from .attendance import Attendance
from .closing import LockstepClosing, PacedClosing
from .ingest import Ingest
from .operator import Operator

log = logging.getLogger("fusion")

PUMP_S = 0.02
REPEAT_S = 0.25
HEALTH_S = 1.0
MOST_NEWS = 100
"""Sentences in one health message."""
INPUTS = (keys.SOURCE, keys.REPORT, keys.NAVIGATION, keys.RANGING)


class Delay(Protocol):
    """Something that holds a step up (to test that it changes nothing)."""

    def __call__(self) -> None:
        """Wait."""


class FusionNode:
    """Runs the pure pipeline on what the bus brings; everything that decides is in a Closed."""

    def __init__(
        self,
        member: Member,
        scenario: DeclaredScenario,
        settings: Settings,
        recorder: Recorder,
        *,
        lateness_s: float = 0.2,
        hub_timeout_s: float = HUB_TIMEOUT_S,
        delay: Delay = lambda: None,
    ) -> None:
        self._member, self._scenario, self._recorder = member, scenario, recorder
        self._delay = delay
        self._samples: Inbox[Sample] = Inbox(128 * 1024 * 1024)
        self._tokens: Inbox[Liveness] = Inbox()
        self._attendance = Attendance(recorder.lives)
        self._ingest = Ingest(recorder.lives, scenario.max_clock_error_s)
        self._lockstep = LockstepClosing(scenario, self._ingest)
        self._paced = PacedClosing(scenario, self._ingest, lateness_s)
        self._closing: LockstepClosing | PacedClosing = self._lockstep
        self._hub = HubPatience(hub_timeout_s)
        self._recovery = Recovery(member.run, member.buses.data, self._samples)
        self._operator = Operator(member)
        self._state = pipeline.initial(scenario, settings)
        self._step = 0
        self._ended: Step | None = None
        self._alarmed = False
        self._news: list[str] = []
        self._acked = -1
        self._said_s = self._health_s = float("-inf")
        self._busy_s = 0.0
        self._stop = ""

    def stop(self, reason: str) -> None:
        """Ask for an early, clean end; safe from a signal handler or another thread."""
        self._stop = reason
        self._samples.wake()

    def run(self) -> str:
        """The whole life of the fusion centre; the reason why it ended.

        Raises:
            BusError: the hub has gone and has not come back; the recording is sealed by then.
        """
        self._open()
        while not self._is_over():
            samples = self._samples.take(PUMP_S)
            now_s = time.monotonic()
            self._mind_the_roster(now_s)
            for sample in samples:
                self._note(sample)
            self._mind_the_recorder()
            while (closed := self._closing.next(now_s)) is not None:
                self._fuse(closed)
                self._say(time.monotonic())
            for gap in self._recovery.pursue(self._closing.gaps(), now_s):
                self._closing.give_up(gap)
            self._say(now_s)
        reason = self._finish()
        self._hub.require()
        return reason

    def _open(self) -> None:
        run = self._member.run
        control, data = self._member.buses
        control.watch(keys.every_alive(run), self._tokens)
        control.subscribe(keys.STEP.key(run), self._samples)
        control.subscribe(keys.CLOSED_WORLD.key(run), self._samples)
        for topic in INPUTS:
            data.subscribe(topic.every(run), self._samples)
        self._operator.open()
        self._member.announce()

    def _note(self, sample: Sample) -> None:
        """Route one sample: control to the closing of time, the rest to the ingest."""
        if sample.key not in self._control_keys():
            self._ingest.accept(sample)
            return
        topic = keys.parse(sample.key).topic
        try:
            message = codec.decode(topic.message, sample.payload, sample.encoding)
        except WireError as error:
            self._ingest.refuse(keys.WORLD, topic.name, str(error))
            return
        reason = ""
        if isinstance(message, Closed):
            reason = self._lockstep.on_closed(message)
        elif isinstance(message, Step):
            reason = self._on_step(message)
        if reason:
            self._ingest.refuse(keys.WORLD, topic.name, reason)

    def _control_keys(self) -> tuple[str, str]:
        run = self._member.run
        return keys.STEP.key(run), keys.CLOSED_WORLD.key(run)

    def _on_step(self, step: Step) -> str:
        """Go on to a step; why it is none of this run's world, empty if it is."""
        if not self._recorder.lives.is_world(step.boot):
            return f"boot {step.boot} is no world of this run"
        if reason := refusal(step, self._scenario):
            return reason
        if step.ended:
            self._ended = step
        self._closing = self._lockstep if step.mode == "lockstep" else self._paced
        self._closing.on_step(step, time.monotonic())
        return ""

    def _fuse(self, closed: Closed) -> None:
        """Fuse one Closed: the same call as in replay and in every test."""
        self._delay()
        started_s = time.perf_counter()
        events = self._operator.events(closed, self._state.settings)
        self._member.outbox.send(keys.CLOSED_FUSION, (), closed)
        messages: list[Input | Event] = [*events, *self._ingest.claim(closed)]
        self._state, outputs = pipeline.step(self._state, closed, messages)
        for topic, ids, message in outputs:
            self._member.outbox.send(topic, ids, message)
        self._step = closed.step
        self._busy_s += time.perf_counter() - started_s

    def _mind_the_roster(self, now_s: float) -> None:
        up = self._member.buses.control.link_up()
        if self._hub.is_over(up, now_s):
            self._stop = self._stop or "the hub is lost"
        changes = self._attendance.update(self._tokens.take(), up, now_s)
        self._news += changes.news
        if changes.world_lost:
            self._stop = self._stop or "the world is lost"
        for closing in (self._lockstep, self._paced):
            for carrier in changes.gone:
                closing.on_lost(carrier)
            for carrier in changes.come:
                closing.on_joined(carrier)
        if changes.gone:
            self._health_s = float("-inf")

    def _mind_the_recorder(self) -> None:
        error = self._recorder.error()
        if error is not None and not self._alarmed:
            self._alarmed = True
            self._news.append(f"ALARM: {error}; the fusion goes on without a recording")
            self._health_s = float("-inf")

    def _say(self, now_s: float) -> None:
        """Acknowledge what is fused and recorded, and publish health and state."""
        if self._recorder.keeps_up() and (
            self._step > self._acked or now_s - self._said_s > REPEAT_S
        ):
            self._said_s, self._acked = now_s, self._step
            self._member.ack(self._step)
        if now_s - self._health_s > HEALTH_S:
            self._publish_health(now_s)
        self._member.beat(self._step, drops=self._samples.drops)

    def _publish_health(self, now_s: float) -> None:
        passed_s = now_s - self._health_s
        self._news += self._attendance.strangers(self._ingest.waiting())
        news, self._news = self._news[:MOST_NEWS], []
        busy_s, self._busy_s = self._busy_s, 0.0
        health = Health(
            centre=self._member.process,
            t_ns=time.time_ns(),
            step=self._step,
            alive=self._attendance.here,
            lost=self._attendance.lost,
            news=news,
            streams=self._ingest.statistics(),
            queue_drops={"inputs": self._samples.drops},
            recorder=self._recorder.counters(),
            load=min(1.0, busy_s / passed_s),
        )
        self._health_s = now_s
        self._member.outbox.send(keys.HEALTH, (self._member.process,), health)

    def _is_over(self) -> bool:
        done = self._ended is not None and self._step >= self._ended.step
        return done or bool(self._stop)

    def _finish(self) -> str:
        """Seal the recording with everything in it; the reason of the end."""
        reason = self._stop or (self._ended.ended if self._ended else "stopped")
        self._abandon_unclaimed()
        self._publish_health(time.monotonic())
        self._recorder.finish(reason, self._expected(), self._ingest.given_up())
        self._recovery.close()
        self._member.ack(self._step)
        return reason

    def _expected(self) -> dict[StreamKey, int]:
        """What a whole recording holds: all that was claimed, concluded and true so far."""
        streams = self._member.outbox.streams()
        of_fusion = {StreamKey(keys.FUSION, "", name): last for name, last in streams.items()}
        truth = (keys.TRUTH_TARGETS, keys.TRUTH_CARRIERS)
        of_world = {StreamKey(keys.WORLD, "", topic.template): self._step for topic in truth}
        return {**self._ingest.claimed(), **of_fusion, **of_world}

    def _abandon_unclaimed(self) -> None:
        self._news += self._attendance.strangers(self._ingest.waiting())
        for carrier, boot in self._ingest.waiting():
            dropped = self._ingest.abandon(carrier, boot)
            self._news.append(f"{dropped} messages of {carrier} were never claimed")
