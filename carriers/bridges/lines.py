"""Bytes to lines, whatever pieces they come in."""

from __future__ import annotations

from .feeds import Arrival

MAX_LINE_BYTES = 1024 * 1024


class Lines:
    """Puts the pieces of every connection together; blank lines are none.

    What a connection left unfinished when it ended is a line too: a file may lack its last
    newline, and a decoder knows half a record from a whole one. Of a line that is too long the
    beginning is handed out, to be refused, and the rest skipped.
    """

    def __init__(self, max_bytes: int = MAX_LINE_BYTES) -> None:
        self._max_bytes = max_bytes
        self._tails: dict[int, bytes] = {}
        self._skipping: set[int] = set()

    def split(self, arrival: Arrival) -> list[bytes]:
        """The lines that are complete with this arrival."""
        origin = arrival.origin
        *lines, tail = (self._tails.pop(origin, b"") + arrival.data).split(b"\n")
        if origin in self._skipping and (lines or arrival.ended):
            self._skipping.discard(origin)
            lines = lines[1:]
        if arrival.whole or arrival.ended:
            lines.append(tail)
        elif origin not in self._skipping:
            if len(tail) > self._max_bytes:
                lines.append(tail)
                self._skipping.add(origin)
            else:
                self._tails[origin] = tail
        return [line[: self._max_bytes] for line in lines if not line.isspace() and line]
