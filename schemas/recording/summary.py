"""What a recording holds, as `crossfix info` shows it."""

from __future__ import annotations

from typing import NamedTuple

from mcap.records import Channel

from ..messages import Statistics
from .contents import RunEnd, RunHeader
from .index import Index


class ChannelSummary(NamedTuple):
    """One channel: a key in one encoding.

    Attributes:
        role: as in `keys.Role`; empty for a channel that is not of the wire.
        message: type of its messages, such as crossfix.Step.
        encoding: msgpack or json.
    """

    key: str
    role: str
    message: str
    encoding: str
    messages: int


class Summary(NamedTuple):
    """A recording without its messages.

    Attributes:
        end: None where the recorder could not say how it ended.
        condition: what is wrong with the file; empty if nothing is.
        bytes: size of the file.
        start_ns, end_ns: first and last log time; 0 where there is no message.
        channels: by key.
        attachments: names.
        statistics: the recorder's counts of every key; None where it never came to its end.
    """

    path: str
    header: RunHeader
    end: RunEnd | None
    condition: str
    bytes: int
    messages: int
    start_ns: int
    end_ns: int
    channels: tuple[ChannelSummary, ...]
    attachments: tuple[str, ...]
    statistics: Statistics | None = None


def channel_summaries(index: Index) -> tuple[ChannelSummary, ...]:
    """Every channel of an index, by key."""
    return tuple(sorted(_channel(index, channel) for channel in index.channels.values()))


def _channel(index: Index, channel: Channel) -> ChannelSummary:
    schema = index.schemas.get(channel.schema_id)
    return ChannelSummary(
        key=channel.topic,
        role=channel.metadata.get("role", ""),
        message=schema.name if schema else "",
        encoding=channel.message_encoding,
        messages=index.counts.get(channel.id, 0),
    )
