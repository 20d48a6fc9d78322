"""The last seconds of a recording as a file of its own, while the recording goes on.

Run as a process, `python -m schemas.recording.snapshot RECORDING NEW SECONDS`: copying must not
take the time of the recorder that is asked for it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import TypedDict

import msgspec

from ..errors import CrossfixError, RecordingError
from .contents import SCHEMAS, RunEnd
from .parts import parts_of
from .reader import Recorded, Recording, open_recording
from .writer import RecordingWriter


def snapshot(recording: Path, target: Path, last_s: float) -> int:
    """Copy the last seconds of log time, after the latched values of their beginning.

    Args:
        recording: may still be written, and in parts.
        target: must not exist.

    Returns:
        How many messages were copied.

    Raises:
        RecordingError: nothing is there, or the copy cannot be written.
    """
    with ExitStack() as stack:
        parts = [stack.enter_context(open_recording(part)) for part in _parts(recording)]
        end_ns = max((span.end_ns for part in parts for span in part.index.spans), default=0)
        start_ns = max(0, end_ns - round(last_s * 1e9))
        latched = _latched(parts, start_ns)
        header = msgspec.structs.replace(
            parts[-1].header,
            part=0,
            repeated=len(latched),
            made_from={"verb": "snapshot", "of": recording.name, "last_s": f"{last_s:g}"},
        )
        attached = [a for a in parts[-1].attachments.values() if a.name != SCHEMAS]
        with RecordingWriter(target, header, attachments=attached) as writer:
            for message in latched:
                writer.repeat(*message[1:4], **_stamps(message, start_ns))
            for message in _messages(parts, start_ns):
                writer.write(*message[1:4], **_stamps(message, message.log_time_ns))
            count = writer.counts.recorded
            reason = f"snapshot of the last {last_s:g} s"
            writer.close(RunEnd(reason=reason, received=count, recorded=count))
    return count


def main(arguments: Sequence[str]) -> int:
    """Make a snapshot; exit code and one line for the recorder's log."""
    recording, target, last_s = arguments
    try:
        count = snapshot(Path(recording), Path(target), float(last_s))
    except CrossfixError as error:
        sys.stderr.write(f"error: {error}\n")
        return error.exit_code
    sys.stderr.write(f"{count} messages in {target}\n")
    return 0


def _parts(recording: Path) -> list[Path]:
    parts = parts_of(recording)
    if not parts:
        raise RecordingError("no such recording", where=str(recording))
    return parts


def _latched(parts: Sequence[Recording], before_ns: int) -> list[Recorded]:
    """The last value of every latched key before an instant, over all parts."""
    found = {m.key: m for part in parts for m in part.latched(before_ns)}
    return list(found.values())


def _messages(parts: Sequence[Recording], start_ns: int) -> Iterator[Recorded]:
    """Those from an instant on, without what a part repeats of the one before."""
    for number, part in enumerate(parts):
        begins_ns = min((span.start_ns for span in part.index.spans), default=0)
        repeated = part.header.repeated if number and begins_ns >= start_ns else 0
        yield from islice(part.messages(start_ns=start_ns), repeated, None)


class _Stamps(TypedDict):
    log_time_ns: int
    publish_time_ns: int
    sequence: int


def _stamps(message: Recorded, log_time_ns: int) -> _Stamps:
    return {
        "log_time_ns": log_time_ns,
        "publish_time_ns": message.publish_time_ns,
        "sequence": message.sequence,
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
