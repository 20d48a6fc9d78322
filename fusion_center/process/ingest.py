"""Takes inputs off the wire and holds them until a Closed claims them; counts everything."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable

from schemas import keys
from schemas.bus.interface import Sample
from schemas.bus.ledger import Ledger, Seen, StreamKey
from schemas.bus.recovery import Gap
from schemas.bus.roster import Life
from schemas.errors import WireError
from schemas.messages import Closed, Input, SourceInfo, StreamEnd, StreamSpan, StreamStatistics
from schemas.received import receive

from ..admission.counts import UNKNOWN, StreamCounts
from ..admission.lives import Door, Everyone, Known
from ..timeline import BACK_NS

log = logging.getLogger("fusion")

HELD_BYTES = 1024 * 1024 * 1024
LIFE_BYTES = 256 * 1024 * 1024
STRANGER_BYTES = 512 * 1024
"""What may wait for a Closed: in all, of one life, and of one that has shown no token."""
OVERHEAD_BYTES, GROWTH = 1024, 8
"""Memory that a decoded message takes, by the length of its payload: estimated on the safe side."""
NEVER_NS = 2**63 - 1

Message = tuple[Input, int]
"""With its weight in memory."""


class Ingest:
    """Inputs of every stream, from their arrival to the Closed that names them.

    Args:
        known: lives that take part. What others send is held, as far as there is room, in case
            they show their token; it is never named in a Closed.
        max_clock_error_s: stamps further from the closing than this are counted as late or
            refused; the pipeline does not fuse them.
    """

    def __init__(self, known: Known | None = None, max_clock_error_s: float = 1.0) -> None:
        self.counts = StreamCounts(known or Everyone())
        self._known = known or Everyone()
        self._door = Door(self._known, self._forget)
        self._ledger = Ledger()
        self._held: dict[StreamKey, dict[int, Message]] = {}
        self._claimed: Counter[StreamKey] = Counter()
        self._late: list[StreamSpan] = []
        self._bytes = 0
        self._bytes_of: Counter[Life] = Counter()
        self._tolerance_ns = round(max_clock_error_s * 1e9)
        self._closed_ns = 0

    def accept(self, sample: Sample) -> None:
        """Decode one sample and hold it; whatever is wrong with it is counted, never raised."""
        try:
            address = keys.parse(sample.key)
        except WireError as error:
            self.refuse(UNKNOWN, UNKNOWN, str(error))
            return
        carrier, stream = address.ids.get("carrier", UNKNOWN), keys.stream(address)
        try:
            message = receive(sample).message
            if not isinstance(message, Input):
                raise WireError("not an input of a carrier", got=address.topic.name)
            self._take(message, OVERHEAD_BYTES + GROWTH * len(sample.payload))
        except WireError as error:
            self.refuse(carrier, stream, str(error))

    def refuse(self, carrier: str, stream: str, reason: str) -> None:
        """Count a message that is not taken, and say so the first time, the tenth ..."""
        if self.counts.refuse(carrier, stream, reason):
            log.warning("refused a message of %s %s: %s", carrier, stream, reason)

    def missing(self, manifest: Iterable[StreamEnd]) -> list[Gap]:
        """Gaps that keep a manifest from being fused."""
        return [
            (key, first, last)
            for end in manifest
            for key in [StreamKey(end.carrier, end.boot, end.stream)]
            for first, last in self._ledger.missing(key, end.last_seq)
        ]

    def gaps(self, only_stepless: bool = False) -> list[Gap]:
        """Every gap below a message that has come from a life that takes part.

        Args:
            only_stepless: leave out what answers steps, its carrier's answer names it.
        """
        return [
            gap
            for gap in self._ledger.gaps()
            if self._takes_part(gap[0])
            and not (only_stepless and not self._is_before_stepless(gap))
        ]

    def give_up(self, gap: Gap) -> StreamSpan:
        """Stop waiting for messages; they are named in the next Closed."""
        key, first, last = gap
        self._ledger.give_up(key, first, last)
        self.counts.add(key.process, key.stream, gave_up=last - first + 1)
        return _span(key, first, last)

    def ends(
        self, until_ns: int, only_stepless: bool, held_back_to_ns: int = NEVER_NS
    ) -> list[StreamEnd]:
        """Streams with news stamped up to `until_ns` and nothing missing before it.

        Args:
            until_ns: latest stamp, in scenario time.
            only_stepless: leave out what answers steps, its carrier's answer names it.
            held_back_to_ns: what is stamped later than `until_ns` waits for its time; what is
                stamped later than this never will have one, so it is named, and not fused.
        """
        return [
            StreamEnd(carrier=key.process, boot=key.boot, stream=key.stream, last_seq=last)
            for key in sorted(self._held)
            if self._takes_part(key)
            and (last := self._end(key, until_ns, only_stepless, held_back_to_ns))
            > self._claimed[key]
        ]

    def late(self) -> list[StreamSpan]:
        """What came after it had been given up, once."""
        late, self._late = self._late, []
        return late

    def claim(self, closed: Closed) -> list[Input]:
        """Hand over everything a Closed names, in any order, and forget it."""
        messages: list[Input] = []
        for end in closed.manifest:
            key = StreamKey(end.carrier, end.boot, end.stream)
            messages += self._release(key, self._claimed[key] + 1, end.last_seq)
            self._claimed[key] = max(self._claimed[key], end.last_seq)
        for span in closed.late:
            key = StreamKey(span.carrier, span.boot, span.stream)
            messages += self._release(key, span.first, span.last)
        self._judge_stamps(closed, messages)
        return messages

    def claimed(self) -> dict[StreamKey, int]:
        """The last message that a Closed has named of every stream."""
        return {key: last for key, last in self._claimed.items() if last}

    def given_up(self) -> list[Gap]:
        """What was given up and has not come since."""
        return list(self._ledger.given_up())

    def abandon(self, carrier: str, boot: str) -> int:
        """Drop what a lost boot sent beyond its last answer; how many messages nobody claimed."""
        dropped = 0
        for key in [k for k in self._held if (k.process, k.boot) == (carrier, boot)]:
            unclaimed = len(self._release(key, 0, NEVER_NS))
            self.counts.add(carrier, key.stream, unclaimed=unclaimed)
            dropped += unclaimed
        return dropped

    def statistics(self) -> list[StreamStatistics]:
        """Counts of every stream so far."""
        return self.counts.statistics()

    def waiting(self) -> list[Life]:
        """Lives with messages that nobody has claimed yet."""
        return sorted({Life(key.process, key.boot) for key in self._held})

    def _take(self, message: Input, weight: int) -> None:
        """Account for a message and hold it.

        Raises:
            WireError: its stream, its seq or its weight is more than there is room for.
        """
        key = StreamKey(message.carrier, message.boot, message.stream)
        if reason := self._door.admit(key):
            raise WireError(reason)
        if self._ledger.is_absurd(key, message.seq):
            raise WireError(f"seq jumps from {self._ledger.highest(key)}", got=message.seq)
        self._require_room(Life(key.process, key.boot), weight)
        seen = self._ledger.note(key, message.seq)
        if seen is Seen.DUPLICATE:
            self.counts.add(key.process, key.stream, duplicates=1)
            return
        if seen is Seen.REFUSED:
            raise WireError("more gaps in seq than can be remembered", got=message.seq)
        self.counts.add(key.process, key.stream, received=1, late=int(seen is Seen.LATE))
        self._held.setdefault(key, {})[message.seq] = (message, weight)
        self._weigh(Life(key.process, key.boot), weight)
        if seen is Seen.LATE:
            self._late.append(_span(key, message.seq, message.seq))

    def _require_room(self, life: Life, weight: int) -> None:
        most = LIFE_BYTES if life in self._known else STRANGER_BYTES
        if self._bytes_of[life] + weight > most or self._bytes + weight > HELD_BYTES:
            why = "" if life in self._known else "; no liveliness token of this boot was ever seen"
            raise WireError(f"too much waits for its Closed{why}", got=self._bytes_of[life])

    def _takes_part(self, key: StreamKey) -> bool:
        return Life(key.process, key.boot) in self._known

    def _end(self, key: StreamKey, until_ns: int, only_stepless: bool, far_ns: int) -> int:
        """Up to which message a stream can be claimed: what is not held by then is given up."""
        claimed, through = self._claimed[key], self._ledger.through(key)
        for seq in sorted(seq for seq in self._held[key] if claimed < seq <= through):
            message, _ = self._held[key][seq]
            early = until_ns < message.t_ns <= far_ns and not isinstance(message, SourceInfo)
            if early or (only_stepless and message.step):
                return seq - 1
        return through

    def _judge_stamps(self, closed: Closed, messages: Iterable[Input]) -> None:
        """Count what the pipeline will not fuse for its stamp."""
        earliest = self._closed_ns - self._tolerance_ns - BACK_NS
        latest = closed.t_ns + self._tolerance_ns
        for message in messages:
            if isinstance(message, SourceInfo) or earliest <= message.t_ns <= latest:
                continue
            if message.t_ns < earliest:
                self.counts.add(message.carrier, message.stream, late=1)
            else:
                ahead_s = (message.t_ns - closed.t_ns) * 1e-9
                reason = f"stamped {ahead_s:.3g} s after the closing: not fused"
                self.refuse(message.carrier, message.stream, reason)
        self._closed_ns = max(self._closed_ns, closed.t_ns)

    def _release(self, key: StreamKey, first: int, last: int) -> list[Input]:
        """Take the messages first .. last of a stream out, in order."""
        held = self._held.get(key, {})
        taken = [held.pop(seq) for seq in sorted(seq for seq in held if first <= seq <= last)]
        if not held:
            self._held.pop(key, None)
        self._weigh(Life(key.process, key.boot), -sum(weight for _, weight in taken))
        return [message for message, _ in taken]

    def _weigh(self, life: Life, weight: int) -> None:
        self._bytes += weight
        self._bytes_of[life] += weight
        if not self._bytes_of[life]:
            del self._bytes_of[life]

    def _forget(self, key: StreamKey) -> None:
        """A stream that has to make room: what it holds will never be claimed."""
        unclaimed = len(self._release(key, 0, NEVER_NS))
        self.counts.add(key.process, key.stream, unclaimed=unclaimed)
        self._ledger.forget(key)
        self._claimed.pop(key, None)

    def _is_before_stepless(self, gap: Gap) -> bool:
        key, _, last = gap
        held = self._held.get(key, {}).get(last + 1)
        return held is not None and not held[0].step


def _span(key: StreamKey, first: int, last: int) -> StreamSpan:
    return StreamSpan(carrier=key.process, boot=key.boot, stream=key.stream, first=first, last=last)
