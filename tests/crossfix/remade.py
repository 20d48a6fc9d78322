"""Recordings like another but for what a test changes, and what is in one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import msgpack

from crossfix.making import attachments_of, put, writing
from schemas.recording.reader import Recorded, open_recording
from schemas.recording.writer import RunEnd

Change = Callable[[Recorded], Iterable[Recorded]]


def remade(source: Path, target: Path, change: Change) -> Path:
    """The recording with other messages instead of each."""
    with (
        open_recording(source) as recording,
        writing(target, recording.header, attachments_of(recording)) as writer,
    ):
        for old in recording.messages():
            for new in change(old):
                put(writer, new)
        writer.close(recording.end or RunEnd(reason="remade", torn=True))
    return target


def everything(path: Path) -> list[Recorded]:
    """All messages of the wire in a recording, in the order of the file."""
    with open_recording(path) as recording:
        return list(recording.messages())


def with_field(message: Recorded, *path: str, value: object) -> Recorded:
    """The same message with another value in one field; a function is applied to the old one."""
    tree = msgpack.unpackb(message.payload)
    inner = tree
    for name in path[:-1]:
        inner = inner[name]
    inner[path[-1]] = value(inner[path[-1]]) if callable(value) else value
    return message._replace(payload=msgpack.packb(tree))
