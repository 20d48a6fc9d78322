"""Decides which Closed comes next, and when: from the world's in lock-step, from the clock else."""

from __future__ import annotations

from typing import Protocol

from msgspec.structs import replace

from schemas import keys
from schemas.bus.ledger import StreamKey
from schemas.bus.recovery import Gap
from schemas.messages import Closed, DeclaredScenario, Step, StreamEnd, StreamSpan

from ..admission.steps import instant_ns
from .ingest import Ingest

PATIENCE_S = 5.0
"""A paced step that is due waits no longer than this for known gaps: nobody may stop the clock."""
WINDOW = 64
"""The world closes no step so far ahead of the fusion: it waits for its acknowledgement."""
HELD_BACK_NS = 60 * 10**9
"""A stamp further ahead of the newest granted step is wrong, and its message waits for nothing."""


class Closing(Protocol):
    """What the node asks in every turn of its loop."""

    def gaps(self) -> list[Gap]:
        """What must be fetched before the next Closed can be fused."""

    def give_up(self, gap: Gap) -> None:
        """A gap cannot be had."""

    def on_joined(self, carrier: str) -> None:
        """A carrier has come."""

    def on_lost(self, carrier: str) -> None:
        """A carrier is gone."""

    def next(self, now_s: float) -> Closed | None:
        """The next Closed if everything it names is here or given up."""


class LockstepClosing:
    """Fuses the world's Closed messages in their order, each when it is complete.

    The world names the carriers that answer steps. Others are guests: what they have sent by then
    is added, and whether they take part is said here.
    """

    def __init__(self, scenario: DeclaredScenario, ingest: Ingest) -> None:
        self._scenario, self._ingest = scenario, ingest
        self._max_error_ns = round(scenario.max_clock_error_s * 1e9)
        self._waiting: dict[int, Closed] = {}
        self._step = 0
        self._granted = 0
        self._gave_up: list[StreamSpan] = []
        self._present: set[str] = set()
        self._members: set[str] = set()
        self._guests: set[str] = set()

    def on_closed(self, closed: Closed) -> str:
        """Take in what the world has closed; why it cannot have been the world, else empty."""
        if closed.step > min(self._scenario.steps, self._step + WINDOW):
            return f"closes step {closed.step}, the fusion being at {self._step}"
        if closed.t_ns != instant_ns(self._scenario, closed.step):
            return f"closes step {closed.step} at another instant than its own"
        if closed.step > self._step and self._waiting.setdefault(closed.step, closed) != closed:
            return f"step {closed.step} is closed already, and otherwise"
        return ""

    def on_step(self, step: Step, now_s: float) -> None:
        """A granted step says that all before it are closed."""
        del now_s
        self._granted = max(self._granted, step.step if step.ended else step.step - 1)

    def on_joined(self, carrier: str) -> None:
        """A carrier has come; a guest takes part from its first message on."""
        self._present.add(carrier)

    def on_lost(self, carrier: str) -> None:
        """A carrier is gone."""
        self._present.discard(carrier)

    def gaps(self) -> list[Gap]:
        """The next Closed itself or the messages it names, and what guests have lost."""
        return [*self._needed(), *self._ingest.gaps(only_stepless=True)]

    def _needed(self) -> list[Gap]:
        closed = self._waiting.get(self._step + 1)
        if closed is not None:
            return self._ingest.missing(closed.manifest)
        newest = max(self._granted, max(self._waiting, default=0))
        if newest <= self._step:
            return []
        return [(StreamKey(keys.WORLD, "", keys.CLOSED_WORLD.template), self._step + 1, newest)]

    def give_up(self, gap: Gap) -> None:
        """A message is gone for good; a Closed of the world never is while the world lives."""
        if gap[0].process != keys.WORLD:
            self._gave_up.append(self._ingest.give_up(gap))

    def next(self, now_s: float) -> Closed | None:
        """The world's next Closed less what is given up, plus publishers that answer no steps."""
        del now_s
        closed = self._waiting.get(self._step + 1)
        if closed is None or self._ingest.missing(closed.manifest):
            return None
        del self._waiting[closed.step]
        self._step = closed.step
        others = self._guests_ends(closed)
        come, gone = self._mind_guests(closed, {end.carrier for end in others})
        gave_up, self._gave_up = self._gave_up, []
        return replace(
            closed,
            manifest=closed.manifest + others,
            gave_up=gave_up,
            late=self._ingest.late(),
            joined=closed.joined + come,
            lost=closed.lost + gone,
        )

    def _guests_ends(self, closed: Closed) -> list[StreamEnd]:
        """How far publishers have come that answer no steps; a member's answer speaks for it."""
        members = (self._members | set(closed.joined)) - set(closed.lost)
        until_ns = closed.t_ns + self._max_error_ns
        newest_ns = instant_ns(self._scenario, self._granted + 1)
        ends = self._ingest.ends(until_ns, True, newest_ns + self._max_error_ns + HELD_BACK_NS)
        return [end for end in ends if end.carrier not in members]

    def _mind_guests(self, closed: Closed, heard: set[str]) -> tuple[list[str], list[str]]:
        """Guests that take part from this Closed on, and those that no longer do."""
        self._members = (self._members | set(closed.joined)) - set(closed.lost)
        self._guests -= self._members
        come = (heard & self._present) - self._members - self._guests
        gone = self._guests - self._present
        self._guests = (self._guests | come) - gone
        return sorted(come), sorted(gone)


class PacedClosing:
    """Closes every step of the scenario a fixed time after it was granted, with what is here.

    A gap below a message that has come is waited for until it is filled or hopeless, within
    `PATIENCE_S`; a message that nobody knows of yet is not.
    """

    def __init__(self, scenario: DeclaredScenario, ingest: Ingest, lateness_s: float) -> None:
        self._scenario, self._ingest, self._lateness_s = scenario, ingest, lateness_s
        self._max_error_ns = round(scenario.max_clock_error_s * 1e9)
        self._due_s: dict[int, float] = {}
        self._step = 0
        self._gave_up: list[StreamSpan] = []
        self._lost: list[str] = []
        self._joined: list[str] = []

    def on_step(self, step: Step, now_s: float) -> None:
        """The wall clock has reached a step; those before it that were not heard of are due too."""
        for number in range(max(self._due_s, default=self._step) + 1, step.step + 1):
            self._due_s[number] = now_s + self._lateness_s

    def on_joined(self, carrier: str) -> None:
        """A carrier has come."""
        self._joined.append(carrier)

    def on_lost(self, carrier: str) -> None:
        """A carrier is gone."""
        self._lost.append(carrier)

    def gaps(self) -> list[Gap]:
        """Every gap below a message that has come."""
        return self._ingest.gaps()

    def give_up(self, gap: Gap) -> None:
        """Close without it."""
        self._gave_up.append(self._ingest.give_up(gap))

    def next(self, now_s: float) -> Closed | None:
        """The next step once it is due and no known gap is open."""
        number = self._step + 1
        due_s = self._due_s.get(number, float("inf"))
        if now_s < due_s or (now_s < due_s + PATIENCE_S and self._ingest.gaps()):
            return None
        newest_ns = instant_ns(self._scenario, max(self._due_s))
        del self._due_s[number]
        self._step = number
        t_ns = instant_ns(self._scenario, number)
        far_ns = newest_ns + self._max_error_ns + HELD_BACK_NS
        closed = Closed(
            step=number,
            t_ns=t_ns,
            manifest=self._ingest.ends(t_ns + self._max_error_ns, False, far_ns),
            late=self._ingest.late(),
            gave_up=self._gave_up,
            joined=self._joined,
            lost=self._lost,
            final=number == self._scenario.steps,
        )
        self._gave_up, self._lost, self._joined = [], [], []
        return closed
