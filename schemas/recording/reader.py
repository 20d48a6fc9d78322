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
from typing import Any, Literal

from mcap.opcode import Opcode
from mcap.records import Channel

from .. import codec, keys
from .. import messages as m
from ..errors import RecordingError, WireError
from ..keys import Role, Topic
from .contents import END, RUN, SCENARIO, STATISTICS, Attachment, RunEnd, RunHeader, from_metadata
from .index import Index, Span, data_crc, index_of, unchecked
from .recorded import (
    Channels,
    KnownChannel,
    Recorded,
    in_file_order,
    in_time_order,
    select,
    stamp_ns,
)
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

Order = Literal["file", "log_time", "stamp"]
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

        In an order of time messages of one time keep the order of the file; in that of the
        senders' stamps the bounds are stamps as well, and everything is read twice. Memory holds
        one chunk, in an order of time also those whose times overlap: for the log time none, in
        files of our own writer. Channels that are not of the wire are passed over.

        Raises:
            RecordingError: at the first damage, after all that lies before it.
        """
        wanted = self._wanted(topics, roles)
        channels = dict.fromkeys(self.index.channels) | wanted
        others = self.index.channels.keys() - wanted.keys()
        spans = [span for span in self.index.spans if not span.is_only_of(others)]
        count = 0
        for message in self._in_order(order, spans, channels, start_ns, stop_ns):
            count += 1
            yield message
        if self.index.damage is not None:
            raise self.index.damage
        if start_ns == 0 and stop_ns == _NEVER_NS:
            self._require_count(count, wanted)

    def latched(self, before_ns: int, roles: Collection[Role] | None = None) -> list[Recorded]:
        """The last value of every latched key before a log time, in the order they were recorded.

        By the index, from there backwards: the rest of the file is not read.

        Raises:
            RecordingError: what has to be read is damaged.
        """
        wanted = self._wanted(None, roles)
        missing = {n: known for n, known in wanted.items() if known.address.topic.latched}
        found: dict[int, list[Recorded]] = {}
        for span in sorted(self.index.spans, reverse=True):
            if not missing:
                break
            others = self.index.channels.keys() - missing.keys()
            if span.start_ns >= before_ns or span.is_only_of(others):
                continue
            channels = dict.fromkeys(self.index.channels) | missing
            last = {m.key: m for m in self._read(span, channels, 0, before_ns)}
            found[span.offset] = list(last.values())
            missing = {n: known for n, known in missing.items() if known.key not in last}
        return [message for offset in sorted(found) for message in found[offset]]

    def statistics(self) -> Iterator[m.Statistics]:
        """The recorder's counts over time."""
        named = [c.id for c in self.index.channels.values() if c.topic == STATISTICS]
        for span in self.index.spans:
            for channel, _, _, _, payload in self._raw(span):
                if channel in named:
                    yield codec.decode(m.Statistics, payload)

    def last_statistics(self) -> m.Statistics | None:
        """The recorder's last counts, at its end those of every key; found by the index."""
        named = {c.id for c in self.index.channels.values() if c.topic == STATISTICS}
        others = self.index.channels.keys() - named
        for span in sorted(self.index.spans, reverse=True):
            if not span.is_only_of(others):
                told = [raw[4] for raw in self._raw(span) if raw[0] in named]
                if told:
                    return codec.decode(m.Statistics, told[-1])
        return None

    def check(self) -> None:
        """Read everything once and hold it against every CRC there is.

        Raises:
            RecordingError: what is wrong first; a file without an end is not.
        """
        for _ in self.messages():
            pass
        _ = self.attachments
        data_crc(self._source, self.index)

    @property
    def unchecked(self) -> int:
        """Stretches of messages without a CRC, in files of other writers: damage is not seen."""
        return unchecked(self._source, self.index)

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
    ) -> dict[int, KnownChannel]:
        """Channel id -> what its messages have in common, of the channels asked for."""
        return {
            number: known
            for number, channel in self.index.channels.items()
            if (known := known_channel(channel)) is not None
            and (topics is None or known.address.topic in topics)
            and (roles is None or known.address.topic.role in roles)
        }

    def _in_order(
        self, order: Order, spans: list[Span], channels: Channels, start_ns: int, stop_ns: int
    ) -> Iterator[Recorded]:
        if order == "stamp":
            return self._by_stamp(spans, channels, start_ns, stop_ns)
        within = [span for span in spans if span.start_ns < stop_ns and span.end_ns >= start_ns]
        in_order = in_file_order if order == "file" else in_time_order
        return in_order(within, lambda span: self._read(span, channels, start_ns, stop_ns))

    def _by_stamp(
        self, spans: list[Span], channels: Channels, start_ns: int, stop_ns: int
    ) -> Iterator[Recorded]:
        def read(span: Span) -> list[Recorded]:
            """The messages of a span within the bounds."""
            messages = self._read(span, channels, 0, _NEVER_NS)
            return [m for m in messages if start_ns <= m.publish_time_ns < stop_ns]

        stamped = []
        for span in spans:
            stamps = [m.publish_time_ns for m in read(span)]
            if stamps:
                stamped.append(span._replace(start_ns=min(stamps), end_ns=max(stamps)))
        return in_time_order(stamped, read, stamp_ns)

    def _read(self, span: Span, channels: Channels, start_ns: int, stop_ns: int) -> list[Recorded]:
        try:
            return select(self._data(span), channels, start_ns, stop_ns)
        except StructError as error:
            raise self._source.damaged(str(error), span.offset) from None
        except KeyError as error:
            raise self._source.damaged(f"message on unknown channel {error}", span.offset) from None

    def _raw(self, span: Span) -> list[RawMessage]:
        try:
            return unpacked(self._data(span)).messages
        except StructError as error:
            raise self._source.damaged(str(error), span.offset) from None

    def _data(self, span: Span) -> bytes:
        """The records of a span."""
        frame = next(frames(self._source, span.offset), None)
        if frame is not None and frame.opcode == Opcode.CHUNK and frame.end == span.end:
            return chunk_data(self._source, frame)
        if frame is not None and frame.opcode == Opcode.MESSAGE:
            return self._source.read(span.offset, span.end - span.offset)
        raise self._source.damaged("index points nowhere", span.offset)

    def _require_count(self, count: int, wanted: Collection[int]) -> None:
        expected = sum(self.index.counts.get(channel, 0) for channel in wanted)
        if count != expected:
            raise RecordingError(
                "index and messages disagree",
                where=self._source.name,
                got=f"{count} messages",
                expected=str(expected),
            )


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
            statistics=recording.last_statistics() if recording.end else None,
        )


def known_channel(channel: Channel) -> KnownChannel | None:
    """What its messages have in common; None for a channel of someone else's."""
    try:
        address = keys.parse(channel.topic)
    except WireError:
        return None
    encoding = channel.metadata.get("encoding", channel.message_encoding)
    return KnownChannel(address, channel.topic, encoding)
