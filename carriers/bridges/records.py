"""What a decoder makes of a feed: readings, and records that it had to refuse."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from schemas import keys
from schemas.errors import WireError

from .feeds import Arrival


class Reading(NamedTuple):
    """One message of a feed, but for its envelope; nothing of it has been checked yet.

    Attributes:
        topic: SOURCE, REPORT, NAVIGATION or RANGING.
        fields: of the message, by their names on the wire.
        source: id of the source, of SOURCE and REPORT.
        t_ns: when it holds; None = when it came.
    """

    topic: keys.Topic
    fields: dict[str, Any]
    source: str = ""
    t_ns: int | None = None


class RecordError(WireError):
    """A record that cannot be published, with the name of the field that is to blame."""

    def __init__(self, field: str, what: str, *, got: object = None, expected: str = "") -> None:
        self.field = field
        super().__init__(what, where=field, got=got, expected=expected)


Decoder = Callable[[Arrival], Iterable[Reading | RecordError]]
"""Understands what has arrived; a bad record costs itself and nothing else."""
