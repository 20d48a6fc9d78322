"""What is wanted of a run, and what became of the samples of every key."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from schemas import keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.key_expressions import chunks_of, intersects
from schemas.bus.ledger import StreamKey
from schemas.errors import CrossfixError, WireError
from schemas.messages import KeyStatistics

from ..admission.counts import MAX_COUNT

MAX_ROWS = 4096
OTHERS = "others"
"""Row of the keys there is no row of their own for, and of what is no key."""


class Wanted(NamedTuple):
    """Which keys are recorded: all that match an inclusion and no exclusion.

    Attributes:
        include, exclude: key expressions after the run, such as `report/**`; without an inclusion
            everything is included.
        pattern: a regular expression that the key after the run must contain as well.
    """

    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    pattern: str = ""

    def has(self, key: str) -> bool:
        """Whether a key of this protocol is wanted."""
        within = key.split("/", 3)[3]
        included = not self.include or any(intersects(one, within) for one in self.include)
        excluded = any(intersects(one, within) for one in self.exclude)
        return included and not excluded and re.search(self.pattern, within) is not None


def require_wanted(wanted: Wanted) -> Wanted:
    """Return a choice of keys whose expressions all mean something.

    Raises:
        CrossfixError: one does not.
    """
    for expression in (*wanted.include, *wanted.exclude):
        chunks_of(expression)
    try:
        re.compile(wanted.pattern)
    except re.error as error:
        raise CrossfixError("no regular expression", got=str(error), where=wanted.pattern) from None
    return wanted


EVERYTHING = Wanted()


@dataclass(slots=True)
class Row:
    """The counts of a key; its own are added to by the recorder's thread alone.

    Attributes:
        address: None in the row of others.
    """

    key: str
    address: keys.Address | None
    wanted: bool
    received: int = 0
    recorded: int = 0
    gaps: int = 0
    dropped: int = 0
    rejected: int = 0
    repeated: int = 0
    passed_over: int = 0

    def statistics(self, dropped: int) -> KeyStatistics:
        """For the wire, with what its queue has dropped besides."""
        return KeyStatistics(
            key=self.key,
            received=self.received + dropped,
            recorded=self.recorded,
            gaps=self.gaps,
            dropped=self.dropped + dropped,
            rejected=self.rejected,
            repeated=self.repeated,
            passed_over=self.passed_over,
        )


class Queue(Inbox[Sample]):
    """An inbox that knows of which keys it has dropped samples."""

    def __init__(self, max_bytes: int, gather_s: float = 0.0) -> None:
        super().__init__(max_bytes, gather_s)
        self.dropped: Counter[str] = Counter()

    def on_drop(self, item: Sample) -> None:
        """Count it."""
        known = item.key in self.dropped or len(self.dropped) < MAX_ROWS
        self.dropped[item.key if known else OTHERS] += 1


class Rows:
    """A row for every key, as far as there is room."""

    def __init__(self, wanted: Wanted = EVERYTHING) -> None:
        self._wanted = wanted
        self._rows: dict[str, Row] = {}
        self._keys: dict[StreamKey, str] = {}
        self._told: dict[str, KeyStatistics] = {}
        self._others = Row(OTHERS, None, wanted=True)

    def row(self, key: str) -> Row:
        """The row of a key; that of the others for a key that is none of the protocol."""
        found = self._rows.get(key)
        return found if found is not None else self._new(key)

    def bind(self, stream: StreamKey, key: str) -> None:
        """Note where the messages of a stream travel, so that its gaps are counted there."""
        if stream not in self._keys and len(self._keys) < MAX_ROWS:
            self._keys[stream] = key

    def gap(self, stream: StreamKey, count: int) -> None:
        """Count messages that nobody has."""
        row = self.row(self._keys.get(stream, OTHERS))
        row.gaps = min(MAX_COUNT, row.gaps + count)

    def lose(self, unwritten: Mapping[str, int]) -> None:
        """Take back messages that the disk did not take, by key."""
        for key, count in unwritten.items():
            row = self.row(key)
            row.recorded -= count
            row.dropped += count

    def wants(self, address: keys.Address, key: str) -> bool:
        """Whether the messages of a key are to be recorded."""
        return address.topic.recorded and self._wanted.has(key)

    def wants_stream(self, run: str, stream: StreamKey) -> bool:
        """Whether any message of a carrier's stream is to be recorded."""
        try:
            key = keys.of_stream(run, stream.process, stream.stream)
        except WireError:
            return True  # whatever that is, it is missed
        return key is None or self._wanted.has(key)

    def statistics(self, dropped: Mapping[str, int]) -> list[KeyStatistics]:
        """Every key with a count, by name; `dropped` is what the queue has lost."""
        lost = Counter[str]()
        for key, count in dict(dropped).items():
            lost[self.row(key).key] += count
        rows = sorted((*self._rows.values(), self._others), key=lambda row: row.key)
        return [row.statistics(lost[row.key]) for row in rows if row.received or lost[row.key]]

    def news(self, dropped: Mapping[str, int]) -> list[KeyStatistics]:
        """Those that have changed since the last call."""
        changed = [one for one in self.statistics(dropped) if self._told.get(one.key) != one]
        self._told.update((one.key, one) for one in changed)
        return changed

    def _new(self, key: str) -> Row:
        try:
            address = keys.parse(key)
        except WireError:
            return self._others
        if len(self._rows) >= MAX_ROWS:
            return self._others
        row = self._rows[key] = Row(key, address, self.wants(address, key))
        return row
