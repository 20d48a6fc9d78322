"""Which messages a recording lacks, who may have them, and when to stop asking."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from schemas.bus.interface import Inbox, Sample
from schemas.bus.ledger import Ledger, Seen, StreamKey
from schemas.bus.member import Member
from schemas.bus.recovery import Gap, Recovery
from schemas.bus.roster import Life
from schemas.errors import WireError

from ..admission.counts import MAX_COUNT
from ..admission.lives import Known
from .rows import Rows

log = logging.getLogger("recorder")

PATIENCE_S = 30.0
"""Nobody waits for a gap in a recording, so it is asked for as long as its owner may have it."""

AT_ONCE = 400
"""Messages of a stream that one question spans, those that are here included."""


class Gaps:
    """Accounts for every message of those who take part, and fetches what is missing.

    Attributes:
        never_had: messages that nobody had any more.
        expected: the last message of each stream, once it is known.
        all_heard: whatever has come of those who take part is to be without a gap as well.
    """

    def __init__(self, member: Member, inbox: Inbox[Sample], lives: Known, rows: Rows) -> None:
        self.never_had = 0
        self.all_heard = False
        self.expected: Mapping[StreamKey, int] = {}
        self._lives, self._rows = lives, rows
        self._ledger = Ledger()
        self._recovery = Recovery(member.run, member.buses.data, inbox, PATIENCE_S)

    @property
    def fetched(self) -> int:
        """Messages that were missed on the way and fetched again."""
        return self._recovery.fetched

    @property
    def is_whole(self) -> bool:
        """Whether everything expected is here or given up."""
        if self.all_heard and any(self._is_missed(gap[0]) for gap in self._ledger.gaps()):
            return False
        return all(self._ledger.through(key) >= last for key, last in self.expected.items())

    def forget(self, stream: StreamKey) -> None:
        """Know nothing of a stream any more."""
        self._ledger.forget(stream)

    def follower(self, stream: StreamKey) -> Callable[[int], bool]:
        """Accounts for the message after all that have come, as nearly every one is.

        It holds until the stream is forgotten.
        """
        return self._ledger.follower(stream)

    def is_repeated(self, stream: StreamKey, seq: int, key: str) -> bool:
        """Account for a message; whether it has been here.

        Raises:
            WireError: it cannot be accounted for.
        """
        if self._ledger.is_absurd(stream, seq):
            raise WireError(f"seq jumps from {self._ledger.highest(stream)}", got=seq)
        self._rows.bind(stream, key)
        seen = self._ledger.note(stream, seq)
        if seen is Seen.REFUSED:
            raise WireError("more gaps in seq than can be remembered", got=seq)
        return seen is Seen.DUPLICATE

    def pursue(self, given_up: Sequence[Gap] = ()) -> None:
        """Ask for what is missing; count what nobody has."""
        asked = _together(self._open())
        hopeless = self._recovery.pursue([one.gap for one in asked.values()], time.monotonic())
        for key, first, _ in hopeless:
            self._give_up(key, first, asked[key].first_span_last)
        for gap in given_up:
            self._give_up(*gap)

    def conclude(self) -> None:
        """Count whatever is missing still: there is no more time to ask for it."""
        for gap in self._open():
            self._give_up(*gap)

    def close(self) -> None:
        """Ask no more."""
        self._recovery.close()

    def _open(self) -> list[Gap]:
        """Everything missing of those who take part, and of what is expected."""
        gaps = [gap for gap in self._ledger.gaps() if self._is_missed(gap[0])]
        for key, last in self.expected.items():
            gaps += [(key, *span) for span in self._ledger.missing(key, last)]
        return gaps

    def _give_up(self, key: StreamKey, first: int, last: int) -> None:
        for start, end in self._ledger.missing(key, last):
            if end >= first:
                missed = end - max(start, first) + 1
                self.never_had = min(MAX_COUNT, self.never_had + missed)
                self._rows.gap(key, missed)
                log.warning("never had: %s %s %d..%d", key.process, key.stream, start, end)
        self._ledger.give_up(key, first, last)

    def _is_missed(self, stream: StreamKey) -> bool:
        return not stream.boot or Life(stream.process, stream.boot) in self._lives


class _Asked(NamedTuple):
    """What is asked of a stream at once: its first gap, and what follows closely."""

    gap: Gap
    first_span_last: int


def _together(gaps: Iterable[Gap]) -> dict[StreamKey, _Asked]:
    """One question a stream: where messages are lost here and there, each one takes its time."""
    asked: dict[StreamKey, _Asked] = {}
    for key, first, last in gaps:
        before = asked.get(key)
        if before is None:
            asked[key] = _Asked((key, first, last), last)
        elif last < before.gap[1] + AT_ONCE:
            asked[key] = before._replace(gap=(key, before.gap[1], last))
    return asked
