"""Counts of what became of every stream's messages, with the last reason of those refused."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.messages import StreamStatistics

from .lives import Known

MAX_ROWS = 4096
MAX_STRANGE_ROWS = 256
OTHERS = "others"
"""Carrier and stream of all there is no row of their own for."""
UNKNOWN = "unknown"
"""Carrier and stream of what has no key that could be understood."""
MAX_COUNT = 2**62
MAX_REASON = 200
MAX_TOLD = 100


@dataclass(slots=True)
class _Row:
    received: int = 0
    duplicates: int = 0
    gaps: int = 0
    gave_up: int = 0
    late: int = 0
    rejected: int = 0
    unclaimed: int = 0
    reason: str = ""


class StreamCounts:
    """A row of counts by carrier and stream; who takes part in the run always gets one.

    Names come from the wire and may be anything: beyond some hundreds strangers share one row.

    Attributes:
        rejected: messages refused, over all streams; other threads may read it.
    """

    def __init__(self, known: Known) -> None:
        self.rejected = 0
        self._known = known
        self._rows: dict[tuple[str, str], _Row] = {}

    def add(self, carrier: str, stream: str, **counts: int) -> None:
        """Add to the counts of a stream."""
        row = self._row(carrier, stream)
        for name, count in counts.items():
            setattr(row, name, min(MAX_COUNT, getattr(row, name) + count))

    def refuse(self, carrier: str, stream: str, reason: str) -> bool:
        """Count a message that is refused; whether it is worth a line in the log.

        The first of a stream is, the tenth, the hundredth: a flood must not flood the log.
        """
        row = self._row(carrier, stream)
        self.rejected += 1
        row.rejected = min(MAX_COUNT, row.rejected + 1)
        row.reason = reason[:MAX_REASON]
        return row.rejected in _POWERS

    def rejections(self) -> dict[str, str]:
        """How many were refused by carrier/stream, the most first, each with the last reason."""
        refused = [(row.rejected, *name, row.reason) for name, row in self._rows.items()]
        most_first = sorted((item for item in refused if item[0]), key=lambda item: -item[0])
        return {
            f"{carrier}/{stream}": f"{count}, the last: {reason}"
            for count, carrier, stream, reason in most_first[:MAX_TOLD]
        }

    def statistics(self) -> list[StreamStatistics]:
        """Every row, by name."""
        return [
            StreamStatistics(
                carrier=carrier,
                stream=stream,
                received=row.received,
                duplicates=row.duplicates,
                gaps=row.gaps,
                gave_up=row.gave_up,
                late=row.late,
                rejected=row.rejected,
                unclaimed=row.unclaimed,
                reason=row.reason,
            )
            for (carrier, stream), row in sorted(self._rows.items())
        ]

    def _row(self, carrier: str, stream: str) -> _Row:
        name = (carrier, stream)
        row = self._rows.get(name)
        if row is None:
            most = MAX_ROWS if self._known.has(carrier) else MAX_STRANGE_ROWS
            if len(self._rows) >= most:
                name = (OTHERS, OTHERS)
            row = self._rows.setdefault(name, _Row())
        return row


_POWERS = frozenset(10**n for n in range(19))
