"""What a recorder can be asked while it records: to pause, to split, for a snapshot, how it is."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal, Protocol

from schemas import codec, keys
from schemas.bus.answering import reply_to
from schemas.bus.interface import Sample
from schemas.bus.member import Member
from schemas.errors import CrossfixError, RecordingError, WireError
from schemas.messages import RecorderCommand, RecorderStatus, Statistics

log = logging.getLogger("recorder")

MOST_ANSWERS = 256
"""Commands that are remembered, so that one that is repeated does nothing twice."""
FLUSH_S = 2.0


class Commanded(Protocol):
    """The recorder as its commands see it."""

    paused: bool

    def order(self, action: Callable[[], None]) -> None:
        """Have something done by the thread that writes."""

    def split(self) -> None:
        """Go on in a new part."""

    def flush(self) -> None:
        """Bring what has come so far into the file."""

    def error(self) -> RecordingError | None:
        """What ended the recording early."""

    def statistics(self) -> Statistics:
        """Counts so far."""

    def files(self) -> list[Path]:
        """What holds the recording so far."""


class Commands:
    """Answers the queries to one recorder.

    Args:
        recording: as it was asked for; its parts have numbers behind that name.
    """

    def __init__(self, recorder: Commanded, recording: Path) -> None:
        self._recorder, self._recording = recorder, recording
        self._answers: OrderedDict[str, RecorderStatus] = OrderedDict()
        self._copies: list[subprocess.Popen[bytes]] = []

    def answer(self, asked: Sample) -> Iterable[Sample]:
        """The reply to one query.

        Raises:
            WireError: it is none.
        """
        command = codec.decode(RecorderCommand, asked.payload, asked.encoding)
        status = self._answers.get(command.id)
        if status is None or command.kind == "status":
            status = self._carried_out(command)
            self._answers[command.id] = status
            while len(self._answers) > MOST_ANSWERS:
                self._answers.popitem(last=False)
        yield reply_to(asked, status)

    def close(self, timeout_s: float) -> None:
        """Wait for copies that are being made."""
        for copy in self._copies:
            try:
                copy.wait(timeout_s)
            except subprocess.TimeoutExpired:
                copy.kill()

    def _carried_out(self, command: RecorderCommand) -> RecorderStatus:
        try:
            self._carry_out(command)
        except CrossfixError as error:
            return self._status(command, str(error))
        return self._status(command, "")

    def _carry_out(self, command: RecorderCommand) -> None:
        recorder = self._recorder
        if command.kind != "status" and (error := recorder.error()) is not None:
            raise error
        if command.kind in ("pause", "resume"):
            recorder.paused = command.kind == "pause"
        elif command.kind == "split":
            if recorder.files() == [self._recording]:
                raise CrossfixError(
                    "not recorded in parts", expected="--split-size or --split-time"
                )
            recorder.order(recorder.split)
        elif command.kind == "snapshot":
            self._copy(command)

    def _copy(self, command: RecorderCommand) -> None:
        """Have a process of its own copy the last seconds, once they are in the file."""
        target = _target(self._recording, command.output)
        if command.last_s is None:
            raise WireError("snapshot of how much?", expected="last_s")
        flushed = threading.Event()

        def flush() -> None:
            """In the thread that writes."""
            self._recorder.flush()
            flushed.set()

        self._recorder.order(flush)
        if not flushed.wait(FLUSH_S):
            raise RecordingError("the recorder is too busy", expected="to be asked again")
        arguments = [str(self._recording), str(target), str(command.last_s)]
        module = "schemas.recording.snapshot"
        self._copies.append(
            subprocess.Popen([sys.executable, "-m", module, *arguments])  # noqa: S603 - ours
        )

    def _status(self, command: RecorderCommand, reason: str) -> RecorderStatus:
        recorder = self._recorder
        state: Literal["recording", "paused", "failed"] = "recording"
        if recorder.error() is not None:
            state = "failed"
        elif recorder.paused:
            state = "paused"
        return RecorderStatus(
            id=command.id,
            taken=not reason,
            reason=reason[:1000],
            state=state,
            files=[file.name for file in recorder.files()],
            statistics=recorder.statistics(),
        )


def _target(recording: Path, name: str) -> Path:
    """Where a snapshot goes: beside the recording, and never over anything.

    Raises:
        WireError: a name that leads elsewhere, or exists.
    """
    target = recording.with_name(name) if name and Path(name).name == name else None
    if target is None or target.suffix != ".mcap":
        raise WireError("not a name for a snapshot", got=name, expected="NAME.mcap, no folder")
    if target.exists():
        raise WireError("exists already", got=name, expected="the name of a new file")
    return target


def serve(recorder: Commanded, recording: Path, member: Member) -> Commands:
    """Let a recorder be asked under its process's name."""
    commands = Commands(recorder, recording)
    key = keys.RECORDING.key(member.run, member.process)
    member.buses.control.serve(key, commands.answer)
    return commands
