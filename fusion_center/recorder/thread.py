"""Records everything a run says, without a hole, in a thread and on a session of its own."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import NamedTuple

from schemas import keys
from schemas.bus.interface import Sample
from schemas.bus.ledger import StreamKey
from schemas.bus.member import Member
from schemas.bus.recovery import Gap
from schemas.errors import RecordingError, WireError
from schemas.messages import (
    Closed,
    DeclaredScenario,
    KeyStatistics,
    Statistics,
    Step,
)
from schemas.recording.contents import RunEnd
from schemas.shapes import Envelope

from ..admission.counts import UNKNOWN, StreamCounts
from ..admission.lives import Lives
from ..admission.screening import Screen, Screened, Source, source_of
from .commands import Commands
from .gaps import Gaps
from .rows import EVERYTHING, Queue, Row, Rows, Wanted
from .sink import Sink

log = logging.getLogger("recorder")

PUMP_S = 0.02
GATHER_S = 0.01
MIND_S = 0.02
STATISTICS_S = 1.0
QUEUE_BYTES = 256 * 1024 * 1024
HOLD_BACK_BYTES = 16 * 1024 * 1024
"""A queue longer than this holds back the acknowledgement of the fusion centre."""
FINISH_S = 10.0


class _Course(NamedTuple):
    """What nearly every message of a stream needs, found once.

    Attributes:
        read: a payload of the stream; is_next: accounts for a seq, if it is the next one.
    """

    stream: StreamKey
    row: Row
    read: Callable[[bytes], Envelope | None]
    is_next: Callable[[int], bool]


class Recorder:
    """Writes samples in order of arrival; gaps are fetched from their owners.

    At the first error of the disk it says so, goes on to count, and writes no more.

    Args:
        scenario: what the run is of; without one anything may be of it, and the log time is that of
            the wall clock until a world counts steps.
        wanted: which keys.

    Attributes:
        lives: who takes part, entered by the fusion centre; what others say is recorded too, as
            far as there is room, but not missed.
        paused: nothing is written meanwhile, and what passes is not missed later.
        step: the last one that the world has granted; ended: it has said that none follows.
        claimed: the last message of each stream that a Closed of the fusion centre names.
    """

    def __init__(
        self,
        member: Member,
        writer: Sink,
        scenario: DeclaredScenario | None,
        wanted: Wanted = EVERYTHING,
    ) -> None:
        self._member, self._writer = member, writer
        self._inbox = Queue(QUEUE_BYTES, GATHER_S)
        self.lives = Lives(carrier.name for carrier in scenario.carriers) if scenario else Lives()
        self.paused = self.ended = False
        self.step = 0
        self.commands: Commands | None = None
        self.claimed: dict[StreamKey, int] = {}
        self._rows = Rows(wanted)
        self._gaps = Gaps(member, self._inbox, self.lives, self._rows)
        self._screen = Screen(scenario, self.lives, self._forget)
        self._courses: dict[tuple[str, str], _Course] = {}
        self._counts = StreamCounts(self.lives)
        self._clock_ns = scenario.epoch_ns if scenario else time.time_ns()
        self._has_steps = scenario is not None
        self._taken = self._repeated = self._passed_over = self._unwritten = 0
        self._statistics_s = self._minded_s = float("-inf")
        self._finish_by_s = float("inf")
        self._given_up: Sequence[Gap] = ()
        self._orders: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._reason = "interrupted"
        self._error: RecordingError | None = None
        self._thread = threading.Thread(target=self._work, name="recorder")

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Seal what is there, if the fusion centre has failed to."""
        if self._thread.is_alive():
            self.finish(f"failed: {error}" if error else "stopped", {})

    def start(self, *latched: Sample) -> None:
        """Listen to everything of the run; `latched` are values published before this."""
        for sample in latched:
            self._inbox.put(sample, len(sample.payload))
        self._member.buses.data.subscribe(keys.everything(self._member.run), self._inbox)
        self._thread.start()

    def keeps_up(self) -> bool:
        """Whether the queue before the writer is short, or the disk has failed already."""
        return self._error is not None or self._inbox.bytes < HOLD_BACK_BYTES

    def error(self) -> RecordingError | None:
        """What ended the recording early."""
        return self._error

    def split(self) -> None:
        """Go on in a new part; by an order only."""
        self._writer.split()

    def flush(self) -> None:
        """Bring what has come so far into the file; by an order only."""
        self._writer.flush()

    def files(self) -> list[Path]:
        """What holds the recording so far."""
        return self._writer.files()

    def order(self, action: Callable[[], None]) -> None:
        """Have something done between two samples, by the thread that writes."""
        self._orders.put(action)
        self._inbox.wake()

    def counters(self) -> dict[str, int]:
        """For `health`; received = recorded + rejected + repeated + passed_over + dropped."""
        return {
            "received": self._taken + self._inbox.drops,
            "recorded": self._writer.counts.recorded,
            "bytes": self._writer.counts.bytes,
            "rejected": self._counts.rejected,
            "repeated": self._repeated,
            "passed_over": self._passed_over,
            "dropped": self._inbox.drops + self._unwritten,
            "fetched": self._gaps.fetched,
            "gaps": self._gaps.never_had,
            "disk_errors": int(self._error is not None),
        }

    def statistics(self) -> Statistics:
        """Counts so far, of every key; exact for the thread that writes."""
        return self._statistics(self._rows.statistics(self._inbox.dropped.copy()))

    def finish(
        self,
        reason: str,
        expected: Mapping[StreamKey, int],
        given_up: Sequence[Gap] = (),
        *,
        all_heard: bool = False,
    ) -> None:
        """Wait until everything expected is recorded, at most 10 s, and seal the file.

        Args:
            expected: the last message of each stream; those not wanted are not waited for.
            given_up: what of it is not waited for any longer.
            all_heard: wait for every gap below what has come, too.
        """
        self._gaps.all_heard = all_heard
        wants, run = self._rows.wants_stream, self._member.run
        self._gaps.expected = {key: last for key, last in expected.items() if wants(run, key)}
        self._reason, self._given_up = reason, given_up
        self._finish_by_s = time.monotonic() + FINISH_S
        self._inbox.wake()
        self._thread.join()
        self._gaps.close()
        if self.commands is not None:
            self.commands.close(FINISH_S)

    def _work(self) -> None:
        while not self._is_done():
            samples = self._inbox.take(PUMP_S)
            if not self._has_steps:
                self._clock_ns = max(self._clock_ns, time.time_ns())
            self._record(samples)
            if time.monotonic() - self._minded_s >= MIND_S or self._finish_by_s < float("inf"):
                self._mind()
        self._mind()
        self._gaps.conclude()
        self._watched(lambda: self._writer.close(self._end()))

    def _mind(self) -> None:
        """All that is not done for every sample."""
        self._minded_s = time.monotonic()
        while not self._orders.empty():
            self._watched(self._orders.get())
        given_up, self._given_up = self._given_up, ()
        self._gaps.pursue(given_up)
        self._note_statistics()
        self._watched(lambda: self._writer.tick(time.monotonic()))

    def _watched(self, action: Callable[[], None]) -> None:
        """Do something with the file; an error of the disk is the last of it."""
        if self._error is not None:
            return
        try:
            action()
        except RecordingError as error:
            self._fail(error)

    def _fail(self, error: RecordingError) -> None:
        self._error = error
        self._inbox.max_bytes = 0  # from here on arrivals are only counted
        self._courses.clear()
        self._unwritten += self._writer.unwritten.total()
        self._rows.lose(self._writer.unwritten)
        log.error("recording ended early: %s", error)

    def _record(self, samples: Iterable[Sample]) -> None:
        """Write samples; what cannot be recorded is counted with its reason."""
        course_of, goes_on = self._courses.get, self._goes_on
        for sample in samples:
            self._taken += 1
            course = course_of((sample[0], sample[2]))
            try:
                if course is None or not goes_on(course, sample):
                    self._examine(sample)
            except WireError as error:
                self._refuse(sample.key, source_of(keys.parse(sample.key)), error)
            except RecordingError as error:
                self._drop(sample.key)
                self._fail(error)

    def _goes_on(self, course: _Course, sample: Sample) -> bool:
        """Write a message of a stream admitted before, unless it is here; if it is of that stream.

        Raises:
            WireError: it cannot be accounted for, or written.
            RecordingError: the disk fails.
        """
        stream, row, read, is_next = course
        key, payload, encoding = sample
        if self.paused:
            return False
        try:
            message = read(payload)
        except WireError:
            return False
        if message is None:
            return False
        row.received += 1
        if not is_next(message.seq) and self._gaps.is_repeated(stream, message.seq, key):
            row.repeated += 1
            self._repeated += 1
            return True
        self._writer.write(key, payload, encoding, self._clock_ns, message.t_ns, message.seq)
        row.recorded += 1
        return True

    def _examine(self, sample: Sample) -> None:
        """Write a message of any kind, if it may be recorded and is not here already.

        Raises:
            WireError: it may not be recorded.
            RecordingError: the disk fails.
        """
        row = self._rows.row(sample.key)
        row.received += 1
        if self._error is not None:
            self._drop(sample.key)
            return
        try:
            address = row.address or keys.parse(sample.key)
        except WireError as error:
            self._refuse(sample.key, Source(UNKNOWN, UNKNOWN), error)
            return
        if not (row.wanted and (row.address or self._rows.wants(address, sample.key))):
            row.passed_over += 1
            self._passed_over += 1
            if address.topic is keys.SOURCE:  # all sources of a carrier share a stream
                self._know_of(address, sample)
            return
        self._write(row, sample, self._screen.admit(address, sample))

    def _know_of(self, address: keys.Address, sample: Sample) -> None:
        """Account for a message that is not wanted, so that it is not missed."""
        try:
            screened = self._screen.admit(address, sample)
            self._gaps.is_repeated(screened.stream, screened.seq, sample.key)
        except WireError:
            return

    def _drop(self, key: str) -> None:
        self._rows.row(key).dropped += 1
        self._unwritten += 1

    def _refuse(self, key: str, source: Source, error: WireError) -> None:
        self._rows.row(key).rejected += 1
        if self._counts.refuse(*source, str(error)):
            log.warning("not recorded: %s %s: %s", *source, error)

    def _write(self, row: Row, sample: Sample, screened: Screened) -> None:
        """Write a message unless it is here already.

        Raises:
            WireError: it cannot be accounted for, or written.
            RecordingError: the disk fails.
        """
        message, stream, seq = screened.message, screened.stream, screened.seq
        if isinstance(message, Step | Closed):
            self._heed(message, screened.address.topic)
        if seq and self._gaps.is_repeated(stream, seq, sample.key):
            row.repeated += 1
            self._repeated += 1
            return
        if self.paused:
            row.passed_over += 1
            self._passed_over += 1
            return
        number = seq or getattr(message, "seq", 0) or getattr(message, "step", 0)
        self._writer.write(*sample, self._clock_ns, screened.t_ns, number)
        row.recorded += 1
        self._follow(row, sample, screened)

    def _follow(self, row: Row, sample: Sample, screened: Screened) -> None:
        """Let the further messages of a stream of those who take part go the short way."""
        before = self._courses.get((sample.key, sample.encoding))
        if before is not None and before.stream == screened.stream:
            return
        lane = self._screen.lane(screened, sample.encoding)
        if lane is not None:
            is_next = self._gaps.follower(screened.stream)
            course = _Course(screened.stream, row, lane.next, is_next)
            self._courses[sample.key, sample.encoding] = course

    def _forget(self, stream: StreamKey) -> None:
        """Know nothing of a stream any more."""
        self._courses.clear()
        self._gaps.forget(stream)

    def _heed(self, message: Step | Closed, topic: keys.Topic) -> None:
        """Follow the time of the run and what a whole recording of it holds."""
        if isinstance(message, Step):
            self._clock_ns = max(self._clock_ns if self._has_steps else 0, message.t_ns)
            self._has_steps = True
            self.step = max(self.step, message.step)
            self.ended = self.ended or bool(message.ended)
        elif topic is keys.CLOSED_FUSION:
            for end in message.manifest:
                self.claimed[StreamKey(end.carrier, end.boot, end.stream)] = end.last_seq

    def _is_done(self) -> bool:
        now_s = time.monotonic()
        if self._finish_by_s == float("inf") or len(self._inbox):
            return False
        return self._gaps.is_whole or self._error is not None or now_s > self._finish_by_s

    def _note_statistics(self) -> None:
        now_s = time.monotonic()
        if now_s - self._statistics_s < STATISTICS_S:
            return
        self._statistics_s = now_s
        self._tell(self._statistics(self._rows.news(self._inbox.dropped.copy())))

    def _tell(self, statistics: Statistics) -> None:
        self._watched(lambda: self._writer.write_statistics(statistics))

    def _statistics(self, rows: list[KeyStatistics]) -> Statistics:
        counters = self.counters()
        return Statistics(
            t_ns=self._clock_ns,
            received=counters["received"],
            recorded=counters["recorded"],
            dropped=counters["dropped"],
            gaps=counters["gaps"],
            bytes=counters["bytes"],
            disk_errors=counters["disk_errors"],
            keys=rows,
        )

    def _end(self) -> RunEnd:
        self._tell(self.statistics())
        return RunEnd(
            reason=self._reason,
            received=self._taken + self._inbox.drops,
            recorded=self._writer.counts.recorded,
            dropped=self._inbox.drops + self._unwritten,
            gaps=self._gaps.never_had,
            rejected=self._counts.rejected,
            rejections=self._counts.rejections(),
        )
