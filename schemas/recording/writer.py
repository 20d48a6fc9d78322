"""Writes a recording that is readable whenever its process, its disk or its power ends."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, NoReturn, TypeVar

import msgspec
from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer, Metadata
from mcap.writer import MCAP0_MAGIC

from .. import codec, keys, messages
from ..errors import RecordingError, WireError
from ..json_schema import exported
from .builder import McapBuilder
from .contents import (
    END,
    PROFILE,
    RUN,
    STATISTICS,
    Attachment,
    RunEnd,
    RunHeader,
    schemas_attachment,
    to_metadata,
)
from .record_file import RESERVE_BYTES, Fsync, RecordFile

__all__ = ["Counts", "RecordingWriter", "RunEnd", "RunHeader"]

MAX_CHANNELS = 4096
MAX_ENCODING_CHARS = 256
_UINT32, _UINT64 = 2**32 - 1, 2**64 - 1
T = TypeVar("T")


class Counts(NamedTuple):
    """What became of the messages offered: received = recorded + dropped.

    Attributes:
        recorded: in the file, or (before the end) in the chunk that is being filled.
        bytes: size of the file.
    """

    received: int
    recorded: int
    dropped: int
    bytes: int


class RecordingWriter:
    """One recording, for one thread.

    Messages go to the disk in chunks: when one is full, and when `tick` finds the last flush older
    than `max_loss_s`. At the first error of the disk the file is sealed, RecordingError is raised
    once, and from then on messages are only counted as dropped.

    Attributes:
        error: what ended the recording early.
        unwritten: of the messages taken, those that the disk then did not take, by key.

    Args:
        path: must not exist.
        attachments: besides the schemas of the wire.
        max_loss_s: what a killed process may cost.
        fsync: when to wait for the disk: at every flush, so that lost power costs no more than a
            killed process; at the end; or never.
        reserve_bytes: disk space held back for sealing the file on a full disk.

    Raises:
        RecordingError: the file exists or cannot be made, or there is not room for the reserve.
    """

    def __init__(
        self,
        path: Path | str,
        header: RunHeader,
        *,
        attachments: Iterable[Attachment] = (),
        max_loss_s: float = 0.25,
        fsync: Fsync = "none",
        reserve_bytes: int = RESERVE_BYTES,
    ) -> None:
        self.path = Path(path)
        self.error: RecordingError | None = None
        self.unwritten: Counter[str] = Counter()
        self._max_loss_s = max_loss_s
        self._flushed_s = self._ticked_s = float("-inf")
        self._clock_ns = 0
        self._recorded = self._dropped = 0
        self._pending: list[int] = []
        self._chunks = 0
        self._dirty = self._sealed = False
        self._before_end: int | None = None
        self._gaps = 0
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}
        try:
            self._file = RecordFile(self.path, fsync=fsync, reserve_bytes=reserve_bytes)
        except OSError as error:
            raise RecordingError(
                "cannot record", where=str(self.path), got=error.strerror
            ) from error
        self._call(self._begin, header, attachments)

    @property
    def counts(self) -> Counts:
        """As of now."""
        received = self._recorded + self._dropped
        return Counts(received, self._recorded, self._dropped, self._file.offset)

    def write(
        self,
        key: str,
        payload: bytes,
        encoding: str,
        log_time_ns: int,
        publish_time_ns: int,
        sequence: int,
    ) -> None:
        """Record a sample as it came.

        Args:
            log_time_ns: the recorder's clock; an earlier one than the last counts as the last.
            publish_time_ns: the sender's stamp.
            sequence: the sender's; MCAP keeps its lower 32 bits, the payload all of them.

        Raises:
            WireError: no key of ours, an encoding or a stamp out of bounds, too many channels.
            RecordingError: once, when the disk fails.
        """
        if not isinstance(payload, bytes):
            raise TypeError(f"payload: got {type(payload).__name__}, expected bytes")
        if not (0 <= publish_time_ns <= _UINT64 and log_time_ns <= _UINT64):
            raise WireError("stamp out of bounds", where=key, got=(log_time_ns, publish_time_ns))
        if self.error is not None:
            self._dropped += 1
            return
        channel = self._channels.get((key, encoding)) or self._register(key, encoding)
        self._recorded += 1
        self._pending.append(channel)
        self._add(channel, log_time_ns, payload, publish_time_ns, sequence)

    def files(self) -> list[Path]:
        """What holds the recording so far: one file."""
        return [self.path]

    def split(self) -> None:
        """Goes on as it is, in its one file."""

    def write_statistics(self, statistics: messages.Statistics) -> None:
        """Record the recorder's own counts on channel `crossfix.stats`."""
        if self.error is not None:
            return
        self._gaps = statistics.gaps
        encoding = codec.encoding_of(messages.Statistics)
        channel = self._channels.get((STATISTICS, encoding))
        if channel is None:
            role = {"role": keys.Role.STATUS.value}
            channel = self._new_channel(STATISTICS, encoding, messages.Statistics, role)
        self._add(channel, 0, codec.encode(statistics), statistics.t_ns, 0)

    def tick(self, now_s: float) -> None:
        """Flush what by the next call would have waited for more than `max_loss_s`.

        Call it often, with a clock that only grows; the next call is taken to be as far off as the
        last one is.
        """
        since_last_s, self._ticked_s = now_s - self._ticked_s, now_s
        if now_s + since_last_s - self._flushed_s > self._max_loss_s:
            self._flushed_s = now_s
            self.flush()

    def flush(self) -> None:
        """Close the chunk and pass it to the operating system.

        Raises:
            RecordingError: once, when the disk fails.
        """
        if self._dirty and self.error is None and not self._sealed:
            self._call(self._mcap.flush)

    def repeat(
        self,
        key: str,
        payload: bytes,
        encoding: str,
        *,
        log_time_ns: int,
        publish_time_ns: int,
        sequence: int,
    ) -> None:
        """Record once more what an earlier part holds already; it is counted nowhere."""
        if self.error is None:
            channel = self._channels.get((key, encoding)) or self._register(key, encoding)
            self._add(channel, log_time_ns, payload, publish_time_ns, sequence)

    def give_up(self, error: OSError) -> None:
        """Seal what is there and take no more, as after an error of the disk.

        Raises:
            RecordingError: always, once.
        """
        if self.error is None and not self._sealed:
            self._stop(error, whole=True)

    def close(self, end: RunEnd) -> None:
        """Seal the file with its index; nothing happens if it is sealed already.

        Raises:
            RecordingError: the disk fails now.
        """
        if self.error is None and not self._sealed:
            self.flush()
            self._call(self._seal, end)
            self._call(self._file.finish)
            self._file.close()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close(self._end("closed" if kind is None else f"{kind.__name__}: {error}"))

    def _begin(self, header: RunHeader, attachments: Iterable[Attachment]) -> None:
        self._mcap = McapBuilder(self._file, PROFILE)
        self._mcap.add_metadata(RUN, to_metadata(header))
        for file in (*attachments, schemas_attachment()):
            self._mcap.add_attachment(header.created_ns, file.name, file.media_type, file.data)
        self._mcap.flush()

    def _register(self, key: str, encoding: str) -> int:
        topic = keys.parse(key).topic
        if len(self._channels) >= MAX_CHANNELS:
            raise WireError("too many channels for one recording", where=key, got=MAX_CHANNELS)
        if len(encoding) > MAX_ENCODING_CHARS or not encoding.isascii():
            raise WireError("no encoding", where=key, got=encoding[:MAX_ENCODING_CHARS])
        latched = "true" if topic.latched else "false"
        metadata = {"role": topic.role.value, "qos": topic.qos.name, "latched": latched}
        return self._new_channel(key, encoding, topic.message, metadata)

    def _new_channel(
        self, key: str, encoding: str, message: type[msgspec.Struct], metadata: dict[str, str]
    ) -> int:
        name = f"crossfix.{message.__name__}"
        if name not in self._schemas:
            self._schemas[name] = self._mcap.add_schema(name, "jsonschema", exported(message))
        form = "json" if "json" in encoding else "msgpack"
        channel = self._mcap.add_channel(
            key, form, self._schemas[name], metadata | {"encoding": encoding}
        )
        self._channels[key, encoding] = channel
        return channel

    def _add(
        self, channel: int, log_time_ns: int, payload: bytes, publish_time_ns: int, sequence: int
    ) -> None:
        self._clock_ns = max(self._clock_ns, log_time_ns)
        self._dirty = True
        try:
            self._mcap.add_message(
                channel, self._clock_ns, publish_time_ns, sequence & _UINT32, payload
            )
        except OSError as error:
            self._settle()
            self._stop(error, whole=False)
        if self._file.chunks != self._chunks:  # seldom: the rest of `_call` is for then
            self._call(self._settle)

    def _call(self, action: Callable[..., T], *arguments: Any) -> T:
        """One call of the library, after which every message is in the file, or known not to be."""
        try:
            result = action(*arguments)
        except OSError as error:
            self._settle()
            self._stop(error, whole=False)
        self._settle()
        if self._file.error is not None and not self._sealed:
            self._stop(self._file.error, whole=True)
        return result

    def _settle(self) -> None:
        """A chunk that reached the file took all pending messages with it."""
        if self._file.chunks != self._chunks:
            self._chunks = self._file.chunks
            self._pending.clear()
            self._dirty = False

    def _stop(self, error: OSError, *, whole: bool) -> NoReturn:
        """Seal what is there and stay closed: with an index if the library's state is whole."""
        self.error = RecordingError(
            "recording ended early", where=str(self.path), got=error.strerror
        )
        reason = f"disk error: {error.strerror}"
        if not self._sealed and not (whole and self._finished(reason)):
            self._drop_pending()
            self._seal_without_index(reason)
        self._file.close()
        raise self.error from error

    def _finished(self, reason: str) -> bool:
        try:
            self._mcap.flush()
            self._settle()
            self._seal(self._end(reason))
        except OSError:
            self._settle()
            return False
        return True

    def _drop_pending(self) -> None:
        topics = {number: key for (key, _), number in self._channels.items()}
        self.unwritten.update(topics[number] for number in self._pending)
        self._recorded -= len(self._pending)
        self._dropped += len(self._pending)
        self._pending.clear()

    def _seal(self, end: RunEnd) -> None:
        self._before_end = self._file.offset
        self._mcap.add_metadata(END, to_metadata(end))
        self._mcap.finish()
        self._sealed = True

    def _seal_without_index(self, reason: str) -> None:
        """The least that makes a whole MCAP file; where even that fails it stays unfinished."""
        records = RecordBuilder()
        Metadata(name=END, metadata=to_metadata(self._end(reason))).write(records)
        DataEnd(data_section_crc=0).write(records)
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(records)
        try:
            if self._before_end is not None:
                self._file.cut(self._before_end)
            self._file.write(records.end() + MCAP0_MAGIC)  # type: ignore[no-untyped-call]
        except OSError:
            return

    def _end(self, reason: str) -> RunEnd:
        return RunEnd(
            reason=reason[:1024],
            received=self.counts.received,
            recorded=self._recorded,
            dropped=self._dropped,
            gaps=self._gaps,
        )
