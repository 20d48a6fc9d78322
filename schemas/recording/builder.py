"""Lays MCAP out in a file: chunks, indexes and summary, a few hundred nanoseconds a message.

The library's writer makes three objects of every message, keeps every chunk's index as a dict (19
MB an hour), and is spoilt by a call that fails. Here its record classes are used for all that is
rare, and a message is packed into the chunk at once; what is kept of a chunk are the bytes of its
index record.
"""

from __future__ import annotations

import sys
import zlib
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from struct import Struct
from typing import NamedTuple, Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import LIBRARY_IDENTIFIER, MCAP0_MAGIC

from .records import HEAD

CHUNK_BYTES = 256 * 1024
ZSTD = "zstd"
LEVEL = 1
"""A recording of reports gets 3 % larger than at level 3, in three quarters of the time or less."""
_MESSAGE = Struct("<BQHIQQ")
_MESSAGE_BYTES = 22
"""Of the fields of a message before its payload."""
_CHUNK = Struct("<QQQIL4sQ")
_INDEX_HEAD = Struct("<HI")
_FOOTER = Struct("<QQ")


class RecordSink(Protocol):
    """Where records go, in order and whole."""

    def write(self, records: bytes) -> int:
        """Append whole records."""

    def tell(self) -> int:
        """Offset of the next record."""

    def flush(self) -> None:
        """Pass on what waits."""


class _Kept(NamedTuple):
    """Records of one kind that the summary repeats or is made of."""

    opcode: Opcode
    records: bytearray


class McapBuilder:
    """One MCAP file in the making, zstd in chunks, every CRC there is.

    A call that raises OSError leaves the file and what is known of it as they were before, but
    for the messages of the chunk, which are lost.
    """

    def __init__(self, sink: RecordSink, profile: str) -> None:
        self._sink = sink
        self._data_crc = 0
        self._schemas = _Kept(Opcode.SCHEMA, bytearray())
        self._channels = _Kept(Opcode.CHANNEL, bytearray())
        self._chunk_indexes = _Kept(Opcode.CHUNK_INDEX, bytearray())
        self._attachments = _Kept(Opcode.ATTACHMENT_INDEX, bytearray())
        self._metadata = _Kept(Opcode.METADATA_INDEX, bytearray())
        self._numbers: Counter[Opcode] = Counter()
        self._counts: dict[int, int] = {}
        self._start_ns, self._end_ns = 2**64 - 1, 0
        self._compress = zstandard.ZstdCompressor(LEVEL).compress
        self._chunk = bytearray()
        self._index: dict[int, array[int]] = {}
        self._append(MCAP0_MAGIC + _bytes_of(Header(profile, LIBRARY_IDENTIFIER)))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Number of a new schema."""
        number = self._next_number(Opcode.SCHEMA)
        schema = Schema(id=number, name=name, encoding=encoding, data=data)
        self._register(self._schemas, schema)
        return number

    def add_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]
    ) -> int:
        """Number of a new channel."""
        number = self._next_number(Opcode.CHANNEL)
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding=encoding,
            schema_id=schema,
            metadata=dict(metadata),
        )
        self._register(self._channels, channel)
        return number

    def add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Texts by their names."""
        record = _bytes_of(Metadata(name=name, metadata=dict(texts)))
        index = MetadataIndex(offset=self._sink.tell(), length=len(record), name=name)
        self._append(record)
        self._keep(self._metadata, index)

    def add_attachment(self, made_ns: int, name: str, media_type: str, data: bytes) -> None:
        """A file within."""
        attachment = Attachment(made_ns, made_ns, name, media_type, data)
        record = _bytes_of(attachment)
        index = AttachmentIndex(
            offset=self._sink.tell(),
            length=len(record),
            log_time=made_ns,
            create_time=made_ns,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._append(record)
        self._keep(self._attachments, index)

    def add_message(
        self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, payload: bytes
    ) -> None:
        """Put a message into the chunk, which goes to the file when it is full."""
        chunk = self._chunk
        index = self._index.get(channel)
        if index is None:
            index = self._index[channel] = array("Q")
        index.append(log_time_ns)
        index.append(len(chunk))
        chunk += _MESSAGE.pack(
            5, _MESSAGE_BYTES + len(payload), channel, sequence, log_time_ns, publish_time_ns
        )
        chunk += payload
        if len(chunk) > CHUNK_BYTES:
            self._finish_chunk()

    def flush(self) -> None:
        """Close the chunk, if it holds a message."""
        self._finish_chunk()
        self._sink.flush()

    def finish(self) -> None:
        """Close the chunk and write the summary; nothing may follow."""
        self._finish_chunk()
        self._append(_bytes_of(DataEnd(self._data_crc)))
        start = self._sink.tell()
        groups, offsets = bytearray(), bytearray()
        for kept in self._summary():
            if kept.records:
                at = start + len(groups)
                offsets += _bytes_of(SummaryOffset(kept.opcode, at, len(kept.records)))
                groups += kept.records
        self._sink.write(bytes(groups + offsets) + _footer(start, groups, offsets) + MCAP0_MAGIC)
        self._sink.flush()

    def _summary(self) -> Iterable[_Kept]:
        statistics = Statistics(
            attachment_count=self._numbers[Opcode.ATTACHMENT_INDEX],
            channel_count=self._numbers[Opcode.CHANNEL],
            channel_message_counts=self._counts,
            chunk_count=self._numbers[Opcode.CHUNK_INDEX],
            message_count=sum(self._counts.values()),
            message_start_time=self._start_ns if self._counts else 0,
            message_end_time=self._end_ns,
            metadata_count=self._numbers[Opcode.METADATA_INDEX],
            schema_count=self._numbers[Opcode.SCHEMA],
        )
        counted = _Kept(Opcode.STATISTICS, bytearray(_bytes_of(statistics)))
        return (
            self._schemas,
            self._channels,
            counted,
            self._chunk_indexes,
            self._attachments,
            self._metadata,
        )

    def _next_number(self, opcode: Opcode) -> int:
        return self._numbers[opcode] + 1

    def _register(self, kept: _Kept, record: Schema | Channel) -> None:
        """Into the chunk, before the first message that needs it, and into the summary."""
        self._chunk += self._keep(kept, record)

    def _keep(self, kept: _Kept, record: McapRecord) -> bytes:
        data = _bytes_of(record)
        kept.records.extend(data)
        self._numbers[kept.opcode] += 1
        return data

    def _append(self, records: bytes) -> None:
        self._sink.write(records)
        self._data_crc = zlib.crc32(records, self._data_crc)

    def _finish_chunk(self) -> None:
        if not self._index:
            return
        records, index = bytes(self._chunk), self._index
        least_ns = min(min(entries[::2]) for entries in index.values())
        most_ns = max(max(entries[::2]) for entries in index.values())
        compressed = self._compress(records)
        place = self._sink.tell()
        chunk = _chunk(records, compressed, least_ns, most_ns)
        offsets, indexes = _message_indexes(index, place + len(chunk))
        self._append(chunk + indexes)
        self._chunk, self._index = bytearray(), {}
        for channel, entries in index.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(entries) // 2
        self._start_ns, self._end_ns = min(self._start_ns, least_ns), max(self._end_ns, most_ns)
        self._keep(
            self._chunk_indexes,
            ChunkIndex(
                message_start_time=least_ns,
                message_end_time=most_ns,
                chunk_start_offset=place,
                chunk_length=len(chunk),
                message_index_offsets=offsets,
                message_index_length=len(indexes),
                compression=ZSTD,
                compressed_size=len(compressed),
                uncompressed_size=len(records),
            ),
        )


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    write: Callable[[RecordBuilder], None] = record.write
    write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def _chunk(records: bytes, compressed: bytes, least_ns: int, most_ns: int) -> bytes:
    """The chunk record: head, fixed fields, name of the compression, data."""
    fields = _CHUNK.pack(
        least_ns,
        most_ns,
        len(records),
        zlib.crc32(records),
        len(ZSTD),
        ZSTD.encode(),
        len(compressed),
    )
    return HEAD.pack(Opcode.CHUNK, len(fields) + len(compressed)) + fields + compressed


def _message_indexes(index: Mapping[int, array[int]], place: int) -> tuple[dict[int, int], bytes]:
    """Where each channel's index record will be, and all of them, to be written at `place`."""
    offsets, records = dict[int, int](), bytearray()
    for channel, entries in index.items():
        if sys.byteorder == "big":
            entries.byteswap()
        offsets[channel] = place + len(records)
        data = entries.tobytes()
        records += HEAD.pack(Opcode.MESSAGE_INDEX, _INDEX_HEAD.size + len(data))
        records += _INDEX_HEAD.pack(channel, len(data)) + data
    return offsets, bytes(records)


def _footer(start: int, groups: bytearray, offsets: bytearray) -> bytes:
    head = HEAD.pack(Opcode.FOOTER, 20) + _FOOTER.pack(start, start + len(groups))
    crc = zlib.crc32(head, zlib.crc32(offsets, zlib.crc32(groups)))
    return _bytes_of(Footer(start, start + len(groups), crc))
