"""A recording in several files, each of which can be read alone; old ones may make room."""

from __future__ import annotations

import errno
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import msgspec

from .. import keys, messages
from ..errors import RecordingError
from .contents import NEXT_PART, Attachment, RunEnd, RunHeader
from .record_file import RESERVE_BYTES, Fsync
from .writer import Counts, RecordingWriter

__all__ = ["ONE_FILE", "Limits", "PartedWriter", "Safety", "part_path", "parts_of"]

MAX_LATCHED = 4096
NO_COUNTS = Counts(0, 0, 0, 0)


class Limits(NamedTuple):
    """When a file is full and how much of the disk a recording may have; 0 = no limit.

    Attributes:
        part_bytes, part_s: a part that has as many bytes, or spans so much log time, is sealed and
            the next one begun.
        keep: parts that are kept; of more the oldest is deleted.
        min_free_bytes: on the disk. With `keep` old parts make room, else the recording ends.
    """

    part_bytes: int = 0
    part_s: float = 0.0
    keep: int = 0
    min_free_bytes: int = 0

    @property
    def splits(self) -> bool:
        """Whether there will be parts."""
        return bool(self.part_bytes or self.part_s)


ONE_FILE = Limits()


class Safety(NamedTuple):
    """What a crash may cost; as `RecordingWriter` explains."""

    max_loss_s: float = 0.25
    fsync: Fsync = "none"
    reserve_bytes: int = RESERVE_BYTES


SAFE = Safety()


def part_path(path: Path, part: int) -> Path:
    """File of a part: strait.mcap -> strait.0001.mcap."""
    return path.with_name(f"{path.stem}.{part:04d}{path.suffix}")


def parts_of(path: Path) -> list[Path]:
    """Files of a recording that are there, in their order: itself, or its parts."""
    if path.exists():
        return [path]
    pattern = re.compile(rf"{re.escape(path.stem)}\.(\d{{4,}}){re.escape(path.suffix)}")
    found = [(name, pattern.fullmatch(name.name)) for name in path.parent.iterdir()]
    numbered = [(int(match[1]), name) for name, match in found if match]
    return [name for _, name in sorted(numbered)]


class PartedWriter:
    """Writes as `RecordingWriter` does, and goes on in a new file when one is full.

    Each part has the header, the attachments and, first of all, the last value of every latched
    key, so it can be read alone. Counts are over all parts.

    Attributes:
        parts: files that are there, the one being written last.

    Raises:
        RecordingError: a file exists or cannot be made.
    """

    def __init__(
        self,
        path: Path | str,
        header: RunHeader,
        *,
        attachments: Iterable[Attachment] = (),
        limits: Limits = ONE_FILE,
        safety: Safety = SAFE,
    ) -> None:
        self.path = Path(path)
        self.error: RecordingError | None = None
        self.parts: list[Path] = []
        self._header, self._attachments = header, tuple(attachments)
        self._limits, self._safety = limits, safety
        self._part = 1 if limits.splits else 0
        self._before, self._too_late = NO_COUNTS, 0
        self._latched = _Latched()
        self._gaps = self._began_ns = self._clock_ns = 0
        self._looked_s = float("-inf")
        self._writer = self._new_part()

    def files(self) -> list[Path]:
        """What holds the recording so far."""
        return list(self.parts)

    @property
    def unwritten(self) -> Counter[str]:
        """Of the messages taken, those that the disk then did not take, by key."""
        return self._writer.unwritten

    @property
    def counts(self) -> Counts:
        """Over all parts, those deleted since included."""
        received, recorded, dropped, size = self._all_written()
        return Counts(received + self._too_late, recorded, dropped + self._too_late, size)

    def write(
        self,
        key: str,
        payload: bytes,
        encoding: str,
        log_time_ns: int,
        publish_time_ns: int,
        sequence: int,
    ) -> None:
        """As `RecordingWriter.write`.

        Raises:
            WireError: as there.
            RecordingError: once, when the disk fails.
        """
        if self.error is not None:
            self._too_late += 1
            return
        self._clock_ns = max(self._clock_ns, log_time_ns)
        if self._is_full():
            self._too_late += 1  # unless there is a next part
            self.split()
            self._too_late -= 1
        try:
            self._writer.write(key, payload, encoding, log_time_ns, publish_time_ns, sequence)
        except RecordingError as error:
            self.error = error
            raise
        if self._limits.splits:
            self._latched.note(Repeat(key, payload, encoding, publish_time_ns, sequence))

    def write_statistics(self, statistics: messages.Statistics) -> None:
        """As `RecordingWriter.write_statistics`."""
        self._gaps = statistics.gaps
        with self._watched():
            self._writer.write_statistics(statistics)

    def tick(self, now_s: float) -> None:
        """Flush what has waited long enough, and see whether the disk has room left.

        Raises:
            RecordingError: once, when the disk fails or has less room than is to be left.
        """
        if self.error is not None:
            return
        with self._watched():
            self._writer.tick(now_s)
            if self._limits.min_free_bytes and now_s - self._looked_s >= self._safety.max_loss_s:
                self._looked_s = now_s
                self._keep_free()

    def flush(self) -> None:
        """As `RecordingWriter.flush`."""
        with self._watched():
            self._writer.flush()

    def split(self) -> None:
        """Seal this part and go on in the next one; a recording of one file goes on as it is.

        Raises:
            RecordingError: once, when the disk fails.
        """
        if not self._limits.splits or self.error is not None:
            return
        with self._watched():
            self._writer.close(self._end(NEXT_PART))
            before, self._part = self._all_written(), self._part + 1
            self._writer = self._new_part()
            self._before = before
            for message in self._latched.messages():
                self._writer.repeat(
                    message.key,
                    message.payload,
                    message.encoding,
                    log_time_ns=self._clock_ns,
                    publish_time_ns=message.publish_time_ns,
                    sequence=message.sequence,
                )
            self._make_room(self._limits.keep)

    def close(self, end: RunEnd) -> None:
        """Seal the last part; its end bears the counts of the whole recording.

        Raises:
            RecordingError: the disk fails now.
        """
        with self._watched():
            self._writer.close(end)

    def __enter__(self) -> PartedWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close(self._end("closed" if kind is None else f"{kind.__name__}: {error}"))

    @contextmanager
    def _watched(self) -> Iterator[None]:
        try:
            yield
        except RecordingError as error:
            self.error = error
            raise

    def _new_part(self) -> RecordingWriter:
        path = part_path(self.path, self._part) if self._part else self.path
        header = msgspec.structs.replace(self._header, part=self._part, repeated=len(self._latched))
        writer = RecordingWriter(
            path, header, attachments=self._attachments, **self._safety._asdict()
        )
        self._began_ns = self._clock_ns
        self.parts.append(path)
        return writer

    def _is_full(self) -> bool:
        part_bytes, part_s, *_ = self._limits
        if part_bytes and self._writer.counts.bytes >= part_bytes:
            return True
        began_ns = self._began_ns = self._began_ns or self._clock_ns
        return bool(part_s) and self._clock_ns - began_ns >= part_s * 1e9

    def _keep_free(self) -> None:
        """Let old parts make room; without any the recording ends, so that the disk is not full."""
        least = self._limits.min_free_bytes
        while _free_bytes(self.path.parent) < least:
            if self._limits.keep and len(self.parts) > 1:
                self._make_room(len(self.parts) - 1)
            else:
                self._writer.give_up(OSError(errno.ENOSPC, f"less than {least} bytes free"))

    def _make_room(self, keep: int) -> None:
        while 0 < keep < len(self.parts):
            self.parts.pop(0).unlink(missing_ok=True)

    def _all_written(self) -> Counts:
        return Counts(*map(sum, zip(self._before, self._writer.counts, strict=True)))

    def _end(self, reason: str) -> RunEnd:
        """Of a part that is not the last: with what it holds itself."""
        received, recorded, dropped, _ = self._writer.counts
        return RunEnd(
            reason=reason,
            received=received,
            recorded=recorded,
            dropped=dropped,
            gaps=self._gaps,
        )


class Repeat(NamedTuple):
    """A message that every later part begins with."""

    key: str
    payload: bytes
    encoding: str
    publish_time_ns: int
    sequence: int


class _Latched:
    """The last value of every latched key, as far as there is room."""

    def __init__(self) -> None:
        self._last: dict[str, Repeat] = {}
        self._others: set[str] = set()

    def note(self, message: Repeat) -> None:
        """Keep a message if its key is latched."""
        if message.key in self._others:
            return
        if message.key not in self._last and not self._is_latched(message.key):
            return
        self._last[message.key] = message

    def __len__(self) -> int:
        return len(self._last)

    def messages(self) -> Iterable[Repeat]:
        """In the order in which the keys came."""
        return self._last.values()

    def _is_latched(self, key: str) -> bool:
        if len(self._last) + len(self._others) >= MAX_LATCHED:
            return False
        latched = keys.parse(key).topic.latched
        if not latched:
            self._others.add(key)
        return latched


def _free_bytes(folder: Path) -> int:
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize
