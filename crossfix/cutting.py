"""A part of a recording as a recording of its own, which can be fused again."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from crossfix.making import Made, attachments_of, end_of, header_of, made, put, writing
from crossfix.reading_progress import Show, unseen
from crossfix.selecting import Selection, selected
from schemas import codec, keys
from schemas.bus.ledger import StreamKey
from schemas.bus.spans import Spans
from schemas.errors import RecordingError, WireError
from schemas.messages import Closed, Input, StreamEnd, StreamSpan
from schemas.recording.contents import RunHeader
from schemas.recording.reader import Recorded, Recording


class Cut(NamedTuple):
    """What was cut out.

    Attributes:
        left_out: messages that are not in the new recording.
        restated: Closed messages that named what is left out, and now give it up.
    """

    made: Made
    left_out: int
    restated: int


class _Held(NamedTuple):
    """The inputs of a part.

    Attributes:
        closings: in the order of their steps.
        early: latched inputs of before; their Closed may lie there as well.
    """

    numbers: Mapping[StreamKey, Spans]
    closings: Sequence[Closed]
    early: Sequence[Input]


def cut(
    recording: Recording,
    path: Path,
    selection: Selection,
    show: Show = unseen,
) -> Cut:
    """Write a part of a recording as one that stands alone, attachments and latched state included.

    A Closed names inputs by number. Where some of them are left out, it says in the new recording
    that they were given up, as a fusion centre does that has come too late for them: so the part
    can be fused again, and gives what would have been fused without the rest.

    Raises:
        RecordingError: damaged, or nothing is left.
        CrossfixError: the selection means nothing; LaunchError: `path` exists or cannot be made.
    """
    total = _messages_in(recording)
    restated = _restated(_held(recording, selection))
    done = 0
    with writing(path, _header(recording, selection), attachments_of(recording)) as writer:
        for message in selected(recording, selection):
            put(writer, _in_part(message, restated))
            done += 1
            show(done, message.log_time_ns)
        if not done:
            hint = "keys and times as `crossfix info` shows them"
            raise RecordingError("nothing is left", got=str(selection), expected=hint)
        writer.close(end_of(recording, "cut", done))
    return Cut(made(path, done), total - done, len(restated))


def _messages_in(recording: Recording) -> int:
    """Messages on channels of the wire."""
    count = 0
    for number, channel in recording.index.channels.items():
        with suppress(WireError):
            keys.parse(channel.topic)
            count += recording.index.counts.get(number, 0)
    return count


def _held(recording: Recording, selection: Selection) -> _Held:
    """What a part holds of the inputs."""
    numbers: defaultdict[StreamKey, Spans] = defaultdict(Spans)
    closings: dict[int, Closed] = {}
    early: list[Input] = []
    for message in selected(recording, selection):
        if message.address.topic.role is not keys.Role.INPUT:
            continue
        with suppress(WireError):
            decoded = message.decode()
            if isinstance(decoded, Closed):
                closings.setdefault(decoded.step, decoded)
            elif isinstance(decoded, Input):
                numbers[_stream(decoded)].add(decoded.seq, decoded.seq)
                if not closings:
                    early.append(decoded)
    return _Held(numbers, [closings[step] for step in sorted(closings)], early)


def _restated(held: _Held) -> dict[int, Closed]:
    """The Closed messages that have to be put in other words, by step."""
    restated: dict[int, Closed] = {}
    seen: dict[StreamKey, int] = {}
    given_up: defaultdict[StreamKey, Spans] = defaultdict(Spans)
    for n, closed in enumerate(held.closings):
        manifest = [*closed.manifest, *(_unnamed(held) if n == 0 else ())]
        for span in closed.gave_up:
            given_up[_stream(span)].add(span.first, span.last)
        lacking: list[StreamSpan] = []
        for end in manifest:
            lacking += _lacking(end, held, seen, given_up)
        late = [piece for span in closed.late for piece in _there(span, held)]
        new = replace(closed, manifest=manifest, gave_up=[*closed.gave_up, *lacking], late=late)
        if new != closed:
            restated[closed.step] = new
    return restated


def _unnamed(held: _Held) -> list[StreamEnd]:
    """Streams of latched inputs that no Closed of the part names: the first one has to."""
    named = {_stream(end) for closed in held.closings for end in closed.manifest}
    last: dict[StreamKey, Input] = {
        _stream(message): message for message in held.early if _stream(message) not in named
    }
    return [
        StreamEnd(carrier=m.carrier, boot=m.boot, stream=m.stream, last_seq=m.seq)
        for m in last.values()
    ]


def _lacking(
    end: StreamEnd,
    held: _Held,
    seen: dict[StreamKey, int],
    given_up: Mapping[StreamKey, Spans],
) -> list[StreamSpan]:
    """What one end of a manifest names anew that is neither there nor given up."""
    key = _stream(end)
    first, seen[key] = seen.get(key, 0) + 1, max(end.last_seq, seen.get(key, 0))
    holes = held.numbers.get(key, Spans()).holes(first, end.last_seq)
    return [
        StreamSpan(carrier=key.process, boot=key.boot, stream=key.stream, first=a, last=b)
        for hole in holes
        for a, b in given_up.get(key, Spans()).holes(*hole)
    ]


def _there(span: StreamSpan, held: _Held) -> list[StreamSpan]:
    """The pieces of a late span that the part holds."""
    missing = Spans()
    for first, last in held.numbers.get(_stream(span), Spans()).holes(span.first, span.last):
        missing.add(first, last)
    return [replace(span, first=a, last=b) for a, b in missing.holes(span.first, span.last)]


def _in_part(message: Recorded, restated: Mapping[int, Closed]) -> Recorded:
    if message.address.topic is not keys.CLOSED_FUSION or not restated:
        return message
    with suppress(WireError):
        closed = message.decode()
        if isinstance(closed, Closed) and closed.step in restated:
            encoding = codec.encoding_of(Closed)
            payload = codec.encode(restated[closed.step])
            return message._replace(payload=payload, encoding=encoding)
    return message


def _stream(of: Input | StreamEnd | StreamSpan) -> StreamKey:
    return StreamKey(of.carrier, of.boot, of.stream)


def _header(recording: Recording, selection: Selection) -> RunHeader:
    told = {
        "verb": "cut",
        "from_s": f"{selection.start_s:g}",
        "until_s": "" if selection.until_s is None else f"{selection.until_s:g}",
        "roles": ", ".join(selection.roles),
        "keys": ", ".join(selection.keys),
        "without": ", ".join(selection.without),
    }
    return header_of(recording, {name: text for name, text in told.items() if text})
