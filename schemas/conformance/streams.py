"""One stream of one boot: its sequence numbers, its stamps, its pace."""

from __future__ import annotations

from collections import OrderedDict
from hashlib import blake2b
from statistics import fmean, median

from ..bus.ledger import StreamKey
from ..bus.spans import Spans
from .findings import Notes

REMEMBERED = 4096
MAX_INTERVALS = 20_000
LEAST_INTERVALS = 8
"""Fewer say nothing about a pace."""
RATE_TOLERANCE = 0.1
JITTER_SHARE = 0.25
"""Of the period; one interval in twenty may be worse."""
SKIPPED = 1.6
"""An interval longer than so many periods has left a report out."""
LEAST_SKIPS, SKIPPED_SHARE = 3, 0.02
"""Fewer, in number and by share, are an accident: a step missed by a busy machine."""
NS = 1e-9


class StreamCheck:
    """Takes the messages of one stream as they come.

    Attributes:
        first, first_s: seq of the first message that came, and when it came.
        count: messages, repetitions left out.
    """

    def __init__(self, key: StreamKey, source: str, notes: Notes) -> None:
        self.key, self.source, self._notes = key, source, notes
        self.count = self.first = 0
        self.first_s = self.last_s = 0.0
        self.empty = 0
        self._seen = Spans()
        self._digests: OrderedDict[int, bytes] = OrderedDict()
        self._last: tuple[int, int] | None = None
        self._went_back = False
        self._intervals_s: list[tuple[int, float]] = []

    def take(self, seq: int, t_ns: int, payload: bytes, arrived_s: float, fetched: bool) -> bool:
        """Note a message; whether it is one that had not come before."""
        digest = blake2b(payload, digest_size=8).digest()
        if seq in self._seen:
            if not fetched:
                self._repeated(seq, t_ns, digest)
            return False
        self.first = self.first or seq
        self.first_s = self.first_s if self.count else arrived_s
        self.last_s = arrived_s
        self.count += 1
        self._seen.add(seq, seq)
        self._digests[seq] = digest
        if len(self._digests) > REMEMBERED:
            self._digests.popitem(last=False)
        self._follow(seq, t_ns)
        return True

    def missing(self) -> list[tuple[int, int]]:
        """Runs of seq between the first and the last that never came."""
        return list(self._seen.holes(self.first, self._seen.last))

    def judge(self, notes: Notes, period_s: float | None) -> None:
        """Say what only the whole stream shows.

        Args:
            period_s: as declared; None where nothing is.
        """
        carrier, source = self.key.process, self.source
        for first, last in self.missing():
            example = f"seq {first}" if first == last else f"seq {first} to {last}"
            notes.add("seq_missing", carrier, source, example, count=last - first + 1)
        sane = not notes.has("time_unit", carrier, source)
        if sane and period_s and len(self._intervals_s) >= LEAST_INTERVALS:
            self._judge_pace(notes, period_s)

    def _repeated(self, seq: int, t_ns: int, digest: bytes) -> None:
        known = self._digests.get(seq)
        carrier, source = self.key.process, self.source
        if known is None or known == digest:
            self._notes.add("seq_repeated", carrier, source, f"seq {seq} came twice")
            return
        later = self._last is not None and t_ns > self._last[1] and seq < self._last[0]
        how = "with another content and a later stamp" if later else "with another content"
        self._notes.add("seq_reused", carrier, source, f"seq {seq} came again {how}")
        if later:
            self._last = (self._last[0], t_ns) if self._last else None

    def _follow(self, seq: int, t_ns: int) -> None:
        """Compare the stamp with that of the message before."""
        before, self._last = self._last, max(self._last or (0, 0), (seq, t_ns))
        if before is None or seq != before[0] + 1 or self.key.stream == "info":
            return
        passed_s = (t_ns - before[1]) * NS
        if passed_s < 0:
            example = f"seq {seq} is stamped {-passed_s:.3g} s before seq {before[0]}"
            self._notes.add("time_backwards", self.key.process, self.source, example)
            self._went_back = True
        elif self._went_back:  # the way forward again is no interval
            self._went_back = False
        elif passed_s == 0 and self.key.stream != "ranging":
            example = f"seq {before[0]} and {seq} are stamped {t_ns}"
            self._notes.add("time_repeated", self.key.process, self.source, example)
        elif len(self._intervals_s) < MAX_INTERVALS:
            self._intervals_s.append((seq, passed_s))

    def _judge_pace(self, notes: Notes, period_s: float) -> None:
        carrier, source = self.key.process, self.source
        intervals = [interval for _, interval in self._intervals_s]
        skips = [(seq, i) for seq, i in self._intervals_s if i > SKIPPED * period_s]
        steady = [interval for interval in intervals if interval <= SKIPPED * period_s]
        typical_s = fmean(steady or intervals)
        if len(steady) < len(intervals) / 2 or abs(typical_s / period_s - 1) > RATE_TOLERANCE:
            typical_s = median(intervals)
            example = f"declares a report every {period_s:g} s, sends one every {typical_s:.3g} s"
            notes.add("rate", carrier, source, example)
            return
        if len(skips) >= max(LEAST_SKIPS, SKIPPED_SHARE * len(intervals)):
            seq, interval = skips[0]
            example = f"{interval:.3g} s pass between seq {seq - 1} and {seq}"
            code = "time_jitter" if self.empty else "empty_reports"
            notes.add(code, carrier, source, example, count=len(skips))
        off = sorted(abs(interval - period_s) for interval in steady)
        worst_s = off[int(0.95 * (len(off) - 1))]
        if worst_s > JITTER_SHARE * period_s:
            example = f"one interval in 20 is more than {worst_s:.3g} s off {period_s:g} s"
            notes.add("time_jitter", carrier, source, example)
