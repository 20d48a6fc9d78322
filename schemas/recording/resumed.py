"""An MCAP file taken up again behind its last whole record, in place or in a copy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Channel, ChunkIndex, Metadata, MetadataIndex
from mcap.records import Schema as SchemaRecord
from mcap.writer import MCAP0_MAGIC

from .builder import McapBuilder
from .plain_file import KeptFile, Nowhere, PlainFile
from .records import Frame, RawMessage, Source, chunk_data, parse, parse_body, unpacked

_CHUNK_NAME_AT = 28


class Resumed(McapBuilder):
    """Takes whole records over as they are, then goes on as a builder does.

    Args:
        path: of the file itself, whose bytes then stay where they are, or of a new one.

    Raises:
        RecordingError: it cannot be written.
    """

    def __init__(self, source: Source, path: Path) -> None:
        self._file = KeptFile(path) if path.exists() else PlainFile(path)
        super().__init__(Nowhere(), "")  # the head of the file is taken over as well
        self._data_crc, self._sink = 0, self._file
        self._append(MCAP0_MAGIC)
        self._source = source
        self.known: dict[int, Channel] = {}
        self.has_declared = False
        self._registered_schemas: set[int] = set()

    @property
    def offset(self) -> int:
        """Where the next record goes."""
        return self._file.tell()

    @property
    def messages(self) -> int:
        """In whole chunks."""
        return sum(self._counts.values())

    def take(self, frame: Frame) -> None:
        """Take over a record that is no chunk."""
        offset = self._copied(frame)
        length = frame.end - frame.offset
        if frame.opcode == Opcode.METADATA:
            name = parse(self._source, Metadata, frame).name
            self._keep(self._metadata, MetadataIndex(offset=offset, length=length, name=name))
        elif frame.opcode == Opcode.ATTACHMENT:
            self._keep(self._attachments, _attachment_index(self._source, frame, offset))
        elif frame.opcode == Opcode.SCHEMA:
            self.register(parse(self._source, SchemaRecord, frame))
        elif frame.opcode == Opcode.CHANNEL:
            self.register(parse(self._source, Channel, frame))

    def take_chunk(self, frame: Frame, indexes: Mapping[int, Frame], *, looking: bool) -> None:
        """Take over a chunk and the indexes behind it, by channel.

        Args:
            looking: count the messages in it; else the indexes are believed.

        Raises:
            RecordingError: nobody knows what its messages are; nothing is taken over.
        """
        counts = {channel: (index.length - 6) // 16 for channel, index in indexes.items()}
        if looking or not counts or not self.known.keys() >= counts.keys():
            counts = self._looked_into(chunk_data(self._source, frame))
        if not self.known.keys() >= counts.keys():
            raise self._source.damaged("its channels are in a lost chunk", frame.offset)
        head = self._source.read(frame.body, 64)
        place = self._copied(frame)
        offsets = {channel: self._copied(index) for channel, index in indexes.items()}
        start_ns, end_ns, size = (int.from_bytes(head[at : at + 8], "little") for at in (0, 8, 16))
        name_length = int.from_bytes(head[_CHUNK_NAME_AT : _CHUNK_NAME_AT + 4], "little")
        name = head[_CHUNK_NAME_AT + 4 : _CHUNK_NAME_AT + 4 + name_length].decode(
            "ascii", "replace"
        )
        for channel, count in counts.items():
            self._counts[channel] = self._counts.get(channel, 0) + count
        self._start_ns, self._end_ns = min(self._start_ns, start_ns), max(self._end_ns, end_ns)
        index = ChunkIndex(
            message_start_time=start_ns,
            message_end_time=end_ns,
            chunk_start_offset=place,
            chunk_length=frame.end - frame.offset,
            message_index_offsets=offsets,
            message_index_length=self.offset - place - (frame.end - frame.offset),
            compression=name,
            compressed_size=frame.length - 40 - name_length,
            uncompressed_size=size,
        )
        self._keep(self._chunk_indexes, index)

    def declare(self, records: Iterable[SchemaRecord | Channel]) -> None:
        """Write those schemas and channels that are new outside of any chunk."""
        self.has_declared = True
        data = b"".join(map(self.register, records))
        if data:
            self._append(data)

    def register(self, record: SchemaRecord | Channel) -> bytes:
        """Note a schema or channel once; the bytes of one that is new."""
        if isinstance(record, Channel):
            is_new = self.known.setdefault(record.id, record) is record
            return self._keep(self._channels, record) if is_new else b""
        if record.id in self._registered_schemas:
            return b""
        self._registered_schemas.add(record.id)
        return self._keep(self._schemas, record)

    def write_again(self, record: SchemaRecord | Channel | RawMessage) -> bool:
        """Put a record of a torn chunk into a new one; whether it is a message on its channel."""
        if isinstance(record, SchemaRecord | Channel):
            self._chunk += self.register(record)
            return False
        channel, sequence, log_time_ns, publish_time_ns, payload = record
        if channel not in self.known:
            return False
        self.add_message(channel, log_time_ns, publish_time_ns, sequence, payload)
        return True

    def cut(self) -> None:
        """Let the file end here: what follows is written anew."""
        self._file.cut()

    def close(self) -> None:
        """Pass everything to the disk and give the file back."""
        self._file.close()

    def _looked_into(self, data: bytes) -> dict[int, int]:
        """Register what a chunk registers; how many messages it holds by channel."""
        messages, registrations = unpacked(data)
        for inner in registrations:
            record = registered(self._source, inner, data[inner.body : inner.end])
            if record is not None:
                self.register(record)
        counts: dict[int, int] = {}
        for message in messages:
            counts[message[0]] = counts.get(message[0], 0) + 1
        return counts

    def _copied(self, frame: Frame) -> int:
        """Where a record of the source stands now."""
        place = self._file.tell()
        self._append(self._source.read(frame.offset, frame.end - frame.offset))
        return place


def registered(source: Source, frame: Frame, body: bytes) -> SchemaRecord | Channel | None:
    """The schema or channel that a chunk holds at `frame`; None for anything else."""
    if frame.opcode == Opcode.SCHEMA:
        return parse_body(source, SchemaRecord, body, frame.offset)
    if frame.opcode == Opcode.CHANNEL:
        return parse_body(source, Channel, body, frame.offset)
    return None


def _attachment_index(source: Source, frame: Frame, offset: int) -> AttachmentIndex:
    file = parse(source, Attachment, frame)
    return AttachmentIndex(
        offset=offset,
        length=frame.end - frame.offset,
        log_time=file.log_time,
        create_time=file.create_time,
        data_size=len(file.data),
        name=file.name,
        media_type=file.media_type,
    )
