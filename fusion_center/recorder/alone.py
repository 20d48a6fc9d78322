"""A recorder as a process of its own: it begins when it is told to and ends with the run."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from pathlib import Path

from schemas import codec, keys
from schemas.bus.interface import Bus, Inbox, Liveness, Sample
from schemas.bus.latched import ATTEMPT_S
from schemas.bus.member import Member
from schemas.bus.patience import HubPatience
from schemas.bus.roster import Life, Roster
from schemas.errors import BusError
from schemas.messages import DeclaredScenario, RecorderCommand, TruthScenario

from .beginning import How, begin
from .thread import Recorder

log = logging.getLogger("recorder")

PUMP_S = 0.05
LATCHED = (keys.SCENARIO, keys.TRUTH_SCENARIO)


def record_whatever(member: Member, path: Path, how: How, wait_s: float) -> RecorderAlone:
    """Begin to record what is said under the name of a run, world or none.

    Args:
        wait_s: for a world to say what it runs; without one anything may be of the run, and the
            log time is that of the wall clock until a world counts steps.

    Raises:
        RecordingError: the file exists or cannot be written.
        WireError: what was answered is no scenario.
    """
    latched = fetched(member.buses.data, member.run, wait_s)
    parts = {keys.parse(sample.key).topic: sample for sample in latched}
    declared, hidden = (parts.get(topic) for topic in LATCHED)
    scenario = codec.decode(DeclaredScenario, *declared[1:]) if declared else None
    truth = codec.decode(TruthScenario, *hidden[1:]) if hidden else None
    recorder = begin(member, path, how, scenario, truth)
    return RecorderAlone(member, recorder, latched)


def fetched(bus: Bus, run: str, wait_s: float) -> list[Sample]:
    """The scenarios that the world of a run answers with; none where there is no world.

    Raises:
        WireError: an answer under another key than asked for.
    """
    deadline_s = time.monotonic() + wait_s
    while True:
        found = [s for topic in LATCHED for s in bus.query(topic.key(run), b"", "", ATTEMPT_S)[:1]]
        if found or time.monotonic() >= deadline_s:
            return found


class RecorderAlone:
    """Follows who takes part, and the run to its end.

    It ends when world and fusion centre have both been here and have gone, when it is told to
    stop, after its time, or when the disk fails.

    Attributes:
        hub: how long it may be away.
    """

    def __init__(self, member: Member, recorder: Recorder, latched: Sequence[Sample]) -> None:
        self.recorder = recorder
        self.hub = HubPatience()
        self._member, self._latched = member, latched
        self._tokens: Inbox[Liveness] = Inbox()
        self._roster = Roster()
        self._seen: set[Life] = set()
        self._met = set[str]()
        self._stop = ""

    def stop(self, reason: str) -> None:
        """Ask for the end; safe from a signal handler or another thread."""
        self._stop = reason
        self._tokens.wake()

    def start(self) -> None:
        """Listen: whatever is published from here on is recorded.

        Raises:
            BusError: somebody of this name records the run already.
        """
        self._require_alone()
        self._member.buses.control.watch(keys.every_alive(self._member.run), self._tokens)
        self.recorder.start(*self._latched)

    def run(self, duration_s: float = float("inf")) -> str:
        """Record until the end; the reason for it."""
        deadline_s = time.monotonic() + duration_s
        with self.recorder:
            while not self._stop:
                self._follow(self._tokens.take(PUMP_S))
                self._member.beat(self.recorder.step, self.phase, **self.recorder.counters())
                if self.recorder.error() is not None:
                    self._stop = f"failed: {self.recorder.error()}"
                elif time.monotonic() >= deadline_s:
                    self._stop = f"{duration_s:g} s are over"
                elif self._is_over():
                    self._stop = "finished" if self.recorder.ended else "the world is lost"
            self.recorder.finish(self._stop, dict(self.recorder.claimed), all_heard=True)
        return self._stop

    @property
    def phase(self) -> str:
        """What it does, as its state says."""
        if self.recorder.error() is not None:
            return "failed"
        return "paused" if self.recorder.paused else "running"

    def _require_alone(self) -> None:
        """A recorder shows no token, which would make it a carrier; but it answers."""
        key = keys.RECORDING.key(self._member.run, self._member.process)
        question = codec.encode(RecorderCommand(id=self._member.boot, kind="status"))
        encoding = codec.encoding_of(RecorderCommand)
        if len(self._member.buses.data.query(key, question, encoding, ATTEMPT_S)) > 1:
            raise BusError(
                f"{self._member.process} records run {self._member.run} already",
                expected="another name, --as NAME",
            )

    def _follow(self, events: Sequence[Liveness]) -> None:
        """Enter who has come: whose gaps are fetched, and whose the run is."""
        up = self._member.buses.control.link_up()
        now_s = time.monotonic()
        self._roster.update(events, up, now_s)
        if self.hub.is_over(up, now_s):
            self._stop = self._stop or "the hub is lost"
        present = set(self._roster.present)
        if present != self._seen:
            self.recorder.lives.show(present, present - self._seen)
            self._met |= {life.process for life in present}
            self._seen = present

    def _is_over(self) -> bool:
        """Whether the run has had a world, and nobody is left who could say more of it."""
        here = {life.process for life in self._seen}
        return keys.WORLD in self._met and not here & {keys.WORLD, keys.FUSION}
