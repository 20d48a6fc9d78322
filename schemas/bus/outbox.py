"""What a process has published, kept for those who missed it."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import msgspec

from .. import codec, keys
from ..messages import BackfillRecord, BackfillReply, BackfillRequest
from .answering import reply_to
from .interface import Bus, Sample

MAX_RECORDS = 500
KEEP_S = 60.0
KEEP_BYTES = 128 * 1024 * 1024
REPLY_BYTES = 4 * 1024 * 1024


class _Kept(NamedTuple):
    seq: int
    sent_s: float
    sample: Sample


class Outbox:
    """Publishes messages and answers for them: latched values and `backfill`.

    A message's place in its stream is its `seq`, or its `step` where it has none. Everything of
    the last minute is kept, at most 128 MB of it; acknowledgements and states are not kept, the
    next one says more than the last.
    """

    def __init__(self, run: str, process: str, boot: str, control: Bus, data: Bus) -> None:
        self.run, self.process, self.boot = run, process, boot
        self._control, self._data = control, data
        self._kept: dict[str, deque[_Kept]] = {}
        self._bytes = 0
        self._latched: dict[str, Sample] = {}
        self._lock = threading.Lock()
        data.serve(keys.BACKFILL.key(run, process), self._backfill)

    def begin(self, boot: str) -> None:
        """Forget everything: a new boot of the process counts from 1."""
        with self._lock:
            self.boot = boot
            self._kept.clear()
            self._bytes = 0

    def send(self, topic: keys.Topic, ids: Iterable[str], message: msgspec.Struct) -> None:
        """Publish a message, on the control session if its topic is control."""
        ids = tuple(ids)
        key = topic.key(self.run, *ids)
        sample = Sample(key, codec.encode(message), codec.encoding_of(type(message)))
        self._keep(topic, sample, message)
        bus = self._control if topic.qos.name == "control" else self._data
        bus.publish(key, sample.payload, sample.encoding, topic.qos)

    def last(self, stream: str) -> int:
        """Sequence number of the newest message of a stream; 0 if there is none."""
        kept = self._kept.get(stream)
        return kept[-1].seq if kept else 0

    def streams(self) -> dict[str, int]:
        """Every stream with the sequence number of its newest message."""
        with self._lock:
            return {stream: kept[-1].seq for stream, kept in self._kept.items() if kept}

    def _keep(self, topic: keys.Topic, sample: Sample, message: msgspec.Struct) -> None:
        if topic.latched:
            self._latch(sample)
        seq = getattr(message, "seq", 0) or getattr(message, "step", 0)
        if not seq or not topic.recorded or topic.role is keys.Role.STATUS:
            return
        stream = keys.stream(keys.parse(sample.key))
        with self._lock:
            self._kept.setdefault(stream, deque()).append(_Kept(seq, time.monotonic(), sample))
            self._bytes += len(sample.payload)
            self._prune(stream)

    def _prune(self, stream: str) -> None:
        """Forget the oldest of this stream: what is past its time, or past its share of memory."""
        kept = self._kept[stream]
        horizon_s = kept[-1].sent_s - KEEP_S
        while len(kept) > 1 and (kept[0].sent_s < horizon_s or self._bytes > KEEP_BYTES):
            self._bytes -= len(kept.popleft().sample.payload)

    def _latch(self, sample: Sample) -> None:
        with self._lock:
            new = sample.key not in self._latched
            self._latched[sample.key] = sample
        if new:
            self._data.serve(sample.key, lambda _: [self._latched[sample.key]])

    def _backfill(self, question: Sample) -> Iterable[Sample]:
        request = codec.decode(BackfillRequest, question.payload, question.encoding)
        yield reply_to(question, BackfillReply(records=self._records(request)))

    def _records(self, request: BackfillRequest) -> list[BackfillRecord]:
        if request.boot not in ("", self.boot):
            return []
        with self._lock:
            found = [
                kept.sample
                for kept in self._kept.get(request.stream, ())
                if request.first <= kept.seq <= request.last
            ]
        records: list[BackfillRecord] = []
        size = 0
        for sample in found[:MAX_RECORDS]:
            size += len(sample.payload)
            if records and size > REPLY_BYTES:
                break
            records.append(
                BackfillRecord(key=sample.key, encoding=sample.encoding, payload=sample.payload)
            )
        return records
