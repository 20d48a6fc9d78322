"""Two recordings held against each other: digests, the first difference, figures of every field."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from hashlib import sha256
from typing import Any, NamedTuple

from crossfix.differences.fields import ENCODING, EXACT, FieldChange, Rules, changes, unpacked
from crossfix.differences.figures import FieldFigures, FieldSummary
from crossfix.differences.pairing import Pair, channel_of, pairs
from crossfix.reading_progress import Show, unseen
from crossfix.settings_changes import SettingChange, changes_between
from schemas.errors import CrossfixError, RecordingError
from schemas.keys import Role
from schemas.recording.reader import Recorded, Recording

ROLES = (Role.INPUT, Role.TRUTH, Role.OUTPUT)
"""What is compared unless told otherwise: the rest tells of the wall clock."""
_RANKS = {role: rank for rank, role in enumerate((Role.INPUT, Role.TRUTH, Role.OUTPUT))}


class ChannelDiff(NamedTuple):
    """One channel of both recordings.

    Attributes:
        before, after: messages in each; digest_before, digest_after: SHA-256 of their payloads
            with their lengths in the order of the file, whatever the chunks and compression.
        changed: pairs that differ; close: that differ in bytes, but by nothing that counts.
        only_before, only_after: messages that one of them lacks.
    """

    channel: str
    role: str
    before: int
    after: int
    digest_before: str
    digest_after: str
    changed: int
    close: int
    only_before: int
    only_after: int

    @property
    def is_same(self) -> bool:
        """Whether nothing differs that counts."""
        return not (self.changed or self.only_before or self.only_after)


class FirstDifference(NamedTuple):
    """The earliest message that differs, by its own time; of one time inputs come first.

    Attributes:
        sequence: of its sender; t_ns: its stamp.
        field: path within the message; empty where one recording lacks the message.
        only_in: `before` or `after` where the other lacks it.
    """

    channel: str
    sequence: int
    t_ns: int
    field: str
    before: Any
    after: Any
    only_in: str


class Diff(NamedTuple):
    """What two recordings have in common, and what not.

    Attributes:
        settings: of the fusion centre that differ; told, but not counted as a difference.
        fields: by channel and field, for all messages that both have.
    """

    channels: Sequence[ChannelDiff]
    first: FirstDifference | None
    fields: Sequence[FieldSummary]
    settings: Sequence[SettingChange]

    @property
    def is_same(self) -> bool:
        """Whether nothing differs that counts."""
        return self.first is None


def diff(
    before: Recording,
    after: Recording,
    *,
    roles: Sequence[Role] = ROLES,
    channels: Sequence[str] = (),
    rules: Rules = EXACT,
    show: Show = unseen,
) -> Diff:
    """Compare two recordings message by message; order and packing of the files do not matter.

    Args:
        channels: patterns such as `correction/**` of keys after the run; none = all.
        rules: what counts as a difference.

    Raises:
        RecordingError: one is damaged, or there is nothing to compare in either.
    """
    was = _Channels(before, roles, channels)
    became = _Channels(after, roles, channels)
    tally = _Tally(rules)
    for count, pair in enumerate(pairs(was.messages(), became.messages())):
        tally.take(pair)
        show(count, _time_ns(pair))
    found = [tally.channel(name, was, became) for name in sorted({*was.count, *became.count})]
    if not found:
        raise RecordingError("nothing to compare", got="no message of those roles and keys")
    return Diff(found, tally.first, tally.fields(), _settings(before, after))


class _Channels:
    """The messages of one recording that are compared, with a digest of each channel."""

    def __init__(
        self, recording: Recording, roles: Sequence[Role], channels: Sequence[str]
    ) -> None:
        self.count: dict[str, int] = defaultdict(int)
        self.role: dict[str, str] = {}
        self._digests: dict[str, Any] = defaultdict(sha256)
        self._recording, self._roles = recording, roles
        self._channels = channels

    def messages(self) -> Iterator[Recorded]:
        """All of them, in the order of the file."""
        for message in self._recording.messages(roles=self._roles):
            channel = channel_of(message.key)
            if self._channels and not is_named(channel, self._channels):
                continue
            self.count[channel] += 1
            self.role[channel] = message.address.topic.role.value
            payload = message.payload
            self._digests[channel].update(len(payload).to_bytes(8, "little") + payload)
            yield message

    def digest(self, channel: str) -> str:
        """Of all payloads of a channel; empty where there is none."""
        return self._digests[channel].hexdigest() if channel in self._digests else ""


class _Tally:
    """Counts what differs."""

    def __init__(self, rules: Rules) -> None:
        self.first: FirstDifference | None = None
        self._rules = rules
        self._rank: tuple[int, int, str] | None = None
        self._changed: dict[str, int] = defaultdict(int)
        self._close: dict[str, int] = defaultdict(int)
        self._only: dict[tuple[str, str], int] = defaultdict(int)
        self._fields: dict[tuple[str, str], FieldFigures] = defaultdict(FieldFigures)

    def take(self, pair: Pair) -> None:
        """Compare the two messages of a pair."""
        channel = pair.place.channel
        if pair.before is None or pair.after is None:
            side = "after" if pair.before is None else "before"
            self._only[channel, side] += 1
            self._note_first(pair, FieldChange("", None, None), side)
        elif pair.before.payload != pair.after.payload:
            found = self._changes(pair.before, pair.after)
            if not found:
                self._close[channel] += 1
                return
            self._changed[channel] += 1
            self._note_first(pair, found[0], "")
            for field, group in _by_field(found):
                self._fields[channel, field].take(group)

    def channel(self, name: str, was: _Channels, became: _Channels) -> ChannelDiff:
        """What is known of one channel."""
        return ChannelDiff(
            channel=name,
            role=was.role.get(name) or became.role[name],
            before=was.count.get(name, 0),
            after=became.count.get(name, 0),
            digest_before=was.digest(name),
            digest_after=became.digest(name),
            changed=self._changed[name],
            close=self._close[name],
            only_before=self._only[name, "before"],
            only_after=self._only[name, "after"],
        )

    def fields(self) -> list[FieldSummary]:
        """Figures of every field that differs, by channel and path."""
        return [field.summary(*name) for name, field in sorted(self._fields.items())]

    def _changes(self, before: Recorded, after: Recorded) -> list[FieldChange]:
        was, became = (unpacked(m.payload, m.encoding) for m in (before, after))
        found = list(changes(was, became, self._rules))
        if not found and self._rules.are_exact and before.encoding == after.encoding:
            return [FieldChange(ENCODING, before.payload.hex(), after.payload.hex())]
        return found

    def _note_first(self, pair: Pair, change: FieldChange, only_in: str) -> None:
        message = pair.before or pair.after
        assert message is not None  # noqa: S101 (one side of a pair is there)
        role = message.address.topic.role
        t_ns = message.publish_time_ns
        rank = (t_ns, _RANKS.get(role, len(_RANKS)), pair.place.channel)
        if self._rank is None or rank < self._rank:
            self._rank = rank
            place = pair.place
            self.first = FirstDifference(place.channel, place.sequence, t_ns, *change, only_in)


def is_named(channel: str, patterns: Iterable[str]) -> bool:
    """Whether a key after the run is meant by one of the patterns; `**` is any number of chunks."""
    return any(fnmatchcase(channel, pattern.replace("**", "*")) for pattern in patterns)


def _by_field(found: Iterable[FieldChange]) -> Iterator[tuple[str, list[FieldChange]]]:
    groups: dict[str, list[FieldChange]] = defaultdict(list)
    for change in found:
        groups[change.field].append(change)
    yield from groups.items()


def _time_ns(pair: Pair) -> int:
    message = pair.before or pair.after
    return message.log_time_ns if message else 0


def _settings(before: Recording, after: Recording) -> list[SettingChange]:
    """Told where both declare settings that this version knows."""
    try:
        return changes_between(before.scenario, after.scenario)
    except CrossfixError:
        return []
