"""Does a recording hold all that was fused, and does fusing it again give the same bytes?"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from hashlib import blake2b
from itertools import chain
from typing import Any, NamedTuple

import msgpack
import msgspec

from crossfix.differences import EXACT, Rules, changes, first_difference, unpacked
from crossfix.making import is_torn
from crossfix.reading_progress import Show, unseen
from crossfix.refusing import AHEAD
from fusion_center.fuse import Fusible, fuse
from schemas import codec
from schemas.bus.ledger import Ledger, StreamKey
from schemas.bus.spans import Spans
from schemas.errors import RecordingError, WireError
from schemas.keys import Role, parse
from schemas.messages import Closed, Event, Input, Output, StreamSpan
from schemas.recording.reader import Recorded, Recording


class Place(NamedTuple):
    """Which output: the message `seq` of a key."""

    key: str
    seq: int


class Difference(NamedTuple):
    """Where a recording and its re-fusion first differ.

    Attributes:
        field: path within the message; empty where one side has no such message at all.
        recorded, fused: what stands there; None where there is nothing.
    """

    key: str
    step: int
    field: str
    recorded: Any
    fused: Any


class Comparison(NamedTuple):
    """What came of fusing a recording again.

    Attributes:
        equal: outputs that came out as recorded: byte for byte, or within the rules.
        close: of them, those that differ in bytes.
        beyond: outputs at the torn end of an unfinished recording that have no counterpart.
        difference: the first one, in the order of steps.
    """

    equal: int
    close: int
    beyond: int
    difference: Difference | None


class _Kept(NamedTuple):
    step: int
    digest: bytes


class _Head(msgspec.Struct):
    step: int


def missing_inputs(recording: Recording) -> list[StreamSpan]:
    """The messages that `closed/fusion` says were fused and that the recording does not hold.

    Raises:
        RecordingError: the recording is damaged.
    """
    ledger, ends = Ledger(max_spans=sys.maxsize), dict[StreamKey, int]()
    closings: list[Closed] = []
    for message in _inputs(recording):
        if isinstance(message, Closed):
            closings.append(message)
            for end in message.manifest:
                key = StreamKey(end.carrier, end.boot, end.stream)
                ends[key] = max(end.last_seq, ends.get(key, 0))
        elif isinstance(message, Input):
            ledger.note(StreamKey(message.carrier, message.boot, message.stream), message.seq)
    for key, spans in _given_up(closings).items():
        for first, last in spans:
            ledger.give_up(key, first, last)
    return [
        StreamSpan(carrier=key.process, boot=key.boot, stream=key.stream, first=first, last=last)
        for key, end in sorted(ends.items())
        for first, last in ledger.missing(key, end)
    ]


def compare(recording: Recording, rules: Rules = EXACT, show: Show = unseen) -> Comparison:
    """Fuse the inputs of a recording again and hold the outputs against the recorded ones.

    Of an unfinished recording, whose end is torn, the part that both sides have is compared.

    Args:
        rules: what counts as a difference; on another kind of machine 1e-9 does not.
        show: is told how many inputs have been fused, and the log time [ns] of the last.

    Raises:
        RecordingError: damaged, without outputs, or an input that was fused is not in it.
    """
    comparing = _Comparing(recording, rules)
    try:
        for outputs in fuse(_fusibles(recording, show), centre=comparing.centre, ahead=AHEAD):
            for topic, ids, message in outputs:
                comparing.take(topic.key(recording.header.run, *ids), message)
            if comparing.difference:
                break
    except RecordingError:
        if not comparing.is_torn:
            raise
    return comparing.result()


class _Comparing:
    """The recorded outputs, as digests, taken away as the fused ones come in step order."""

    def __init__(self, recording: Recording, rules: Rules) -> None:
        self.difference: Difference | None = None
        self.is_torn = is_torn(recording)
        self._rules = rules
        self._recording = recording
        self._recorded: dict[Place, _Kept] = {}
        centres = set[str]()
        for message in recording.messages(roles=(Role.OUTPUT,)):
            step = _step_of(message)
            place = Place(message.key, message.sequence)
            self._recorded[place] = _Kept(step, _digest(message.payload))
            centres.add(message.address.ids["centre"])
        if len(centres) != 1:
            got = f"those of {', '.join(sorted(centres)) or 'nobody'}"
            raise RecordingError("no outputs to compare", got=got, expected="one fusion centre's")
        self.centre = centres.pop()
        self._last_recorded = max(kept.step for kept in self._recorded.values())
        self._last_fused = self._equal = self._close = self._beyond = 0

    def take(self, key: str, fused: Output) -> None:
        """Compare the next output; after a difference nothing more is compared."""
        if self.difference:
            return
        self._last_fused = fused.step
        kept = self._recorded.pop(Place(key, fused.seq), None)
        payload = codec.encode(fused)
        if kept is None and self.is_torn and fused.step >= self._last_recorded:
            self._beyond += 1
        elif kept is None:
            self.difference = Difference(key, fused.step, "", None, msgpack.unpackb(payload))
        elif kept.digest == _digest(payload):
            self._equal += 1
        else:
            self._compare(key, fused, payload)

    def _compare(self, key: str, fused: Output, payload: bytes) -> None:
        """Look into an output that differs in bytes."""
        recorded = self._recorded_message(Place(key, fused.seq))
        fused_again = msgpack.unpackb(payload)
        found = next(changes(recorded, fused_again, self._rules), None)
        if found is None and self._rules.are_exact:
            found = first_difference(recorded, fused_again)
        if found is None:
            self._equal += 1
            self._close += 1
        else:
            self.difference = Difference(key, fused.step, *found)

    def result(self) -> Comparison:
        """What has come of it, with what was recorded and never fused."""
        for place, kept in sorted(self._recorded.items(), key=lambda item: item[1].step):
            if self.difference:
                break
            if self.is_torn and kept.step > self._last_fused:
                self._beyond += 1
            else:
                recorded = self._recorded_message(place)
                self.difference = Difference(place.key, kept.step, "", recorded, None)
        return Comparison(self._equal, self._close, self._beyond, self.difference)

    def _recorded_message(self, place: Place) -> Any:
        topic = parse(place.key).topic
        return next(
            unpacked(message.payload, message.encoding)
            for message in self._recording.messages(topics=(topic,))
            if (message.key, message.sequence) == place
        )


def _fusibles(recording: Recording, show: Show) -> Iterator[Fusible]:
    yield recording.scenario
    for message in _inputs(recording, show):
        if isinstance(message, Closed | Event | Input):
            yield message


def _inputs(recording: Recording, show: Show = unseen) -> Iterator[msgspec.Struct]:
    """Every readable input; what the bus has refused was never fused either."""
    for count, message in enumerate(recording.messages(roles=(Role.INPUT,))):
        show(count, message.log_time_ns)
        with suppress(WireError):
            yield message.decode()


def _given_up(closings: Sequence[Closed]) -> Mapping[StreamKey, Spans]:
    """What was given up and never came late either."""
    given_up: defaultdict[StreamKey, Spans] = defaultdict(Spans)
    for span in chain.from_iterable(closed.gave_up for closed in closings):
        given_up[_key(span)].add(span.first, span.last)
    for span in chain.from_iterable(closed.late for closed in closings):
        given_up[_key(span)].discard(span.first, span.last)
    return given_up


def _key(span: StreamSpan) -> StreamKey:
    return StreamKey(span.carrier, span.boot, span.stream)


def _step_of(output: Recorded) -> int:
    """The step an output belongs to.

    Raises:
        RecordingError: it is none.
    """
    try:
        return msgspec.msgpack.decode(output.payload, type=_Head).step
    except msgspec.MsgspecError as error:
        where = f"{output.key}, seq {output.sequence}"
        raise RecordingError(f"not an output: {error}", where=where) from None


def _digest(payload: bytes) -> bytes:
    return blake2b(payload, digest_size=16).digest()
