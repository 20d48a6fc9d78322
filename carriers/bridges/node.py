"""A bridge as a process: takes bytes from a feed to the bus until the feed or the run ends."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable

import msgspec

from schemas import keys
from schemas.bus.answering import reply_to
from schemas.bus.interface import Inbox, Sample
from schemas.bus.member import Member
from schemas.errors import WireError
from schemas.messages import Correction, ProcessState
from schemas.received import receive

from .bridge import Bridge
from .feeds import Feed
from .records import Decoder, RecordError
from .run_clock import RunClock
from .run_watch import RunWatch

log = logging.getLogger("bridge")

PUMP_S = 0.02
LINGER_S = 1.0
"""After the end of a feed, so that what was lost on the way can still be fetched."""
TOLD_AT_ONCE = 10
TELL_EVERY_S = 1.0


class MemberOutlet:
    """What a bridge publishes goes to the outbox of its process."""

    def __init__(self, member: Member) -> None:
        self._member = member

    @property
    def boot(self) -> str:
        """This life of the process."""
        return self._member.boot

    def send(self, topic: keys.Topic, ids: Iterable[str], message: msgspec.Struct) -> None:
        """Publish one message."""
        self._member.outbox.send(topic, ids, message)


class Complaints:
    """Tells people what is wrong with a feed: the first records at once, then one a second."""

    def __init__(self) -> None:
        self._told, self._silent = 0, 0
        self._last_s = float("-inf")

    def tell(self, error: RecordError, now_s: float) -> None:
        """Say it, or only count it if there was too much to say."""
        if self._told >= TOLD_AT_ONCE and now_s - self._last_s < TELL_EVERY_S:
            self._silent += 1
            return
        untold = f" (and {self._silent} more)" if self._silent else ""
        log.warning("refused a record: %s%s", error, untold)
        self._told += 1
        self._silent, self._last_s = 0, now_s


class BridgeNode:
    """Runs one feed through one bridge."""

    def __init__(
        self, member: Member, feed: Feed, decode: Decoder, bridge: Bridge, clock: RunClock
    ) -> None:
        self._member, self._feed, self._decode = member, feed, decode
        self._bridge, self._clock = bridge, clock
        self._complaints = Complaints()
        self._corrections: Inbox[Sample] = Inbox()
        self._stop = False

    def stop(self) -> None:
        """Ask for an early end; safe from a signal handler or another thread."""
        self._stop = True

    def run(self) -> str:
        """The whole life of the bridge; the reason why it ended."""
        watch = self._open()
        ended_s = float("inf")
        while not self._stop:
            self._hear()
            for arrival in self._feed.take(PUMP_S):
                for found in self._decode(arrival):
                    if (error := self._bridge.take(found)) is not None:
                        self._complaints.tell(error, time.monotonic())
            now_s = time.monotonic()
            over = watch.is_over(now_s)
            self._bridge.stand()
            self._member.beat(self._clock.step, "running", **self._bridge.counts.counters())
            if self._feed.ended:
                ended_s = min(ended_s, now_s)
                time.sleep(PUMP_S)
            if now_s - ended_s > LINGER_S:
                return "the feed has ended"
            if over:
                return "the run has ended"
        return "stopped"

    def _open(self) -> RunWatch:
        run, process = self._member.run, self._member.process
        control, data = self._member.buses
        watch = RunWatch(control, run, self._clock)
        data.serve(keys.STATE.key(run, process), self._status)
        if self._bridge.uses_corrections:
            data.subscribe(keys.CORRECTION.key(run, keys.FUSION, process), self._corrections)
        self._member.announce()
        return watch

    def _hear(self) -> None:
        """Take in the corrections that have come."""
        for sample in self._corrections.take():
            try:
                message = receive(sample).message
            except WireError as error:
                log.warning("refused a correction: %s", error)
                continue
            if isinstance(message, Correction):
                self._bridge.hear(message)

    def _status(self, question: Sample) -> Iterable[Sample]:
        """Answer who asks for the state now, and not only once a second."""
        state = ProcessState(
            process=self._member.process,
            boot=self._member.boot,
            t_ns=time.time_ns(),
            step=self._clock.step,
            counters=self._bridge.counts.counters(),
        )
        yield reply_to(question, state)
