"""What an operator asks of the fusion centre, turned into events with a step of their own."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable

from schemas import codec, keys
from schemas.bus.answering import reply_to
from schemas.bus.interface import Sample
from schemas.bus.member import Member
from schemas.errors import WireError
from schemas.messages import Answer, Closed, Command, Event

from ..orders import refusal
from ..settings import Settings

MAX_COMMAND_BYTES = 64 * 1024
MOST_WAITING = 100
REMEMBERED = 1000
"""Ids of commands that are answered again and not carried out twice."""


class Operator:
    """Serves `command/fusion`; an accepted command is an input from the next Closed on."""

    def __init__(self, member: Member) -> None:
        self._member = member
        self._waiting: list[Command] = []
        self._answers: OrderedDict[str, Answer] = OrderedDict()
        self._lock = threading.Lock()
        self._settings = Settings()
        self._step = self._seq = 0

    def open(self) -> None:
        """Begin to answer."""
        key = keys.COMMAND.key(self._member.run, self._member.process)
        self._member.buses.control.serve(key, self._serve)

    def events(self, closed: Closed, settings: Settings) -> list[Event]:
        """The events that take effect with this Closed, published as inputs before it."""
        with self._lock:
            self._step, self._settings = closed.step, settings
            commands, self._waiting = self._waiting, []
        events = [self._event(command, closed) for command in commands]
        for event in events:
            self._member.outbox.send(keys.EVENT, (self._member.process,), event)
        return events

    def _event(self, command: Command, closed: Closed) -> Event:
        self._seq += 1
        return Event(
            centre=self._member.process,
            seq=self._seq,
            step=closed.step,
            t_ns=closed.t_ns,
            id=command.id,
            kind=command.kind,
            carrier=command.carrier,
            pair=command.pair,
            setting=command.setting,
            value=command.value,
        )

    def _serve(self, question: Sample) -> Iterable[Sample]:
        try:
            if len(question.payload) > MAX_COMMAND_BYTES:
                raise WireError("command too large", got=len(question.payload))
            said = self._take(codec.decode(Command, question.payload, question.encoding))
        except WireError as error:
            said = Answer(id="", taken=False, reason=str(error)[:1000])
        yield reply_to(question, said)

    def _take(self, command: Command) -> Answer:
        with self._lock:
            if len(self._waiting) >= MOST_WAITING:
                busy = f"{MOST_WAITING} commands wait for the next step already"
                return Answer(id=command.id, taken=False, reason=busy)
            if command.id not in self._answers:
                reason = refusal(self._settings, command)
                if not reason:
                    self._waiting.append(command)
                step = 0 if reason else self._step + 1
                answer = Answer(id=command.id, taken=not reason, step=step, reason=reason)
                self._answers[command.id] = answer
                if len(self._answers) > REMEMBERED:
                    self._answers.popitem(last=False)
            return self._answers[command.id]
