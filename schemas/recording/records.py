"""MCAP records as bytes in a file: framed by their lengths, parsed whole, checked by their CRCs.

The library's own readers take what is left at a torn end for a whole record; here a record is read
only if all of it is there.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from struct import Struct
from struct import error as StructError  # noqa: N812 - a class, whatever it is called
from typing import NamedTuple, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Attachment, Chunk
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from ..errors import RecordingError

MAX_RECORD_BYTES = 1024**3
HEAD = Struct("<BQ")
"""Opcode and length of a record."""
_MESSAGE = Struct("<HIQQ")
EXPECTED = "a recording, such as `crossfix run` leaves in recordings/"
_CHUNK_FIXED_BYTES = 40
T = TypeVar("T")


class Frame(NamedTuple):
    """Where a record lies: `offset` of its head, `length` of its body."""

    opcode: int
    offset: int
    length: int

    @property
    def body(self) -> int:
        """Offset of the body."""
        return self.offset + HEAD.size

    @property
    def end(self) -> int:
        """Offset of what follows."""
        return self.body + self.length


RawMessage = tuple[int, int, int, int, bytes]
"""Channel id, sequence, log time [ns], publish time [ns], payload."""


class Unpacked(NamedTuple):
    """The messages of a stretch of records, and where its schemas and channels are."""

    messages: list[RawMessage]
    registrations: list[Frame]


class Source:
    """A file opened for reading at any place; several readers may use it at once.

    Raises:
        RecordingError: it cannot be opened, is empty, or is not MCAP of our version.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        try:
            self._file = path.open("rb", buffering=0)
            self.size = os.fstat(self._file.fileno()).st_size
        except OSError as error:
            raise RecordingError(
                "cannot read", where=self.name, got=error.strerror, expected=EXPECTED
            ) from error
        try:
            self._require_mcap()
        except RecordingError:
            self.close()
            raise

    def read(self, offset: int, length: int) -> bytes:
        """Exactly `length` bytes.

        Raises:
            RecordingError: the file ends before, or the disk fails.
        """
        try:
            data = os.pread(self._file.fileno(), length, offset)
        except OSError as error:
            raise self.damaged(f"cannot read: {error.strerror}", offset) from error
        if len(data) != length:
            raise self.damaged(f"ends {length - len(data)} bytes early", offset)
        return data

    def refresh(self) -> None:
        """See how far the file has grown."""
        self.size = os.fstat(self._file.fileno()).st_size

    def damaged(self, what: str, offset: int) -> RecordingError:
        """The error for something wrong at an offset."""
        return RecordingError(what, where=f"{self.name} at byte {offset}")

    def close(self) -> None:
        """Give back the file."""
        self._file.close()

    def _require_mcap(self) -> None:
        if self.size == 0:
            raise RecordingError("empty file", where=self.name, expected=EXPECTED)
        magic = self.read(0, min(self.size, len(MCAP0_MAGIC)))
        if magic == MCAP0_MAGIC:
            return
        if magic[:5] == MCAP0_MAGIC[:5] and len(magic) == len(MCAP0_MAGIC):
            raise RecordingError("another version of MCAP", where=self.name, got=magic[5:6])
        raise RecordingError("not an MCAP file", where=self.name, got=magic, expected=EXPECTED)


def frames(source: Source, offset: int) -> Iterator[Frame]:
    """The records from `offset` on, as far as they are whole.

    Raises:
        RecordingError: a length that no record has.
    """
    while offset + HEAD.size <= source.size:
        opcode, length = HEAD.unpack(source.read(offset, HEAD.size))
        frame = Frame(opcode, offset, length)
        if frame.length > MAX_RECORD_BYTES:
            raise source.damaged("no record is so long", offset)
        if frame.end > source.size:
            return
        yield frame
        offset = frame.end


def unpacked(data: bytes) -> Unpacked:
    """The records in a decompressed chunk or another stretch that holds whole ones only.

    Raises:
        struct.error: it holds one that is not whole.
    """
    messages: list[RawMessage] = []
    registrations: list[Frame] = []
    head, fields = HEAD.unpack_from, _MESSAGE.unpack_from
    offset, size = 0, len(data)
    while offset < size:
        opcode, length = head(data, offset)
        body = offset + 9
        end = body + length
        if end > size:
            raise StructError("record reaches beyond its chunk")
        if opcode == 5:  # Opcode.MESSAGE, whose look-up would take as long as the rest
            messages.append((*fields(data, body), data[body + 22 : end]))
        else:
            registrations.append(Frame(opcode, offset, length))
        offset = end
    return Unpacked(messages, registrations)


def parse(source: Source, kind: type[T], frame: Frame) -> T:
    """A record of one of the library's kinds.

    Raises:
        RecordingError: its body does not hold one.
    """
    return parse_body(source, kind, source.read(frame.body, frame.length), frame.offset)


def parse_body(source: Source, kind: type[T], body: bytes, offset: int) -> T:
    """The same from bytes that have been read; `offset` is for the error."""
    stream = ReadDataStream(BytesIO(body))
    try:
        record: T = kind.read(stream)  # type: ignore[attr-defined]
    except (McapError, StructError, ValueError) as error:
        what = str(error) or "ends early"
        raise source.damaged(f"{kind.__name__} record: {what}", offset) from None
    if stream.count != len(body):
        raise source.damaged(f"{kind.__name__} record of another length", offset)
    return record


def chunk_data(source: Source, frame: Frame) -> bytes:
    """What a chunk holds, decompressed.

    Raises:
        RecordingError: it does not decompress, or not to what its CRC says.
    """
    chunk = parse(source, Chunk, frame)
    if _CHUNK_FIXED_BYTES + len(chunk.compression) + len(chunk.data) != frame.length:
        raise source.damaged("chunk of another length", frame.offset)
    if chunk.uncompressed_size > MAX_RECORD_BYTES:
        raise source.damaged("no chunk is so large", frame.offset)
    try:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    except Exception as error:  # each decompressor has errors of its own kind
        raise source.damaged(f"chunk: {error}", frame.offset) from None
    if size != chunk.uncompressed_size:
        raise source.damaged("chunk of another size than it says", frame.offset)
    return stream.read(size)


def attachment(source: Source, frame: Frame) -> Attachment:
    """An attachment whose CRC holds.

    Raises:
        RecordingError: it does not.
    """
    body = source.read(frame.body, frame.length)
    crc = int.from_bytes(body[-4:], "little")
    if crc and crc != zlib.crc32(body[:-4]):
        raise source.damaged("attachment damaged: CRC differs", frame.offset)
    return parse_body(source, Attachment, body, frame.offset)
