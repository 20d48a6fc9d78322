"""Records everything a run says, without a hole, in a thread and on a session of its own."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import msgspec

from schemas import codec, keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.latched import fetch
from schemas.bus.ledger import Ledger, Seen, StreamKey
from schemas.bus.member import Member
from schemas.bus.recovery import Gap, Recovery
from schemas.bus.roster import Life
from schemas.errors import RecordingError, WireError
from schemas.messages import DeclaredScenario, Statistics, Step, TruthScenario
from schemas.recording.contents import RunEnd, RunHeader, hash_of, run_attachments
from schemas.recording.fingerprint import installed_versions, numeric_fingerprint
from schemas.recording.writer import RecordingWriter

from .counts import MAX_COUNT, UNKNOWN, StreamCounts
from .lives import Lives
from .screening import Screen, Screened, Source, source_of

log = logging.getLogger("recorder")

PUMP_S = 0.05
STATISTICS_S = 1.0
HOLD_BACK_BYTES = 16 * 1024 * 1024
"""A queue longer than this holds back the acknowledgement of the fusion centre."""
FINISH_S = 10.0
PATIENCE_S = 30.0
"""Nobody waits for a gap in a recording, so it is asked for as long as its owner may have it."""


def record_run(
    member: Member, path: Path, max_loss_s: float, timeout_s: float
) -> tuple[Recorder, DeclaredScenario]:
    """Begin the recording of a run, as soon as its world is there; the declared scenario with it.

    The truth goes into the file and no further: the fusion centre is handed the declared part.

    Raises:
        BusError: no world came in time.
        RecordingError: the file exists or cannot be written.
    """
    bus, run = member.buses.data, member.run
    latched = fetch(bus, keys.SCENARIO, run, timeout_s=timeout_s)
    hidden = fetch(bus, keys.TRUTH_SCENARIO, run, timeout_s=timeout_s)
    scenario = codec.decode(DeclaredScenario, latched.payload, latched.encoding)
    truth = codec.decode(TruthScenario, hidden.payload, hidden.encoding)
    config = msgspec.json.encode(scenario.fusion)
    header = RunHeader(
        run=run,
        scenario=scenario.name,
        config_hash=hash_of(config),
        created_ns=time.time_ns(),
        versions=installed_versions(),
        fingerprint=numeric_fingerprint(),
    )
    attachments = run_attachments(scenario, truth, config)
    writer = RecordingWriter(path, header, attachments=attachments, max_loss_s=max_loss_s)
    recorder = Recorder(member, writer, scenario)
    recorder.start(latched, hidden)
    return recorder, scenario


class Recorder:
    """Writes samples in order of arrival; gaps are fetched from their owners.

    Attributes:
        lives: who takes part, entered by the fusion centre; what others say is recorded too, as
            far as there is room, but not missed.
    """

    def __init__(self, member: Member, writer: RecordingWriter, scenario: DeclaredScenario) -> None:
        self._member, self._writer = member, writer
        self._inbox: Inbox[Sample] = Inbox(256 * 1024 * 1024)
        self.lives = Lives(carrier.name for carrier in scenario.carriers)
        self._ledger = Ledger()
        self._screen = Screen(scenario, self.lives, self._ledger.forget)
        self._counts = StreamCounts(self.lives)
        self._recovery = Recovery(member.run, member.buses.data, self._inbox, PATIENCE_S)
        self._clock_ns = scenario.epoch_ns
        self._received = self._repeated = self._passed_over = self._gaps = 0
        self._statistics_s = float("-inf")
        self._finish_by_s = float("inf")
        self._expected: Mapping[StreamKey, int] = {}
        self._given_up: Sequence[Gap] = ()
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
        self._member.announce()
        self._thread.start()

    def keeps_up(self) -> bool:
        """Whether the queue before the writer is short, or the disk has failed already."""
        return self._error is not None or self._inbox.bytes < HOLD_BACK_BYTES

    def error(self) -> RecordingError | None:
        """What ended the recording early."""
        return self._error

    def counters(self) -> dict[str, int]:
        """Counts for `health`; received = recorded + rejected + repeated + passed_over."""
        return {
            "received": self._received,
            "recorded": self._writer.counts.recorded,
            "bytes": self._writer.counts.bytes,
            "rejected": self._counts.rejected,
            "repeated": self._repeated,
            "passed_over": self._passed_over,
            "dropped": self._inbox.drops,
            "fetched": self._recovery.fetched,
            "gaps": self._gaps,
        }

    def finish(
        self, reason: str, expected: Mapping[StreamKey, int], given_up: Sequence[Gap] = ()
    ) -> None:
        """Wait until everything expected is recorded, at most 10 s, and seal the file.

        Args:
            expected: the last message of each stream.
            given_up: what of it is not waited for any longer.
        """
        self._reason, self._expected, self._given_up = reason, expected, given_up
        self._finish_by_s = time.monotonic() + FINISH_S
        self._inbox.wake()
        self._thread.join()
        self._recovery.close()

    def _work(self) -> None:
        try:
            while not self._is_done():
                for sample in self._inbox.take(PUMP_S):
                    self._record(sample)
                self._mind_the_gaps()
                self._note_statistics()
                self._writer.tick(time.monotonic())
            self._writer.close(self._end())
        except RecordingError as error:
            self._error = error
            self._inbox.max_bytes = 0  # from here on arrivals are only counted
            log.error("recording ended early: %s", error)

    def _record(self, sample: Sample) -> None:
        """Write one sample; what cannot be recorded is counted with its reason."""
        self._received += 1
        try:
            address = keys.parse(sample.key)
        except WireError as error:
            self._refuse(Source(UNKNOWN, UNKNOWN), error)
            return
        if not address.topic.recorded:
            self._passed_over += 1
            return
        try:
            self._write(sample, self._screen.admit(address, sample))
        except WireError as error:
            self._refuse(source_of(address), error)

    def _refuse(self, source: Source, error: WireError) -> None:
        if self._counts.refuse(*source, str(error)):
            log.warning("not recorded: %s %s: %s", *source, error)

    def _write(self, sample: Sample, screened: Screened) -> None:
        """Write a message unless it is here already.

        Raises:
            WireError: it cannot be accounted for, or written.
        """
        message, stream, seq = screened.message, screened.stream, screened.seq
        if seq:
            if self._ledger.is_absurd(stream, seq):
                raise WireError(f"seq jumps from {self._ledger.highest(stream)}", got=seq)
            seen = self._ledger.note(stream, seq)
            if seen is Seen.DUPLICATE:
                self._repeated += 1
                return
            if seen is Seen.REFUSED:
                raise WireError("more gaps in seq than can be remembered", got=seq)
        if isinstance(message, Step):
            self._clock_ns = max(self._clock_ns, message.t_ns)
        self._writer.write(
            sample.key,
            sample.payload,
            sample.encoding,
            log_time_ns=self._clock_ns,
            publish_time_ns=screened.t_ns,
            sequence=seq or getattr(message, "seq", 0) or getattr(message, "step", 0),
        )

    def _mind_the_gaps(self) -> None:
        gaps = [gap for gap in self._ledger.gaps() if self._is_missed(gap[0])]
        for key, last in self._expected.items():
            gaps += [(key, *span) for span in self._ledger.missing(key, last)]
        hopeless = self._recovery.pursue(gaps, time.monotonic())
        given_up, self._given_up = self._given_up, ()
        for gap in (*hopeless, *given_up):
            self._give_up(*gap)

    def _give_up(self, key: StreamKey, first: int, last: int) -> None:
        for start, end in self._ledger.missing(key, last):
            if end >= first:
                self._gaps = min(MAX_COUNT, self._gaps + end - max(start, first) + 1)
                log.warning("never had: %s %s %d..%d", key.process, key.stream, start, end)
        self._ledger.give_up(key, first, last)

    def _is_missed(self, stream: StreamKey) -> bool:
        return not stream.boot or Life(stream.process, stream.boot) in self.lives

    def _is_done(self) -> bool:
        now_s = time.monotonic()
        if self._finish_by_s == float("inf") or len(self._inbox):
            return False
        whole = all(self._ledger.through(key) >= last for key, last in self._expected.items())
        return whole or now_s > self._finish_by_s

    def _note_statistics(self) -> None:
        now_s = time.monotonic()
        if now_s - self._statistics_s < STATISTICS_S:
            return
        self._statistics_s = now_s
        self._writer.write_statistics(
            Statistics(
                t_ns=self._clock_ns,
                received=self._received,
                recorded=self._writer.counts.recorded,
                dropped=self._inbox.drops,
                gaps=self._gaps,
            )
        )

    def _end(self) -> RunEnd:
        return RunEnd(
            reason=self._reason,
            received=self._received,
            recorded=self._writer.counts.recorded,
            dropped=self._inbox.drops,
            gaps=self._gaps,
            rejected=self._counts.rejected,
            rejections=self._counts.rejections(),
        )
