"""Who is here, who has gone, and what people should be told about it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from schemas import keys
from schemas.bus.interface import Liveness
from schemas.bus.roster import Life, Roster

from ..admission.lives import Lives, twins

MOST_NAMES = 256
"""Names said at a time, and things said once."""
TWIN_S = 3.0
"""The token of a process that hung may stand beside that of its next life for so long."""


class Changes(NamedTuple):
    """What has changed since the last look.

    Attributes:
        come, gone: carriers.
        world_lost: no life of the world is left.
        news: sentences.
    """

    come: list[str]
    gone: list[str]
    world_lost: bool
    news: list[str]


class Attendance:
    """Follows the tokens of a run; time is passed in.

    Args:
        lives: where everybody is entered who shows a token.
    """

    def __init__(self, lives: Lives) -> None:
        self._lives = lives
        self._roster = Roster()
        self._seen: set[Life] = set()
        self._here: set[str] = set()
        self._lost: dict[str, None] = {}
        self._twins: dict[str, float] = {}
        self._told: set[str] = set()

    @property
    def here(self) -> list[str]:
        """Carriers that are here, the first of them by name."""
        return sorted(self._here)[:MOST_NAMES]

    @property
    def lost(self) -> list[str]:
        """Carriers that have gone and not come back, the newest of them."""
        return sorted(list(self._lost)[-MOST_NAMES:])

    def update(self, events: Iterable[Liveness], link_up: bool, now_s: float) -> Changes:
        """Take in what was heard of tokens."""
        lost = self._roster.update(events, link_up, now_s)
        present = self._roster.present
        refused = self._enter(present)
        news = self._once(f"no room for {life.process}, boot {life.boot}" for life in refused)
        carriers = {life.process for life in self._seen} - set(keys.RESERVED_PROCESSES)
        gone, come = sorted(self._here - carriers), sorted(carriers - self._here)
        replaced = sorted({life.process for life in lost} & self._here & carriers)
        self._here = carriers
        for carrier in gone:
            self._lost[carrier] = None
            news.append(f"carrier {carrier} is lost: its liveliness token is gone")
        for carrier in replaced:  # it came back before its loss was noticed
            news.append(
                f"carrier {carrier} is lost: the token of one boot is gone, another is here"
            )
        for carrier in come:
            self._lost.pop(carrier, None)
            news.append(f"carrier {carrier} has come")
        news += self._once(self._same_names(present, now_s))
        world_lost = any(life.process == keys.WORLD for life in lost)
        return Changes(come, gone, world_lost and not self._roster.has(keys.WORLD), news)

    def strangers(self, waiting: Iterable[Life]) -> list[str]:
        """Sentences about those who publish without a token, each once."""
        names = {life.process for life in waiting if life not in self._lives}
        return self._once(
            f"another life publishes as {name}, but shows no liveliness token: not fused"
            if self._lives.has(name)
            else f"{name} publishes, but shows no liveliness token alive/{name}/BOOT: not fused"
            for name in sorted(names)
        )

    def _enter(self, present: set[Life]) -> list[Life]:
        """Enter who has come; those there was no room for."""
        if present == self._seen:
            return []
        refused = self._lives.show(present, present - self._seen)
        self._seen = present - set(refused)
        return refused

    def _same_names(self, present: set[Life], now_s: float) -> list[str]:
        """Two processes with one name speak in turns, and nobody can tell which is meant."""
        found = twins(present)
        self._twins = {name: self._twins.get(name, now_s) for name in found}
        return [
            f"{len(found[name])} processes are called {name}, boots {', '.join(found[name][:4])}: "
            "end all but one, or give them other names"
            for name, since_s in self._twins.items()
            if now_s - since_s > TWIN_S
        ]

    def _once(self, sentences: Iterable[str]) -> list[str]:
        new = [sentence for sentence in sentences if sentence not in self._told]
        if len(self._told) < MOST_NAMES:
            self._told.update(new)
            return new
        return []
