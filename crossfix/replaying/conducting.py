"""Plays the world's part in a replay: a fusion centre then fuses the recording as if it were a run.

What was closed is closed again, step by step, each when the fusion centre has room for it; so a
replay gives the same outputs however fast it goes, and whatever is lost on the way is fetched. What
an operator did is ordered again, when the fusion centre stands before the step it took effect with.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from schemas import codec, keys
from schemas.bus.interface import Bus, Inbox, Sample
from schemas.bus.member import Member
from schemas.errors import BusError, RecordingError, WireError
from schemas.messages import (
    Ack,
    Answer,
    Closed,
    Command,
    DeclaredScenario,
    Event,
    Step,
    TruthScenario,
)
from schemas.recording.contents import truth_of
from schemas.recording.reader import Recorded, Recording

from .player import Outlet

WINDOW = 8
"""Steps that may be closed before the fusion centre has acknowledged the first of them."""
PATIENCE_S = 60.0
"""A fusion centre that gets no further for so long is not waited for."""
REPEAT_S = 0.5
"""What was said last is said again while it is waited for: nobody else would miss it if lost."""
LEAVING_S = 20.0
PUMP_S = 0.02
ORDER_S = 2.0
"""A question that was lost is asked again after so long; the id tells that it is the same."""


class World:
    """The world of a recording: its scenario, its steps, its carriers' tokens.

    Args:
        member: of the run, on the recorded world's boot; see `world_boot`.
        speak: where the messages of the others go.

    Raises:
        RecordingError: the recording holds no scenario, or nothing that a fusion centre closed.
    """

    def __init__(self, member: Member, recording: Recording, speak: Outlet) -> None:
        self._member, self._speak = member, speak
        self._scenario: DeclaredScenario = recording.scenario
        self._truth = truth_of(recording.attachments) or TruthScenario(
            name=recording.scenario.name, seed=0, text=""
        )
        closings = list(_closings(recording))
        if not closings:
            raise RecordingError("nothing was fused in this recording", expected="closed/fusion")
        self._last = closings[-1]
        self._events = _events(recording)
        self._lives = sorted({(e.carrier, e.boot) for c in closings for e in c.manifest})
        self._acks: Inbox[Sample] = Inbox()
        self._acked = 0
        self._said: tuple[tuple[keys.Topic, Step | Closed], ...] = ()

    @contextmanager
    def present(self, timeout_s: float) -> Iterator[None]:
        """Be there, with all carriers, and wait for the fusion centre and its recorder.

        Raises:
            BusError: they do not come in time.
        """
        member, control = self._member, self._member.buses.control
        control.subscribe(keys.ACK.key(member.run, keys.FUSION), self._acks)
        member.outbox.send(keys.SCENARIO, (), self._scenario)
        member.outbox.send(keys.TRUTH_SCENARIO, (), self._truth)
        with ExitStack() as stack:
            member.announce()
            for carrier, boot in self._lives:
                token = keys.alive(member.run, carrier, boot)
                stack.enter_context(control.announce(token))
            await_tokens(control, member.run, (keys.FUSION, keys.RECORDER), timeout_s)
            self._grant(0)
            yield
            self._end()

    def __call__(self, message: Recorded) -> None:
        """Publish a message of the recording, or what the world has to say instead."""
        topic = message.address.topic
        if topic is keys.CLOSED_FUSION:
            self._close(codec.decode(Closed, message.payload, message.encoding))
        elif topic.role in (keys.Role.INPUT, keys.Role.TRUTH) and topic not in _WORLDS_OWN:
            self._speak(message)

    def _close(self, closed: Closed) -> None:
        events = self._events.get(closed.step, [])
        self._await_ack(closed.step - (1 if events else WINDOW))
        for event in events:
            self._order(event)
        granted = self._grant(closed.step)
        self._member.outbox.send(keys.CLOSED_WORLD, (), closed)
        self._said = ((keys.STEP, granted), (keys.CLOSED_WORLD, closed))

    def _order(self, event: Event) -> None:
        """Have the fusion centre take an event with its next step, which is the recorded one.

        Raises:
            BusError: it does not.
        """
        named = {name: getattr(event, name) for name in Command.__struct_fields__}
        question, encoding = codec.encode(Command(**named)), codec.encoding_of(Command)
        key = keys.COMMAND.key(self._member.run, keys.FUSION)
        deadline_s, answer = time.monotonic() + PATIENCE_S, None
        while answer is None and time.monotonic() < deadline_s:
            for sample in self._member.buses.control.query(key, question, encoding, ORDER_S):
                answer = codec.decode(Answer, sample.payload, sample.encoding)
        if answer is None or not answer.taken or answer.step != event.step:
            raise BusError(
                f"the fusion centre does not take event {event.id} with step {event.step}",
                where=self._member.run,
                got=answer.reason or f"step {answer.step}" if answer else "no answer",
            )

    def _grant(self, step: int) -> Step:
        t_ns = self._scenario.epoch_ns + step * self._scenario.step_ns
        granted = Step(boot=self._member.boot, step=step, t_ns=t_ns)
        self._member.outbox.send(keys.STEP, (), granted)
        return granted

    def _end(self) -> None:
        """Let the fusion centre finish, and leave after it."""
        last = self._last
        self._await_ack(last.step)
        end = Step(boot=self._member.boot, step=last.step, t_ns=last.t_ns, ended="finished")
        deadline_s = time.monotonic() + LEAVING_S
        while time.monotonic() < deadline_s:
            self._member.outbox.send(keys.STEP, (), end)
            if keys.FUSION not in _names(self._member.buses.control, self._member.run):
                return
            time.sleep(PUMP_S)

    def _await_ack(self, step: int) -> None:
        """Return when the fusion centre has acknowledged a step.

        Raises:
            BusError: it gets no further.
        """
        went_on_s = said_s = time.monotonic()
        while self._acked < step:
            acked = self._acked
            for sample in self._acks.take(PUMP_S):
                ack = codec.decode(Ack, sample.payload, sample.encoding)
                self._acked = max(self._acked, ack.step)
            now_s = time.monotonic()
            if self._acked > acked:
                went_on_s = now_s
            if now_s - went_on_s > PATIENCE_S:
                raise BusError(
                    f"the fusion centre acknowledges nothing beyond step {self._acked}",
                    where=self._member.run,
                )
            if now_s - said_s > REPEAT_S:
                said_s = now_s
                for topic, message in self._said:
                    self._member.outbox.send(topic, (), message)


def await_tokens(bus: Bus, run: str, names: tuple[str, ...], timeout_s: float) -> None:
    """Return when processes of these names show their tokens.

    Raises:
        BusError: one does not in time; names it.
    """
    deadline_s = time.monotonic() + timeout_s
    while names and (missing := sorted(set(names) - _names(bus, run))):
        if time.monotonic() > deadline_s:
            raise BusError(
                f"not there after {timeout_s:g} s: {', '.join(missing)}",
                where=f"run {run}",
                expected=f"`crossfix fusion --run {run}` on the same hub",
            )
        time.sleep(PUMP_S)


def world_boot(recording: Recording) -> str:
    """The boot that the recorded truth and steps are of; empty where there are none."""
    for message in recording.messages(topics=(keys.STEP, keys.TRUTH_TARGETS)):
        try:
            boot: str = getattr(message.decode(), "boot", "")
        except WireError:
            continue
        return boot
    return ""


def _closings(recording: Recording) -> Iterator[Closed]:
    for message in recording.messages(topics=(keys.CLOSED_FUSION,)):
        yield codec.decode(Closed, message.payload, message.encoding)


def _events(recording: Recording) -> dict[int, list[Event]]:
    """What operators did, by the step it took effect with, in order."""
    events: dict[int, list[Event]] = {}
    for message in recording.messages(topics=(keys.EVENT,)):
        event = codec.decode(Event, message.payload, message.encoding)
        events.setdefault(event.step, []).append(event)
    return {step: sorted(some, key=lambda event: event.seq) for step, some in events.items()}


def _names(bus: Bus, run: str) -> set[str]:
    tokens = bus.tokens(keys.every_alive(run))
    return {keys.parse_alive(token)[1] for token in tokens}


_WORLDS_OWN = (keys.CLOSED_FUSION, keys.EVENT, keys.TRUTH_SCENARIO)
