"""Recordings of one run put together: side by side in time, or one behind the other."""

from __future__ import annotations

import heapq
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from crossfix.making import Made, attachments_of, header_of, is_torn, made, put, writing
from crossfix.reading_progress import Show, unseen
from schemas.errors import RecordingError
from schemas.recording.contents import Attachment, RunEnd, RunHeader
from schemas.recording.reader import Recorded, Recording

REMEMBERED = 200_000
"""A message that both of two recordings hold is known again within so many others."""
_Name = tuple[str, int, int]


class Joined(NamedTuple):
    """What was put together; `repeated` messages were in more than one and are there once."""

    made: Made
    repeated: int


def merge(
    recordings: Sequence[Recording],
    path: Path,
    names: Sequence[str] = (),
    show: Show = unseen,
) -> Joined:
    """Write recordings of one run, such as those of two recorders, as one, in order of log time.

    Args:
        names: what the new recording says it was made of.

    Raises:
        RecordingError: of different runs, or they disagree about a message; damaged.
        LaunchError: `path` exists or cannot be made.
    """
    streams = [recording.messages(order="log_time") for recording in recordings]
    in_order = heapq.merge(*streams, key=lambda message: message.log_time_ns)
    header = _header(recordings, "merge", names)
    return _written(recordings, in_order, path, header, show)


def join(
    recordings: Sequence[Recording],
    path: Path,
    names: Sequence[str] = (),
    show: Show = unseen,
) -> Joined:
    """Write the parts of a recording, each of which begins where the one before ends, as one.

    What a part repeats of the latched state of the one before is left out.

    Args:
        names: what the new recording says it was made of.

    Raises:
        RecordingError: of different runs, or one begins before the end of the one before; damaged.
        LaunchError: `path` exists or cannot be made.
    """
    header = _header(recordings, "cat", names)
    return _written(recordings, _one_by_one(recordings), path, header, show)


def _written(
    recordings: Sequence[Recording],
    messages: Iterable[Recorded],
    path: Path,
    header: RunHeader,
    show: Show,
) -> Joined:
    _require_one_run(recordings)
    once = _Once()
    count = 0
    with writing(path, header, _attachments(recordings)) as writer:
        for message in messages:
            if once.is_new(message):
                put(writer, message)
                count += 1
                show(count, message.log_time_ns)
        writer.close(_end(recordings, count))
    return Joined(made(path, count), once.repeated)


def _one_by_one(recordings: Sequence[Recording]) -> Iterator[Recorded]:
    end_ns = 0
    for recording in recordings:
        spans = recording.index.spans
        start_ns = min((span.start_ns for span in spans), default=end_ns)
        if start_ns < end_ns:
            raise RecordingError(
                "begins before the end of the one before",
                where=recording.header.run,
                got=f"{(end_ns - start_ns) * 1e-9:.3f} s before",
                expected="parts in their order; crossfix merge for what overlaps",
            )
        yield from recording.messages()
        end_ns = max((span.end_ns for span in spans), default=end_ns)


class _Once:
    """Knows what has passed."""

    def __init__(self) -> None:
        self.repeated = 0
        self._passed: OrderedDict[_Name, bytes] = OrderedDict()
        self._latched: dict[str, tuple[_Name, bytes]] = {}

    def is_new(self, message: Recorded) -> bool:
        """Whether a message has not passed yet.

        Raises:
            RecordingError: another one has passed under its name.
        """
        name = (message.key, message.sequence, message.publish_time_ns)
        digest = blake2b(message.payload, digest_size=16).digest()
        passed = self._passed.get(name)
        if passed is None and self._latched.get(message.key) != (name, digest):
            self._remember(message, name, digest)
            return True
        if passed not in (None, digest):
            raise RecordingError(
                "the recordings disagree",
                where=f"{message.key}, seq {message.sequence}",
                expected="recordings of one run; crossfix diff shows in what two differ",
            )
        self.repeated += 1
        return False

    def _remember(self, message: Recorded, name: _Name, digest: bytes) -> None:
        self._passed[name] = digest
        if len(self._passed) > REMEMBERED:
            self._passed.popitem(last=False)
        if message.address.topic.latched:
            self._latched[message.key] = (name, digest)


def _require_one_run(recordings: Sequence[Recording]) -> None:
    first = recordings[0]
    for other in recordings[1:]:
        if other.header.run != first.header.run:
            raise RecordingError(
                "of another run",
                where=other.header.run,
                expected=f"recordings of {first.header.run}",
            )
        if other.scenario != first.scenario:
            raise RecordingError(
                "of another scenario, or fused with other settings",
                where=other.header.run,
                expected="recordings of one run",
            )


def _header(recordings: Sequence[Recording], verb: str, names: Sequence[str]) -> RunHeader:
    if not recordings:
        raise RecordingError("nothing to put together", expected="at least one recording")
    told = {"verb": verb, "of": ", ".join(names)}
    return replace(header_of(recordings[0], told), part=0)


def _attachments(recordings: Sequence[Recording]) -> list[Attachment]:
    """Every file once, of the first that has it."""
    files: dict[str, Attachment] = {}
    for recording in recordings:
        for file in attachments_of(recording):
            files.setdefault(file.name, file)
    return list(files.values())


def _end(recordings: Sequence[Recording], messages: int) -> RunEnd:
    """How the last one ended, with the losses of all."""
    ends = [recording.end for recording in recordings if recording.end is not None]
    last = recordings[-1].end
    reason = last.reason if last else "the last one has no end"
    dropped = sum(end.dropped for end in ends)
    return RunEnd(
        reason=f"{reason}; made of {len(recordings)} recordings"[:1024],
        received=messages + dropped,
        recorded=messages,
        dropped=dropped,
        gaps=sum(end.gaps for end in ends),
        rejected=sum(end.rejected for end in ends),
        torn=any(is_torn(recording) for recording in recordings),
    )
