"""Which lives of the carriers speak: one after the other, and with a token, or not."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from .findings import Notes

REMEMBERED = 8
LEAST_TURNS = 3
"""An earlier life may be heard once more when it is over; so often it is not over."""


class Life(NamedTuple):
    """One boot of one carrier."""

    carrier: str
    boot: str


class Speakers:
    """Follows who is heard, and whose tokens are seen."""

    def __init__(self) -> None:
        self._recent: dict[str, list[str]] = {}
        self._turns: dict[str, tuple[int, str]] = {}
        self._began: set[Life] = set()
        self._tokens: set[Life] | None = None

    def heard(self, life: Life) -> None:
        """A message of a life; when an earlier one speaks again, there are two."""
        boots = self._recent.setdefault(life.carrier, [])
        if life.boot in boots[:-1]:
            now = f"boot {life.boot} speaks again after boot {boots[-1]}"
            count, first = self._turns.get(life.carrier, (0, now))
            self._turns[life.carrier] = (count + 1, first)
            boots.remove(life.boot)
        if life.boot not in boots:
            boots.append(life.boot)
            del boots[:-REMEMBERED]

    def began(self, life: Life) -> None:
        """Its token came while we listened."""
        self._began.add(life)

    def saw_tokens(self, lives: Iterable[tuple[str, str]]) -> None:
        """Whose tokens are there; call it again for more."""
        self._tokens = (self._tokens or set()) | {Life(*life) for life in lives}

    def is_new(self, life: Life) -> bool:
        """Whether it began while we listened."""
        return life in self._began

    def judge(self, notes: Notes, lives: Iterable[Life]) -> None:
        """Say who has a twin, and who of those heard shows no token."""
        for carrier, (count, first) in self._turns.items():
            if count >= LEAST_TURNS:
                notes.add("two_processes", carrier, "", first, count=count)
        for life in lives:
            if self._tokens is not None and life not in self._tokens:
                notes.add("token", life.carrier, "", f"boot {life.boot} shows none")
