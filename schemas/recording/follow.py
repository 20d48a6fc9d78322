"""Reads a recording while it is written, always up to its last whole record."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from struct import error as StructError  # noqa: N812 - a class, whatever it is called

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata
from mcap.writer import MCAP0_MAGIC

from ..errors import RecordingError
from .contents import END, NEXT_PART, RunEnd, from_metadata
from .parts import part_path, parts_of
from .reader import known_channel
from .recorded import KnownChannel, Recorded, select
from .records import Frame, Source, chunk_data, frames, parse, parse_body, unpacked

POLL_S = 0.05
_NEVER_NS = 2**64


class Follower:
    """A file that grows; each `news` goes on where the last one ended.

    Attributes:
        end: what the recorder has said at the end; None as long as it has not.
    """

    def __init__(self, path: Path) -> None:
        self.end: RunEnd | None = None
        self._path = path
        self._opened: Source | None = None
        self._offset = len(MCAP0_MAGIC)
        self._channels: dict[int, KnownChannel | None] = {}

    def news(self) -> Iterator[Recorded]:
        """The messages that have been written since, in the order of the file.

        Raises:
            RecordingError: it cannot be opened, is not MCAP, or what is there is damaged.
        """
        source = self._opened = self._opened or self._begun()
        if source is None:
            return
        source.refresh()
        for frame in frames(source, self._offset):
            if frame.opcode == Opcode.DATA_END:
                return
            self._offset = frame.end
            yield from self._within(source, frame)

    def close(self) -> None:
        """Give back the file."""
        if self._opened is not None:
            self._opened.close()

    def _begun(self) -> Source | None:
        """The file; None while its recorder has made it but has not written what it is."""
        with suppress(OSError):  # `Source` says what is wrong
            if self._path.stat().st_size < len(MCAP0_MAGIC):
                return None
        return Source(self._path)

    def _within(self, source: Source, frame: Frame) -> list[Recorded]:
        if frame.opcode == Opcode.CHUNK:
            return self._messages(source, frame)
        if frame.opcode == Opcode.METADATA:
            found = parse(source, Metadata, frame)
            if found.name == END:
                self.end = from_metadata(RunEnd, found.metadata, source.name)
        return []

    def _messages(self, source: Source, frame: Frame) -> list[Recorded]:
        data = chunk_data(source, frame)
        try:
            for inner in unpacked(data).registrations:
                if inner.opcode == Opcode.CHANNEL:
                    body = data[inner.body : inner.end]
                    channel = parse_body(source, Channel, body, frame.offset)
                    self._channels[channel.id] = known_channel(channel)
            return select(data, self._channels, 0, _NEVER_NS)
        except (StructError, KeyError) as error:
            raise source.damaged(f"chunk: {error}", frame.offset) from None


def follow(
    path: Path,
    is_over: Callable[[], bool] = lambda: False,
    poll_s: float = POLL_S,
) -> Iterator[Recorded]:
    """The messages of a recording as they come, over all its parts, until its recorder ends it.

    Args:
        path: of the recording; where it is written in parts, its name without their numbers.
        is_over: ends it early, when all that is there has been read.

    Raises:
        RecordingError: nothing is there, or it is damaged.
    """
    found = parts_of(path)
    if not found:
        raise RecordingError("no such recording", where=str(path))
    current = found[0]
    while True:
        follower = Follower(current)
        try:
            yield from _until_sealed(follower, is_over, poll_s)
        finally:
            follower.close()
        if follower.end is None or follower.end.reason != NEXT_PART or current == path:
            return
        current = part_path(path, _number(current) + 1)
        while not current.exists():
            if is_over():
                return
            time.sleep(poll_s)


def _until_sealed(
    follower: Follower, is_over: Callable[[], bool], poll_s: float
) -> Iterator[Recorded]:
    while True:
        last_look = is_over()
        yield from follower.news()
        if follower.end is not None or last_look:
            return
        time.sleep(poll_s)


def _number(part: Path) -> int:
    return int(part.stem.rpartition(".")[2])
