"""What is where in a recording: from its summary if it has a whole one, else by reading it all."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Container
from struct import Struct
from struct import error as StructError  # noqa: N812 - a class, whatever it is called
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    DataEnd,
    Footer,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.writer import MCAP0_MAGIC

from ..errors import RecordingError
from .records import (
    HEAD,
    Frame,
    Source,
    attachment,
    chunk_data,
    frames,
    parse,
    parse_body,
    unpacked,
)

_FOOTER_BYTES = HEAD.size + 20
_DATA_END_BYTES = HEAD.size + 4
_CHUNK_INDEX = Struct("<QQQQL")
_ENTRY = Struct("<HQ")
"""Channel, and where its message index is."""
_CRC_BYTES = 4
_CHUNK_CRC_AT = 24
"""Behind two times and a size."""
BLOCK_BYTES = 1024 * 1024
RUN_MESSAGES = 1024
"""Messages outside chunks are taken together, so many at most."""


class Span(NamedTuple):
    """A stretch of the file with messages: a chunk, or messages one after the other.

    Attributes:
        start_ns, end_ns: least and greatest log time in it.
        channels: of its messages, as the index of a chunk has them; empty where there is none.
    """

    offset: int
    end: int
    start_ns: int
    end_ns: int
    channels: bytes = b""

    def is_only_of(self, numbers: Container[int]) -> bool:
        """Whether no message of another channel can be in it."""
        named = _ENTRY.iter_unpack(self.channels)
        return bool(self.channels) and all(number in numbers for number, _ in named)


class Index(NamedTuple):
    """Everything about a recording but its messages.

    Attributes:
        counts: channel id -> messages in the spans.
        spans: in the order of the file.
        attachments: where they are.
        data_end: offset of the end of the data, 0 = there is none.
        condition: what is wrong with the file, empty if nothing.
        is_whole: whether nothing of it is missing or damaged; it may lack an index all the same.
        damage: the error at which reading ends, after the spans.
    """

    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    counts: dict[int, int]
    spans: list[Span]
    metadata: list[Metadata]
    attachments: list[Frame]
    data_end: int
    condition: str = ""
    is_whole: bool = True
    damage: RecordingError | None = None


def index_of(source: Source) -> Index:
    """The index of a recording, finished or not."""
    try:
        found = _from_summary(source)
    except RecordingError as error:
        return _scan(source)._replace(condition=f"index damaged: {error}", is_whole=False)
    return found or _scan(source)


def _from_summary(source: Source) -> Index | None:
    """By the summary at the end; None where there is none, or one that leaves something out.

    Raises:
        RecordingError: it is damaged.
    """
    tail = _footer(source)
    if tail is None:
        return None
    footer_at = source.size - len(tail)
    footer = parse_body(source, Footer, tail[HEAD.size : _FOOTER_BYTES], footer_at)
    if footer.summary_start == 0:
        return None
    if not len(MCAP0_MAGIC) < footer.summary_start < footer_at:
        raise source.damaged("footer points nowhere", footer_at)
    summary = source.read(footer.summary_start, footer_at - footer.summary_start)
    crc = zlib.crc32(tail[: _FOOTER_BYTES - _CRC_BYTES], zlib.crc32(summary))
    if footer.summary_crc not in (0, crc):
        raise source.damaged("CRC of the summary differs", footer.summary_start)
    return _read_summary(source, summary, footer.summary_start)


def _footer(source: Source) -> bytes | None:
    """The last record and the magic behind it; None where the file does not end with them."""
    footer_at = source.size - len(MCAP0_MAGIC) - _FOOTER_BYTES
    if footer_at < len(MCAP0_MAGIC) + _DATA_END_BYTES:
        return None
    tail = source.read(footer_at, source.size - footer_at)
    is_footer = HEAD.unpack_from(tail) == (Opcode.FOOTER, 20) and tail.endswith(MCAP0_MAGIC)
    return tail if is_footer else None


def _read_summary(source: Source, summary: bytes, start: int) -> Index | None:
    scan = _Scan(source)
    statistics: Statistics | None = None
    try:
        for frame in unpacked(summary).registrations:
            body = summary[frame.body : frame.end]
            if frame.opcode == Opcode.STATISTICS:
                statistics = parse_body(source, Statistics, body, start + frame.offset)
            else:
                scan.take_from_summary(frame.opcode, body, start + frame.offset)
    except StructError as error:
        raise source.damaged(f"summary: {error}", start) from None
    if statistics is None or not scan.is_all_of(statistics):
        return None
    return scan.index()._replace(
        counts=statistics.channel_message_counts, data_end=start - _DATA_END_BYTES
    )


def _scan(source: Source) -> Index:
    """By reading every record from the start to the first that is not whole."""
    scan = _Scan(source)
    end = len(MCAP0_MAGIC)
    try:
        for frame in frames(source, end):
            if frame.opcode == Opcode.DATA_END:
                found = scan.index()._replace(data_end=frame.offset, condition="no whole index")
                return found._replace(is_whole=_footer(source) is not None)
            scan.take(frame)
            end = frame.end
    except RecordingError as error:
        return scan.index()._replace(condition=str(error), is_whole=False, damage=error)
    rest = source.size - end
    torn = f"torn at byte {end}, {rest} bytes of it not read" if rest else "no end"
    return scan.index()._replace(condition=f"unfinished: {torn}", is_whole=False)


class _Scan:
    """An index in the making."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._spans: list[Span] = []
        self._metadata: list[Metadata] = []
        self._attachments: list[Frame] = []
        self._bare: list[Frame] = []

    def index(self) -> Index:
        """What has been found so far."""
        self._end_run()
        return Index(
            self._schemas,
            self._channels,
            dict(self._counts),
            self._spans,
            self._metadata,
            self._attachments,
            data_end=0,
        )

    def take(self, frame: Frame) -> None:
        """One record of the data section."""
        if frame.opcode == Opcode.MESSAGE:
            self._bare.append(frame)
            if len(self._bare) >= RUN_MESSAGES:
                self._end_run()
            return
        self._end_run()
        if frame.opcode == Opcode.CHUNK:
            self._take_stretch(frame, frame.end, chunk_data(self._source, frame))
        elif frame.opcode == Opcode.METADATA:
            self._metadata.append(parse(self._source, Metadata, frame))
        elif frame.opcode == Opcode.ATTACHMENT:
            attachment(self._source, frame)
            self._attachments.append(frame)
        elif frame.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            body = self._source.read(frame.body, frame.length)
            self._register(frame.opcode, body, frame.offset)
        elif frame.opcode == Opcode.MESSAGE_INDEX:
            self._require_message_index(frame)
        elif frame.opcode != Opcode.HEADER:
            raise self._source.damaged(f"no record has opcode {frame.opcode:#x}", frame.offset)

    def take_from_summary(self, opcode: int, body: bytes, offset: int) -> None:
        """One record of the summary."""
        if opcode == Opcode.CHUNK_INDEX:
            self._spans.append(_span(body))
        elif opcode == Opcode.METADATA_INDEX:
            found = parse_body(self._source, MetadataIndex, body, offset)
            self._metadata.append(parse(self._source, Metadata, self._frame_at(found.offset)))
        elif opcode == Opcode.ATTACHMENT_INDEX:
            place = parse_body(self._source, AttachmentIndex, body, offset)
            self._attachments.append(self._frame_at(place.offset))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._register(opcode, body, offset)

    def is_all_of(self, statistics: Statistics) -> bool:
        """Whether the summary named everything its statistics count, and messages are in chunks."""
        found = (
            len(self._schemas),
            len(self._channels),
            len(self._attachments),
            len(self._metadata),
            len(self._spans),
        )
        return found == (
            statistics.schema_count,
            statistics.channel_count,
            statistics.attachment_count,
            statistics.metadata_count,
            statistics.chunk_count,
        ) and (statistics.chunk_count > 0 or statistics.message_count == 0)

    def _take_stretch(self, frame: Frame, end: int, data: bytes) -> None:
        """Note channels, counts and times of a chunk or of a run of messages."""
        try:
            messages, registrations = unpacked(data)
        except StructError as error:
            raise self._source.damaged(f"chunk: {error}", frame.offset) from None
        for inner in registrations:
            if inner.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._register(inner.opcode, data[inner.body : inner.end], frame.offset)
        self._counts.update(message[0] for message in messages)
        if messages:
            times_ns = [message[2] for message in messages]
            self._spans.append(Span(frame.offset, end, min(times_ns), max(times_ns)))

    def _end_run(self) -> None:
        if self._bare:
            first, end = self._bare[0], self._bare[-1].end
            self._bare = []
            data = self._source.read(first.offset, end - first.offset)
            self._take_stretch(first, end, data)

    def _register(self, opcode: int, body: bytes, offset: int) -> None:
        if opcode == Opcode.SCHEMA:
            schema = parse_body(self._source, Schema, body, offset)
            known = self._schemas.setdefault(schema.id, schema) == schema
        else:
            channel = parse_body(self._source, Channel, body, offset)
            known = self._channels.setdefault(channel.id, channel) == channel
        if not known:
            raise self._source.damaged("one id for two schemas or channels", offset)

    def _frame_at(self, offset: int) -> Frame:
        frame = next(frames(self._source, offset), None)
        if frame is None:
            raise self._source.damaged("index points nowhere", offset)
        return frame

    def _require_message_index(self, frame: Frame) -> None:
        """A chunk whose opcode was altered would otherwise pass for an index and be lost."""
        body = self._source.read(frame.body, min(frame.length, 6))
        if int.from_bytes(body[2:], "little") != frame.length - 6:
            raise self._source.damaged("no message index", frame.offset)


def _span(body: bytes) -> Span:
    """From a chunk index, without the dict that the library would make of each.

    Raises:
        struct.error: it is not whole.
    """
    start_ns, end_ns, at, length, size = _CHUNK_INDEX.unpack_from(body)
    channels = body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
    if len(channels) != size or size % _ENTRY.size:
        raise StructError("chunk index of another length")
    return Span(at, at + length, start_ns, end_ns, channels)


def data_crc(source: Source, index: Index) -> None:
    """Check the CRC of all the data, where the file has one.

    Raises:
        RecordingError: it differs.
    """
    if not index.data_end:
        return
    frame = next(frames(source, index.data_end), None)
    if frame is None or frame.opcode != Opcode.DATA_END:
        raise source.damaged("data does not end where the index says", index.data_end)
    wanted, crc = parse(source, DataEnd, frame).data_section_crc, 0
    for offset in range(0, index.data_end, BLOCK_BYTES):
        crc = zlib.crc32(source.read(offset, min(BLOCK_BYTES, index.data_end - offset)), crc)
    if wanted not in (0, crc):
        raise source.damaged("CRC of the data differs", 0)


def unchecked(source: Source, index: Index) -> int:
    """How many stretches of messages no CRC covers: what is damaged in them cannot be seen."""
    frame = next(frames(source, index.data_end), None) if index.data_end else None
    if frame and frame.opcode == Opcode.DATA_END and parse(source, DataEnd, frame).data_section_crc:
        return 0
    return sum(not _has_crc(source, span) for span in index.spans)


def _has_crc(source: Source, span: Span) -> bool:
    opcode, _ = HEAD.unpack(source.read(span.offset, HEAD.size))
    at = span.offset + HEAD.size + _CHUNK_CRC_AT
    return opcode == Opcode.CHUNK and any(source.read(at, _CRC_BYTES))
