"""Gives a recording an end whose recorder was killed, with all that can be had of its last chunk.

What is whole stays where it is, byte for byte; the torn end is cut off, what decompresses of a
torn chunk is written anew, and the summary is made as the recorder would have made it. Every chunk
is decompressed and held against its CRC on the way, but its messages are not looked at: how many
they are stands in the index behind it. Messages outside of chunks, as other writers leave them, go
into chunks where there is a new file for them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from struct import Struct
from typing import NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from .. import codec
from ..errors import RecordingError, WireError
from .builder import CHUNK_BYTES
from .contents import END, RUN, RunEnd, RunHeader, from_metadata, to_metadata
from .index import Index, index_of
from .reader import known_channel
from .records import (
    HEAD,
    MAX_RECORD_BYTES,
    Frame,
    RawMessage,
    Source,
    attachment,
    chunk_data,
    frames,
    parse,
)
from .resumed import Resumed, registered

_CHUNK = Struct("<QQQIL")
"""Start, end, size, CRC, length of the compression's name."""
_MESSAGE = Struct("<HIQQ")
_INDEX_HEAD = Struct("<HI")
Record = Schema | Channel | RawMessage
_KINDS: Mapping[int, type[Metadata | Schema | Channel]] = {
    Opcode.METADATA: Metadata,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
}


class Recovery(NamedTuple):
    """What became of a recording.

    Attributes:
        was_whole: nothing had to be done.
        messages: in it now; salvaged: of them, those of the torn chunk.
        bytes_before, bytes_after: size of the file.
        lost_bytes: that could not be read; damage: why, for each stretch of them.
    """

    path: str
    was_whole: bool
    messages: int
    salvaged: int
    bytes_before: int
    bytes_after: int
    lost_bytes: int
    damage: tuple[str, ...]


class _Whole(NamedTuple):
    """A record that stays, or a run of messages; of a chunk, also the indexes behind it."""

    frame: Frame
    indexes: dict[int, Frame]


class _Found(NamedTuple):
    """What a file holds.

    Attributes:
        bad: records that do not hold what their checksums say; damage: what is wrong with them.
        end: offset behind the last record; 0 where the file's own end was found.
    """

    whole: list[_Whole]
    bad: list[Frame]
    damage: list[str]
    end: int

    @property
    def has_bare(self) -> bool:
        """Whether there are messages outside of chunks."""
        return any(one.frame.opcode == Opcode.MESSAGE for one in self.whole)

    @property
    def is_bad_within(self) -> bool:
        """Whether something good follows on something bad."""
        return bool(self.bad and self.whole and self.whole[-1].frame.offset > self.bad[0].offset)


def recover(path: Path, target: Path | None = None) -> Recovery:
    """Recover a recording in place, or what is good of it into a new file.

    Recovering it again changes nothing. Should this process be killed as well, the recording is
    torn as before.

    Args:
        target: must not exist; what is good behind a damaged chunk is kept in it too.

    Raises:
        RecordingError: no recording of ours, of a newer format, not readable, not writable, or (in
            place) damaged before its end, where cutting would lose what is good.
    """
    source = Source(path)
    try:
        found = _look_through(source)
        texts = _metadata(source, found)
        if RUN not in texts:
            why = f"no metadata {RUN}"
            raise RecordingError("not a recording of crossfix", where=source.name, got=why)
        from_metadata(RunHeader, texts[RUN], source.name)  # one of a newer format is left alone
        if target is None:
            index = None if found.end or found.bad else index_of(source)
            _require_mendable(source, found, index)
            if index and index.is_whole and (found.has_bare or not index.condition):
                return _untouched(source, index)
        return _write(source, found, target or path, has_end=END in texts)
    finally:
        source.close()


def _require_mendable(source: Source, found: _Found, index: Index | None) -> None:
    """Refuse to mend in place what would lose something good by it."""
    if found.is_bad_within:
        what, got = "damaged before its end", found.damage[0]
        keeps = "keeps what is good before and after"
    elif found.has_bare and not (index and index.is_whole):
        what, got = "cannot be mended in place", "messages outside of chunks"
        keeps = "puts them into chunks"
    else:
        return
    raise RecordingError(what, where=source.name, got=got, expected=f"--output NEW, which {keeps}")


def _look_through(source: Source) -> _Found:
    """Every record up to the first that cannot be framed."""
    found = _Found([], [], [], len(MCAP0_MAGIC))
    try:
        for frame in frames(source, found.end):
            if frame.opcode == Opcode.DATA_END:
                return found._replace(end=0)
            try:
                _check(source, frame, found)
            except RecordingError as error:
                found.bad.append(frame)
                found.damage.append(str(error))
            found = found._replace(end=frame.end)
    except RecordingError as error:
        found.damage.append(str(error))
    return found


def _check(source: Source, frame: Frame, found: _Found) -> None:
    """Keep a record that holds what its checksums say.

    Raises:
        RecordingError: it does not.
    """
    if frame.opcode == Opcode.MESSAGE_INDEX:
        channel, length = _INDEX_HEAD.unpack(source.read(frame.body, _INDEX_HEAD.size))
        if length != frame.length - _INDEX_HEAD.size or not _follows_a_chunk(found):
            raise source.damaged("no message index", frame.offset)
        found.whole[-1].indexes[channel] = frame
        return
    if frame.opcode == Opcode.MESSAGE:
        _check_message(source, frame, found)
        return
    if frame.opcode == Opcode.CHUNK:
        chunk_data(source, frame)
    elif frame.opcode == Opcode.ATTACHMENT:
        attachment(source, frame)
    elif frame.opcode in _KINDS:
        parse(source, _KINDS[frame.opcode], frame)
    elif frame.opcode != Opcode.HEADER:
        raise source.damaged(f"no place for opcode {frame.opcode:#x}", frame.offset)
    found.whole.append(_Whole(frame, {}))


def _check_message(source: Source, frame: Frame, found: _Found) -> None:
    """Keep a message outside of a chunk: as one run with those before it, up to some size."""
    if frame.length < _MESSAGE.size:
        raise source.damaged("no message", frame.offset)
    run = found.whole[-1].frame if found.whole else frame
    follows = run.opcode == Opcode.MESSAGE and run.end == frame.offset
    if follows and frame.end - run.offset <= CHUNK_BYTES:
        length = frame.end - run.offset - HEAD.size
        found.whole[-1] = _Whole(Frame(Opcode.MESSAGE, run.offset, length), {})
    else:
        found.whole.append(_Whole(frame, {}))


def _follows_a_chunk(found: _Found) -> bool:
    """Whether the last record that is no index is a chunk that is kept."""
    is_chunk = bool(found.whole) and found.whole[-1].frame.opcode == Opcode.CHUNK
    return is_chunk and not (found.bad and found.bad[-1].offset > found.whole[-1].frame.offset)


def _metadata(source: Source, found: _Found) -> dict[str, dict[str, str]]:
    kept = (whole.frame for whole in found.whole if whole.frame.opcode == Opcode.METADATA)
    records = (parse(source, Metadata, frame) for frame in kept)
    return {record.name: record.metadata for record in records}


def _untouched(source: Source, index: Index) -> Recovery:
    messages = sum(index.counts.values())
    return Recovery(source.name, True, messages, 0, source.size, source.size, 0, ())


def _write(source: Source, found: _Found, target: Path, *, has_end: bool) -> Recovery:
    """Take over what is whole, salvage what is torn, and end the file."""
    whole = list(found.whole)
    last = whole.pop().frame if found.end and whole[-1].frame.opcode == Opcode.CHUNK else None
    resumed = Resumed(source, target)
    try:
        for one in whole:
            _take(source, resumed, one, found)
        # the index behind the last chunk may be torn, so that chunk is written anew as well
        again = list(_records(source, chunk_data(source, last))) if last else []
        torn = list(_sensible(_salvaged(source, found.end), resumed.known))
        resumed.cut()
        for record in again:
            resumed.write_again(record)
        salvaged = sum(map(resumed.write_again, torn))
        resumed.flush()
        if not has_end:
            resumed.add_metadata(END, to_metadata(_end(resumed.messages)))
        resumed.finish()
    finally:
        resumed.close()
    return Recovery(
        path=str(target),
        was_whole=False,
        messages=resumed.messages,
        salvaged=salvaged,
        bytes_before=source.size,
        bytes_after=target.stat().st_size,
        lost_bytes=sum(frame.end - frame.offset for frame in found.bad),
        damage=tuple(found.damage),
    )


def _take(source: Source, resumed: Resumed, one: _Whole, found: _Found) -> None:
    """Take a record over; behind a lost chunk with what the index knows of its channels."""
    if one.frame.opcode == Opcode.MESSAGE:
        _take_run(source, resumed, one.frame, found)
        return
    resumed.flush()
    if one.frame.opcode != Opcode.CHUNK:
        resumed.take(one.frame)
        return
    if found.bad and found.bad[0].offset < one.frame.offset and not resumed.has_declared:
        index = index_of(source)
        resumed.declare([*index.schemas.values(), *index.channels.values()])
    try:
        resumed.take_chunk(one.frame, one.indexes, looking=bool(found.damage))
    except RecordingError as error:
        found.bad.append(one.frame)
        found.damage.append(str(error))


def _take_run(source: Source, resumed: Resumed, run: Frame, found: _Found) -> None:
    """Put a run of messages into a chunk."""
    data = source.read(run.offset, run.end - run.offset)
    lost = sum(not resumed.write_again(record) for record in _records(source, data))
    if lost:
        found.bad.append(run)
        found.damage.append(str(source.damaged(f"{lost} messages of no channel", run.offset)))


def _end(messages: int) -> RunEnd:
    return RunEnd(
        reason="recovered: the recorder never ended it",
        received=messages,
        recorded=messages,
        torn=True,
    )


def _salvaged(source: Source, end: int) -> Iterator[Record]:
    """Records of a chunk that begins at `end` and is torn, as far as they decompress.

    Where a message is not of the times that the chunk spans, the rest is left.
    """
    if not end or source.size < end + HEAD.size + _CHUNK.size:
        return
    torn = source.read(end, min(source.size - end, MAX_RECORD_BYTES))
    opcode, _ = HEAD.unpack_from(torn)
    start_ns, end_ns, _, _, name_length = _CHUNK.unpack_from(torn, HEAD.size)
    data_at = HEAD.size + _CHUNK.size + name_length + 8
    if opcode != Opcode.CHUNK or name_length > 8 or data_at >= len(torn):
        return
    name = torn[HEAD.size + _CHUNK.size : data_at - 8]
    for record in _records(source, _decompressed(name, torn[data_at:])):
        if isinstance(record, tuple) and not start_ns <= record[2] <= end_ns:
            return
        yield record


def _sensible(records: Iterable[Record], channels: Mapping[int, Channel]) -> Iterator[Record]:
    """Records of a torn chunk up to the first message that cannot be one of its channel.

    No checksum says whether they are right: behind a tear may stand anything.
    """
    known = {number: known_channel(channel) for number, channel in channels.items()}
    for record in records:
        if isinstance(record, Channel):
            known.setdefault(record.id, known_channel(record))
        elif isinstance(record, tuple) and (channel := known.get(record[0])):
            try:
                codec.decode(channel.address.topic.message, record[4], channel.encoding)
            except WireError:
                return
        yield record


def _decompressed(name: bytes, torn: bytes) -> bytes:
    """What can be had of data that ends too early."""
    try:
        if name == b"zstd":
            return zstandard.ZstdDecompressor().decompressobj().decompress(torn)
        if name == b"lz4":
            decompressed: bytes = lz4.frame.LZ4FrameDecompressor().decompress(torn)
            return decompressed
    except (zstandard.ZstdError, RuntimeError):
        return b""
    return torn if not name else b""


def _records(source: Source, data: bytes) -> Iterator[Record]:
    """The records in a chunk up to the first that is not whole."""
    offset = 0
    while offset + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, offset)
        frame = Frame(opcode, offset, length)
        if frame.end > len(data):
            return
        body = data[frame.body : frame.end]
        if frame.opcode == Opcode.MESSAGE:
            if len(body) < _MESSAGE.size:
                return
            yield (*_MESSAGE.unpack_from(body), body[_MESSAGE.size :])
        else:
            try:
                record = registered(source, frame, body)
            except RecordingError:
                return
            if record is not None:
                yield record
        offset = frame.end
