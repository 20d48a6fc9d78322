"""The whole fusion centre as a function over a recorded sequence of messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from schemas import keys
from schemas.errors import RecordingError
from schemas.messages import Closed, DeclaredScenario, Event, Input

from . import pipeline
from .holding import Holding
from .published import Outputs
from .settings import Settings, settings_from
from .state import State

Fusible = Input | Event | Closed | DeclaredScenario
"""What decides the outputs; nothing else does."""
MOST_WAITING = 1000
"""Closed messages that may wait for one message before it is taken for lost."""

AHEAD = 100
"""Closed messages to wait for before one is fused: a recording holds arrivals in any order."""


def fuse(
    messages: Iterable[Fusible],
    settings: Settings | Mapping[str, Any] | None = None,
    *,
    centre: str = keys.FUSION,
    ahead: int = AHEAD,
) -> Iterator[Outputs]:
    """Fuse a recorded sequence: the outputs of each Closed, in the order of their steps.

    Inputs are held until a Closed names them and forgotten when they are fused, so memory is
    bounded by what is under way. Order and repetitions within the sequence do not matter as long
    as nothing comes more than `ahead` Closed messages too late.

    Args:
        messages: the declared scenario before all else is fused; inputs; events; and the Closed
            messages *of the fusion centre* (`closed/fusion`), not the world's.
        settings: instead of those the scenario declares.
        ahead: how many later Closed messages to wait for before one is fused: events are recorded
            beside the Closed of their step, and perhaps after it.

    Raises:
        RecordingError: a message that a Closed names, a Closed or the scenario never comes, or an
            event comes after its step; all that could be fused before has been yielded.
        SettingsError: the settings are wrong.
    """
    fusion = _Fusion(centre, settings)
    for message in messages:
        fusion.take(message)
        yield from fusion.run(ahead)
    yield from fusion.run(0)
    fusion.must_be_done()


class _Fusion:
    """A pipeline state, and what waits before it."""

    def __init__(self, centre: str, settings: Settings | Mapping[str, Any] | None) -> None:
        self._centre, self._settings = centre, settings
        self._state: State | None = None
        self._held = Holding()
        self._waiting: dict[int, Closed] = {}
        self._step = 0

    def take(self, message: Fusible) -> None:
        """Take one message of the sequence in."""
        if isinstance(message, DeclaredScenario):
            if self._state is None:
                settings = self._chosen(message)
                self._state = pipeline.initial(message, settings, self._centre)
        elif isinstance(message, Closed):
            if message.step > self._step:
                self._waiting.setdefault(message.step, message)
            if len(self._waiting) > MOST_WAITING:
                self.must_be_done()
        elif isinstance(message, Event) and message.step <= self._step:
            raise RecordingError("an event came after its step", where=message.id, got=self._step)
        else:
            self._held.put(message)

    def run(self, ahead: int) -> Iterator[Outputs]:
        """Fuse every Closed that is complete and has `ahead` later ones behind it."""
        while self._state is not None and len(self._waiting) > ahead:
            closed = self._waiting.get(self._next_step())
            if closed is None or self._held.missing(self._state.timeline, closed):
                return
            del self._waiting[closed.step]
            self._step = closed.step
            messages = self._held.release(self._state.timeline, closed)
            self._state, outputs = pipeline.step(self._state, closed, messages)
            yield outputs

    def must_be_done(self) -> None:
        """Refuse to end while something waits.

        Raises:
            RecordingError: says what for.
        """
        if not self._waiting:
            return
        step = self._next_step()
        if self._state is None:
            raise RecordingError("no declared scenario among the messages", got=f"Closed {step}")
        if step not in self._waiting:
            raise RecordingError("a Closed is missing", expected=f"that of step {step}")
        missing = self._held.missing(self._state.timeline, self._waiting[step])
        raise RecordingError("a Closed names a message that never came", where=f"step {step}",
                             got=missing)  # fmt: skip

    def _next_step(self) -> int:
        """Steps follow each other; only a centre that started late begins above 1."""
        return self._step + 1 if self._step else min(self._waiting)

    def _chosen(self, scenario: DeclaredScenario) -> Settings:
        if isinstance(self._settings, Settings):
            return self._settings
        return settings_from(scenario.fusion if self._settings is None else self._settings)
