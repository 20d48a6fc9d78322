"""How a recording is made of others: beside its name until it is whole, and never over anything."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from crossfix.new_file import require_new
from schemas.errors import RecordingError
from schemas.recording.contents import SCHEMAS, Attachment, RunEnd, RunHeader
from schemas.recording.reader import Recorded, Recording
from schemas.recording.writer import RecordingWriter

RESERVE_BYTES = 64 * 1024
"""A disk that is full ends the making of a recording; nothing is lost by that."""


class Made(NamedTuple):
    """A recording that was made: where it is, how many messages are in it and how large it is."""

    path: str
    messages: int
    bytes: int


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """A name in the folder of `path` for what becomes `path` at the end, if nothing goes wrong.

    Raises:
        LaunchError: `path` exists, or its folder does not or cannot be written to.
        RecordingError: the disk does not take it, or somebody else has made `path` meanwhile.
    """
    require_new(path)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield unfinished
        if path.exists():
            raise RecordingError("was made meanwhile", where=str(path), expected="another name")
        unfinished.rename(path)
    except OSError as error:
        raise RecordingError("cannot write", where=str(path), got=error.strerror) from error
    finally:
        unfinished.unlink(missing_ok=True)


def header_of(recording: Recording, made_from: Mapping[str, str]) -> RunHeader:
    """The header of a recording that is made of this one; what was done stands in `made_from`."""
    return replace(recording.header, created_ns=time.time_ns(), made_from=dict(made_from))


def attachments_of(recording: Recording) -> list[Attachment]:
    """The files within, but the schemas: each recording has those of its own messages."""
    return [file for file in recording.attachments.values() if file.name != SCHEMAS]


def end_of(recording: Recording, done: str, messages: int) -> RunEnd:
    """How a recording ends that is made of this one and holds so many messages."""
    end = recording.end or RunEnd(reason=recording.condition or "unknown", torn=True)
    return replace(
        end,
        reason=f"{end.reason}; {done}"[:1024],
        received=messages + end.dropped,
        recorded=messages,
    )


def is_torn(recording: Recording) -> bool:
    """Whether the recorder never got to its end, so that the last messages may lack others."""
    return recording.end is None or recording.end.torn


def put(writer: RecordingWriter, message: Recorded) -> None:
    """Write a message as it was recorded."""
    writer.write(
        message.key,
        message.payload,
        message.encoding,
        log_time_ns=message.log_time_ns,
        publish_time_ns=message.publish_time_ns,
        sequence=message.sequence,
    )


@contextmanager
def writing(
    path: Path, header: RunHeader, attachments: Iterable[Attachment]
) -> Iterator[RecordingWriter]:
    """A writer whose file gets its name when the block ends well; close it in the block.

    Raises:
        LaunchError: as `beside`.
        RecordingError: the disk fails.
    """
    with beside(path) as unfinished:
        writer = RecordingWriter(
            unfinished, header, attachments=attachments, reserve_bytes=RESERVE_BYTES
        )
        try:
            yield writer
        finally:
            writer.close(RunEnd(reason="given up"))


def made(path: Path, messages: int) -> Made:
    """What has been made at `path`."""
    return Made(str(path), messages, path.stat().st_size)
