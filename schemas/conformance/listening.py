"""Listening to a run on a bus, and asking its publishers what only an answer shows."""

from __future__ import annotations

import time
from collections.abc import Callable

from .. import codec, keys
from ..bus.interface import Bus, Inbox, Liveness, Sample
from ..bus.ledger import StreamKey
from ..errors import WireError
from ..messages import BackfillReply, BackfillRequest, Input, SourceReport, Step
from .checker import Conformance
from .speakers import Life

PUMP_S = 0.05
ASK_S = 1.0
"""A publisher has so long for an answer, and is first asked when it has been heard for so long."""
ATTEMPTS = 2
ROUNDS, MOST_QUESTIONS = 10, 100
"""Of asking for what was missed."""
INBOX_BYTES = 64 * 1024 * 1024


class Listener:
    """Hears everything of a run and fills a `Conformance`.

    Args:
        carrier: only this one; all where it is None.
        now_s: Unix time.
    """

    def __init__(
        self, bus: Bus, run: str, carrier: str | None, now_s: Callable[[], float] = time.time
    ) -> None:
        self.conformance = Conformance(run, carrier, whole=False)
        self._bus, self._run, self._only, self._now_s = bus, run, carrier, now_s
        self._inbox: Inbox[Sample] = Inbox(INBOX_BYTES)
        self._tokens: Inbox[Liveness] = Inbox()
        self._present: set[Life] = set()
        self._newest: dict[StreamKey, int] = {}
        self._sources: set[tuple[str, str, str]] = set()
        self._heard_s: dict[Life, float] = {}
        self._asked: set[Life] = set()
        self._looked_up: set[tuple[str, str, str]] = set()
        self._ended = False

    def listen(self, seconds: float) -> Conformance:
        """Listen so long, or to the end of the run."""
        self._open()
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s and not self._ended:
            self._hear(PUMP_S)
            self._ask_newcomers()
        self._close()
        return self.conformance

    def _open(self) -> None:
        here = self._bus.tokens(keys.every_alive(self._run))
        self._present = {life for life in map(_life, here) if life}
        self.conformance.saw_tokens(self._present)
        self._bus.watch(keys.every_alive(self._run), self._tokens)
        self._bus.subscribe(keys.everything(self._run), self._inbox)
        for sample in self._bus.query(keys.SCENARIO.key(self._run), b"", "", ASK_S):
            self.conformance.take(sample, self._now_s(), fetched=True)

    def _hear(self, timeout_s: float) -> None:
        samples, now_s = self._inbox.take(timeout_s), self._now_s()
        for token in self._tokens.take():
            self._note_token(token)
        for sample in samples:
            self.conformance.take(sample, now_s)
            self._remember(sample, now_s)

    def _note_token(self, token: Liveness) -> None:
        life = _life(token.key)
        if life is None:
            return
        if not token.alive:
            self._present.discard(life)
        elif life not in self._present:
            self._present.add(life)
            self.conformance.saw_tokens([life])
            self.conformance.began(*life)

    def _remember(self, sample: Sample, now_s: float) -> None:
        """The newest message of each stream, to ask for it once more."""
        try:
            address = keys.parse(sample.key)
            message = codec.decode(address.topic.message, sample.payload, sample.encoding)
        except WireError:
            return
        if isinstance(message, Step) and message.ended:
            self._ended = True
        if not isinstance(message, Input) or self._only not in (None, message.carrier):
            return
        self._newest[StreamKey(message.carrier, message.boot, message.stream)] = message.seq
        self._heard_s.setdefault(Life(message.carrier, message.boot), now_s)
        if isinstance(message, SourceReport):
            self._sources.add((message.carrier, message.boot, message.stream))

    def _ask_newcomers(self) -> None:
        """Ask every life once for a message of its own, and for what its sources are."""
        ripe = {life for life, s in self._heard_s.items() if self._now_s() - s >= ASK_S}
        for life in sorted(ripe - self._asked):
            self._asked.add(life)
            self._ask_for_a_message(life)
        for carrier, boot, source in sorted(self._sources - self._looked_up):
            if Life(carrier, boot) in ripe:
                self._looked_up.add((carrier, boot, source))
                self._ask_what_it_is(carrier, source)

    def _ask_for_a_message(self, life: Life) -> None:
        """Whether `backfill` gives what was published a moment ago."""
        key, seq = next((k, n) for k, n in self._newest.items() if (k.process, k.boot) == life)
        if not any(self._backfill(key, seq, seq) for _ in range(ATTEMPTS)):
            asked = f"asked for seq {seq} of {key.stream}, boot {key.boot}, and got nothing"
            self.conformance.note("backfill", life.carrier, "", asked)

    def _ask_what_it_is(self, carrier: str, source: str) -> None:
        key = keys.SOURCE.key(self._run, carrier, source)
        answers = self._bus.query(key, b"", "", ASK_S)
        for sample in answers:
            self.conformance.take(Sample(key, sample.payload, _encoding(sample)), 0.0, fetched=True)
        if not answers:
            self.conformance.note("latched", carrier, source, f"nobody answers for {key}")

    def _backfill(self, key: StreamKey, first: int, last: int) -> int:
        """How many of the messages asked for came; they are noted."""
        request = BackfillRequest(boot=key.boot, stream=key.stream, first=first, last=last)
        question = codec.encode(request), codec.encoding_of(BackfillRequest)
        took = 0
        for answer in self._bus.query(keys.BACKFILL.key(self._run, key.process), *question, ASK_S):
            try:
                records = codec.decode(BackfillReply, answer.payload, answer.encoding).records
            except WireError as error:
                self.conformance.note("backfill", key.process, "", str(error))
                continue
            for record in records:
                sample = Sample(record.key, record.payload, record.encoding)
                self.conformance.take(sample, self._now_s(), fetched=True)
            took += len(records)
        return took

    def _close(self) -> None:
        """Ask for what was lost on the way, and say who has a twin."""
        self._hear(PUMP_S)
        for _ in range(ROUNDS):
            gaps = [gap for gap in self.conformance.gaps() if Life(*gap[0][:2]) in self._present]
            if not sum([self._backfill(*gap) for gap in gaps[:MOST_QUESTIONS]]):
                break
        boots: dict[str, list[str]] = {}
        for carrier, boot in sorted(self._present & set(self._heard_s)):
            boots.setdefault(carrier, []).append(boot)
        for carrier, found in boots.items():
            if len(found) > 1:
                told = f"{len(found)} boots are alive: {', '.join(found[:4])}"
                self.conformance.note("two_processes", carrier, "", told)


def _life(token: str) -> Life | None:
    try:
        _, process, boot = keys.parse_alive(token)
    except WireError:
        return None
    return Life(process, boot)


def _encoding(sample: Sample) -> str:
    """A reply's, or what is meant where its author has left it out."""
    return sample.encoding or codec.encoding_of(keys.SOURCE.message)
