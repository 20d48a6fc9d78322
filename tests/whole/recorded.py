"""What tests read of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import msgspec

from schemas import keys
from schemas.recording.reader import open_recording

T = TypeVar("T", bound=msgspec.Struct)


def outputs(path: Path) -> list[tuple[str, bytes]]:
    """Key and payload of every output by key and sequence; they may have come in any order."""
    with open_recording(path) as recording:
        found = list(recording.messages(roles=(keys.Role.OUTPUT,)))
    return [(m.key, m.payload) for m in sorted(found, key=lambda m: (m.key, m.sequence))]


def messages(path: Path, topic: keys.Topic, kind: type[T]) -> Iterator[T]:
    """Every message of a topic, in order of sequence; they may have come in any order."""
    with open_recording(path) as recording:
        found = sorted(recording.messages(topics=(topic,)), key=lambda m: (m.key, m.sequence))
        for recorded in found:
            message = recorded.decode()
            assert isinstance(message, kind)
            yield message
