"""Reads recordings, finished or not, in constant memory, and never a number that was not written.

Every chunk and attachment is checked by its CRC before anything of it is given out. A file whose
writer was killed is read to its last whole chunk; what could be salvaged of a torn one is left.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from struct import error as StructError  # noqa: N812 - a class, whatever it is called
from types import TracebackType
from typing import Any, Literal, NamedTuple

from mcap.opcode import Opcode

from .. import codec, keys
from .. import messages as m
from ..errors import RecordingError, WireError
from ..keys import Address, Role, Topic
from .contents import END, RUN, SCENARIO, STATISTICS, Attachment, RunEnd, RunHeader, from_metadata
from .index import Index, Span, data_crc, index_of
from .recorded import Recorded, in_file_order, in_log_time_order
from .records import RawMessage, Source, attachment, chunk_data, frames, unpacked
from .summary import Summary, channel_summaries

__all__ = [
    "Attachment",
    "Recorded",
    "Recording",
    "RunEnd",
    "RunHeader",
    "Summary",
    "digests",
    "open_recording",
    "output_bytes",
    "summary",
]

Order = Literal["file", "log_time"]
_NEVER_NS = 2**64


class Recording:
    """A recording that is open; made by `open_recording`.

    Attributes:
        header: what was run.
        end: how it ended; None where the recorder could not say.
        condition: what is wrong with the file, in words; empty if nothing is.
        index: channels, counts, times.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.index: Index = index_of(source)
        self.condition = self.index.condition
        texts = {found.name: found.metadata for found in self.index.metadata}
        if RUN not in texts:
            why = self.condition or f"no metadata {RUN}"
            raise RecordingError("not a recording of crossfix", where=source.name, got=why)
        self.header = from_metadata(RunHeader, texts[RUN], source.name)
        self.end = from_metadata(RunEnd, texts[END], source.name) if END in texts else None

    @cached_property
    def attachments(self) -> Mapping[str, Attachment]:
        """The files within, by name."""
        found = [attachment(self._source, frame) for frame in self.index.attachments]
        return {a.name: Attachment(a.name, a.media_type, a.data) for a in found}

    @cached_property
    def scenario(self) -> m.DeclaredScenario:
        """The declared scenario of the run.

        Raises:
            RecordingError: it is not attached.
        """
        if SCENARIO not in self.attachments:
            raise RecordingError(f"no attachment {SCENARIO}", where=self._source.name)
        return codec.decode(m.DeclaredScenario, self.attachments[SCENARIO].data, "json")

    def messages(
        self,
        topics: Collection[Topic] | None = None,
        roles: Collection[Role] | None = None,
        order: Order = "file",
        start_ns: int = 0,
        stop_ns: int = _NEVER_NS,
    ) -> Iterator[Recorded]:
        """The messages of some topics and roles with start_ns <= log time < stop_ns.

        In the order of log time messages of one time keep the order of the file. Memory holds one
        chunk, in that order also those whose times overlap: none, in files of our own writer.
        Channels that are not of the wire are passed over.

        Raises:
            RecordingError: at the first damage, after all that lies before it.
        """
        wanted = self._wanted(topics, roles)
        spans = [s for s in self.index.spans if s.start_ns < stop_ns and s.end_ns >= start_ns]
        in_order = in_file_order if order == "file" else in_log_time_order
        count = 0
        for message in in_order(spans, lambda span: self._in_span(span, wanted)):
            count += 1
            if start_ns <= message.log_time_ns < stop_ns:
                yield message
        if self.index.damage is not None:
            raise self.index.damage
        if len(spans) == len(self.index.spans):
            self._require_count(count, wanted)

    def statistics(self) -> Iterator[m.Statistics]:
        """The recorder's counts over time."""
        named = [c.id for c in self.index.channels.values() if c.topic == STATISTICS]
        for span in self.index.spans:
            for channel, _, _, _, payload in self._raw(span):
                if channel in named:
                    yield codec.decode(m.Statistics, payload)

    def check(self) -> None:
        """Read everything once and hold it against every CRC there is.

        Raises:
            RecordingError: what is wrong first; a file without an end is not.
        """
        for _ in self.messages():
            pass
        _ = self.attachments
        data_crc(self._source, self.index)

    def close(self) -> None:
        """Give back the file."""
        self._source.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _wanted(
        self, topics: Collection[Topic] | None, roles: Collection[Role] | None
    ) -> dict[int, _Channel]:
        """Channel id -> what its messages have in common, of the channels asked for."""
        wanted = {}
        for channel in self.index.channels.values():
            address = _address(channel.topic)
            if (
                address is not None
                and (topics is None or address.topic in topics)
                and (roles is None or address.topic.role in roles)
            ):
                encoding = channel.metadata.get("encoding", channel.message_encoding)
                wanted[channel.id] = _Channel(address, channel.topic, encoding)
        return wanted

    def _in_span(self, span: Span, wanted: Mapping[int, _Channel]) -> Iterator[Recorded]:
        for number, sequence, log_time_ns, publish_time_ns, payload in self._raw(span):
            channel = wanted.get(number)
            if channel is not None:
                address, key, encoding = channel
                yield Recorded(
                    address, key, payload, encoding, log_time_ns, publish_time_ns, sequence
                )
            elif number not in self.index.channels:
                raise self._source.damaged(f"message on unknown channel {number}", span.offset)

    def _raw(self, span: Span) -> list[RawMessage]:
        frame = next(frames(self._source, span.offset), None)
        if frame is not None and frame.opcode == Opcode.CHUNK and frame.end == span.end:
            data = chunk_data(self._source, frame)
        elif frame is not None and frame.opcode == Opcode.MESSAGE:
            data = self._source.read(span.offset, span.end - span.offset)
        else:
            raise self._source.damaged("index points nowhere", span.offset)
        try:
            return unpacked(data).messages
        except StructError as error:
            raise self._source.damaged(str(error), span.offset) from None

    def _require_count(self, count: int, wanted: Collection[int]) -> None:
        expected = sum(self.index.counts.get(channel, 0) for channel in wanted)
        if count != expected:
            raise RecordingError(
                "index and messages disagree",
                where=self._source.name,
                got=f"{count} messages",
                expected=str(expected),
            )


class _Channel(NamedTuple):
    address: Address
    key: str
    encoding: str


def open_recording(path: Path | str) -> Recording:
    """Open a recording; close it, or use it in a `with`.

    Raises:
        RecordingError: no file, not MCAP, no recording of ours, a newer format, a damaged header.
    """
    source = Source(Path(path))
    try:
        return Recording(source)
    except BaseException:
        source.close()
        raise


def output_bytes(recording: Recording, role: Role = Role.OUTPUT) -> Iterator[tuple[str, bytes]]:
    """Key and payload of every output in the order of the file: equal runs give equal ones."""
    for message in recording.messages(roles=(role,)):
        yield message.key, message.payload


def digests(recording: Recording, role: Role = Role.OUTPUT) -> dict[str, str]:
    """Key -> SHA-256 of its payloads with their lengths, whatever the chunks and compression."""
    sums: dict[str, Any] = defaultdict(sha256)
    for key, payload in output_bytes(recording, role):
        sums[key].update(len(payload).to_bytes(8, "little") + payload)
    return {key: sums[key].hexdigest() for key in sorted(sums)}


def summary(path: Path | str) -> Summary:
    """What a recording holds, without reading its messages where the file has an index.

    Raises:
        RecordingError: as `open_recording`.
    """
    with open_recording(path) as recording:
        index = recording.index
        return Summary(
            path=str(path),
            header=recording.header,
            end=recording.end,
            condition=recording.condition,
            bytes=Path(path).stat().st_size,
            messages=sum(index.counts.values()),
            start_ns=min((span.start_ns for span in index.spans), default=0),
            end_ns=max((span.end_ns for span in index.spans), default=0),
            channels=channel_summaries(index),
            attachments=tuple(recording.attachments),
        )


def _address(key: str) -> Address | None:
    """A channel of someone else's has no address."""
    try:
        return keys.parse(key)
    except WireError:
        return None
