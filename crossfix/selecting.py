"""Which messages of a recording are meant: by time, role and key, with what is latched before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from crossfix.differences.comparison import is_named
from crossfix.differences.pairing import channel_of
from schemas.errors import CrossfixError
from schemas.keys import Role
from schemas.recording.reader import Recorded, Recording

NEVER_NS = 2**64


class Selection(NamedTuple):
    """A part of a recording.

    Attributes:
        start_s, until_s: from the first message of the recording on; None = to its end.
        roles: none = all.
        keys: patterns of keys after the run, such as `report/**`; none = all.
        without: patterns of keys that are left out.
    """

    start_s: float = 0.0
    until_s: float | None = None
    roles: Sequence[Role] = ()
    keys: Sequence[str] = ()
    without: Sequence[str] = ()

    def __str__(self) -> str:
        """As the options of a command line."""
        said = [f"--start {self.start_s:g}"] if self.start_s else []
        said += [f"--until {self.until_s:g}"] if self.until_s is not None else []
        said += [f"--role {role.value}" for role in self.roles]
        said += [f"--keys {pattern}" for pattern in self.keys]
        said += [f"--without {pattern}" for pattern in self.without]
        return " ".join(said) or "everything"

    def wants(self, message: Recorded) -> bool:
        """Whether a message is meant, whatever its time."""
        channel = channel_of(message.key)
        return (
            (not self.roles or message.address.topic.role in self.roles)
            and (not self.keys or is_named(channel, self.keys))
            and not is_named(channel, self.without)
        )


EVERYTHING = Selection()


def start_of(recording: Recording) -> int:
    """Log time [ns] of the first message."""
    return min((span.start_ns for span in recording.index.spans), default=0)


def selected(recording: Recording, selection: Selection) -> Iterator[Recorded]:
    """The messages that are meant, behind the last latched ones of before, in file order.

    Latched messages keep their stamps, but stand at the beginning.

    Raises:
        CrossfixError: a time that is none, or an end before its beginning.
        RecordingError: the recording is damaged.
    """
    start_ns, stop_ns = _times_ns(recording, selection)
    yield from latched_before(recording, selection, start_ns)
    for message in recording.messages(start_ns=start_ns, stop_ns=stop_ns):
        if selection.wants(message):
            yield message


def latched_before(recording: Recording, selection: Selection, start_ns: int) -> list[Recorded]:
    """The last message of each latched key before an instant, as if recorded at that instant."""
    return [
        message._replace(log_time_ns=start_ns)
        for message in recording.latched(start_ns)
        if selection.wants(message)
    ]


def _times_ns(recording: Recording, selection: Selection) -> tuple[int, int]:
    start_s, until_s = selection.start_s, selection.until_s
    if not 0 <= start_s < 1e9 or (until_s is not None and not start_s < until_s < 1e9):
        got = f"{start_s:g} s to {'the end' if until_s is None else f'{until_s:g} s'}"
        raise CrossfixError("no span of time", got=got, expected="--start below --until, from 0 on")
    first_ns = start_of(recording)
    last_ns = max((span.end_ns for span in recording.index.spans), default=0)
    start_ns = first_ns + round(start_s * 1e9)
    if start_ns > last_ns:
        lasts = f"no more than the {(last_ns - first_ns) * 1e-9:g} s it lasts"
        raise CrossfixError("--start is behind the end", got=f"{start_s:g}", expected=lasts)
    return start_ns, NEVER_NS if until_s is None else first_ns + round(until_s * 1e9)
