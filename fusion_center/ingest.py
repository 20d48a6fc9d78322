"""Takes inputs off the wire and holds them until a Closed claims them; counts everything."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from msgspec.structs import replace

from schemas import codec, keys
from schemas.bus.interface import Sample
from schemas.bus.ledger import Ledger, Seen, StreamKey
from schemas.bus.recovery import Gap
from schemas.errors import WireError
from schemas.messages import Closed, Input, StreamEnd, StreamSpan, StreamStatistics

HELD_BYTES = 256 * 1024 * 1024
"""What may wait for a Closed; a source that floods is refused beyond it."""


class Ingest:
    """Inputs of every stream, from their arrival to the Closed that names them."""

    def __init__(self) -> None:
        self._ledger = Ledger()
        self._held: dict[StreamKey, dict[int, tuple[Input, int]]] = defaultdict(dict)
        self._claimed: dict[StreamKey, int] = defaultdict(int)
        self._late: list[StreamSpan] = []
        self._bytes = 0
        self._counts: dict[tuple[str, str], StreamStatistics] = {}

    def accept(self, sample: Sample) -> None:
        """Decode one sample and hold it; whatever is wrong with it is counted, never raised."""
        try:
            address = keys.parse(sample.key)
        except WireError as error:
            self._count("unknown", "unknown", rejected=1, reason=str(error))
            return
        carrier, stream = address.ids.get("carrier", "unknown"), keys.stream(address)
        try:
            message = self._decode(address, sample)
        except WireError as error:
            self._count(carrier, stream, rejected=1, reason=str(error))
            return
        key = StreamKey(carrier, message.boot, stream)
        seen = self._ledger.note(key, message.seq)
        if seen is Seen.DUPLICATE:
            self._count(carrier, stream, duplicates=1)
            return
        self._count(carrier, stream, received=1, late=int(seen is Seen.LATE))
        self._hold(key, message, len(sample.payload))
        if seen is Seen.LATE:
            self._late.append(_span(key, message.seq, message.seq))

    def missing(self, manifest: Iterable[StreamEnd]) -> list[Gap]:
        """Gaps that keep a manifest from being fused."""
        return [
            (key, first, last)
            for end in manifest
            for key in [StreamKey(end.carrier, end.boot, end.stream)]
            for first, last in self._ledger.missing(key, end.last_seq)
        ]

    def gaps(self, only_stepless: bool = False) -> list[Gap]:
        """Every gap below a message that has come.

        Args:
            only_stepless: leave out what answers steps, its carrier's answer names it.
        """
        return [
            gap for gap in self._ledger.gaps() if not only_stepless or self._is_before_stepless(gap)
        ]

    def give_up(self, gap: Gap) -> StreamSpan:
        """Stop waiting for messages; they are named in the next Closed."""
        key, first, last = gap
        self._ledger.give_up(key, first, last)
        self._count(key.process, key.stream, gave_up=last - first + 1)
        return _span(key, first, last)

    def ends(self, until_ns: int, only_stepless: bool) -> list[StreamEnd]:
        """Streams with news stamped up to `until_ns` and nothing missing before it.

        Args:
            until_ns: latest stamp, in scenario time.
            only_stepless: leave out what answers steps, its carrier's answer names it.
        """
        ends = []
        for key in sorted(self._held):
            last = self._claimed[key]
            while (held := self._held[key].get(last + 1)) is not None or self._is_given_up(
                key, last + 1
            ):
                if held and (held[0].t_ns > until_ns or (only_stepless and held[0].step)):
                    break
                last += 1
            if last > self._claimed[key]:
                ends.append(
                    StreamEnd(carrier=key.process, boot=key.boot, stream=key.stream, last_seq=last)
                )
        return ends

    def late(self) -> list[StreamSpan]:
        """What came after it had been given up, once."""
        late, self._late = self._late, []
        return late

    def claim(self, closed: Closed) -> list[Input]:
        """Hand over everything a Closed names, in any order, and forget it."""
        messages: list[Input] = []
        for end in closed.manifest:
            key = StreamKey(end.carrier, end.boot, end.stream)
            for seq in range(self._claimed[key] + 1, end.last_seq + 1):
                messages += self._release(key, seq)
            self._claimed[key] = max(self._claimed[key], end.last_seq)
        for span in closed.late:
            key = StreamKey(span.carrier, span.boot, span.stream)
            for seq in range(span.first, span.last + 1):
                messages += self._release(key, seq)
        return messages

    def claimed(self) -> dict[StreamKey, int]:
        """The last message that a Closed has named of every stream."""
        return {key: last for key, last in self._claimed.items() if last}

    def abandon(self, carrier: str, boot: str) -> int:
        """Drop what a lost boot sent beyond its last answer; how many messages nobody claimed."""
        dropped = 0
        for key in [k for k in self._held if (k.process, k.boot) == (carrier, boot)]:
            unclaimed = list(self._held[key])
            for seq in unclaimed:
                self._release(key, seq)
            self._count(carrier, key.stream, unclaimed=len(unclaimed))
            dropped += len(unclaimed)
        return dropped

    def statistics(self) -> list[StreamStatistics]:
        """Counts of every stream so far."""
        return [self._counts[name] for name in sorted(self._counts)]

    def boots(self, carrier: str) -> set[str]:
        """Boots of a carrier with messages that nobody has claimed yet."""
        return {key.boot for key, held in self._held.items() if key.process == carrier and held}

    def _decode(self, address: keys.Address, sample: Sample) -> Input:
        message = codec.decode(address.topic.message, sample.payload, sample.encoding)
        if not isinstance(message, Input):
            raise WireError("not an input of a carrier", got=address.topic.name)
        said = (message.carrier, message.stream)
        meant = (address.ids["carrier"], keys.stream(address))
        if said != meant:
            raise WireError("key and envelope disagree", got=said, expected=str(meant))
        if self._bytes + len(sample.payload) > HELD_BYTES:
            raise WireError("too much waits for its Closed", got=self._bytes)
        return message

    def _hold(self, key: StreamKey, message: Input, size: int) -> None:
        self._held[key][message.seq] = (message, size)
        self._bytes += size

    def _release(self, key: StreamKey, seq: int) -> list[Input]:
        held = self._held[key].pop(seq, None)
        if held is None:
            return []
        self._bytes -= held[1]
        return [held[0]]

    def _is_before_stepless(self, gap: Gap) -> bool:
        key, _, last = gap
        held = self._held[key].get(last + 1)
        return held is not None and not held[0].step

    def _is_given_up(self, key: StreamKey, seq: int) -> bool:
        return seq <= self._ledger.through(key) and seq not in self._held[key]

    def _count(self, carrier: str, stream: str, *, reason: str = "", **counts: int) -> None:
        name = (carrier, stream)
        now = self._counts.get(name) or StreamStatistics(carrier=carrier, stream=stream)
        grown = {field: getattr(now, field) + count for field, count in counts.items()}
        self._counts[name] = replace(now, **grown, reason=reason[:200] or now.reason)


def _span(key: StreamKey, first: int, last: int) -> StreamSpan:
    return StreamSpan(carrier=key.process, boot=key.boot, stream=key.stream, first=first, last=last)
