"""What a replay plays: which messages of a recording, in which order, between which instants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from schemas.errors import CrossfixError
from schemas.keys import Role
from schemas.recording.reader import Recorded, Recording
from schemas.recording.recorded import log_time_ns, stamp_ns

NS = 10**9
NEVER_NS = 2**64 - 1
INPUTS = (Role.INPUT,)


class Choice(NamedTuple):
    """Which messages, and between which instants after the first one of the recording [s].

    Attributes:
        by_stamp: in the order of the senders' stamps instead of that of their arrival; times are
            stamps then.
    """

    roles: tuple[Role, ...] = INPUTS
    start_s: float = 0.0
    until_s: float | None = None
    duration_s: float | None = None
    by_stamp: bool = False


class Playlist:
    """The messages of a choice, from any instant on.

    Attributes:
        start_ns, end_ns: time of the first message and of the last; equal where there is none.
        first_ns, stop_ns: what is chosen of that, `stop_ns` excluded.

    Raises:
        CrossfixError: the choice ends before it begins, or begins after the recording's end.
        RecordingError: the recording is damaged.
    """

    def __init__(self, recording: Recording, choice: Choice) -> None:
        self._recording, self._choice = recording, choice
        self.time_ns = stamp_ns if choice.by_stamp else log_time_ns
        self.start_ns, self.end_ns = self._bounds()
        self.first_ns = self.start_ns + round(choice.start_s * NS)
        self.stop_ns = self._stop_ns()
        if self.first_ns > self.end_ns or self.stop_ns <= self.first_ns:
            raise CrossfixError(
                "nothing to replay",
                got=f"from {choice.start_s:g} s on",
                expected=f"within the {(self.end_ns - self.start_ns) / NS:.1f} s of the recording",
            )

    def before(self, t_ns: int) -> list[Recorded]:
        """The last value of every latched key before an instant: what who comes late must know."""
        if t_ns <= self.start_ns:
            return []
        return self._recording.latched(t_ns, roles=self._choice.roles)

    def messages(self, t_ns: int) -> Iterator[Recorded]:
        """Those from an instant on, in their order; those of one time in the order of the file."""
        return self._recording.messages(
            roles=self._choice.roles,
            order="stamp" if self._choice.by_stamp else "log_time",
            start_ns=t_ns,
            stop_ns=self.stop_ns,
        )

    def within(self, t_ns: int) -> int:
        """An instant, or the nearest one that is chosen."""
        return min(max(t_ns, self.first_ns), self.stop_ns)

    def _bounds(self) -> tuple[int, int]:
        if self._choice.by_stamp:
            first = last = None
            for last in self._recording.messages(roles=self._choice.roles, order="stamp"):
                first = first or last
            return (stamp_ns(first), stamp_ns(last)) if first and last else (0, 0)
        spans = self._recording.index.spans
        return (
            min((span.start_ns for span in spans), default=0),
            max((span.end_ns for span in spans), default=0),
        )

    def _stop_ns(self) -> int:
        stops = [NEVER_NS]
        if self._choice.until_s is not None:
            stops.append(self.start_ns + round(self._choice.until_s * NS))
        if self._choice.duration_s is not None:
            stops.append(self.first_ns + round(self._choice.duration_s * NS))
        return min(stops)
