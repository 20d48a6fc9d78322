"""Who takes part in a run, by liveliness tokens, and who is really gone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from .. import keys
from ..errors import WireError
from .interface import Liveness

GRACE_S = 0.2
"""A token may go a moment before one's own lost link is noticed."""
MAX_PRESENT = 4096
"""Tokens beyond this are not followed."""
RELINK_S = 3.0
"""After one's own link is back, a token has this long to reappear."""


class Life(NamedTuple):
    """One boot of one process."""

    process: str
    boot: str


@dataclass
class Roster:
    """Keeps the lives of a run from token events; time is passed in.

    A token that goes while one's own link to the hub is down is no loss; it becomes one if it is
    still absent 3 s after the link is back.
    """

    present: set[Life] = field(default_factory=set)
    _going: dict[Life, float] = field(default_factory=dict)
    _linked_s: float = float("-inf")
    _was_up: bool = True

    def update(self, events: Iterable[Liveness], link_up: bool, now_s: float) -> list[Life]:
        """Take in what came, and return the lives lost since the last call."""
        if link_up and not self._was_up:
            self._linked_s = now_s
        self._was_up = link_up
        for event in events:
            self._note(event, now_s)
        if not link_up:
            return []
        lost = [life for life, gone_s in self._going.items() if self._is_lost(gone_s, now_s)]
        for life in lost:
            del self._going[life]
            self.present.discard(life)
        return lost

    def boots(self, process: str) -> list[str]:
        """Boots of a process that are here; more than one means two processes with one name."""
        return sorted(life.boot for life in self.present if life.process == process)

    def has(self, process: str) -> bool:
        """Whether any boot of a process is here."""
        return any(life.process == process for life in self.present)

    def _note(self, event: Liveness, now_s: float) -> None:
        try:
            _, process, boot = keys.parse_alive(event.key)
        except WireError:
            return
        life = Life(process, boot)
        if event.alive:
            if len(self.present) < MAX_PRESENT:
                self.present.add(life)
            self._going.pop(life, None)
        elif life in self.present:
            self._going.setdefault(life, now_s)
            if not event.link_up:
                self._linked_s = max(self._linked_s, now_s)

    def _is_lost(self, gone_s: float, now_s: float) -> bool:
        went_with_link = gone_s <= self._linked_s + GRACE_S
        return now_s - max(gone_s, self._linked_s) > (RELINK_S if went_with_link else GRACE_S)
