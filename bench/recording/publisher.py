"""Publishes reports of ten carriers at a pace, and answers for what was missed."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from contextlib import ExitStack

from schemas import codec, keys
from schemas.bus.answering import reply_to
from schemas.bus.interface import Bus, Sample
from schemas.bus.zenoh_bus import open_bus
from schemas.messages import BackfillRecord, BackfillReply, BackfillRequest
from schemas.qos import DATA

from .samples import CARRIERS, ENCODING, KEYS, RUN, payloads

BATCH_S = 0.001
PAUSE_S = 0.5
"""Before each carrier's last message, by which is noticed what was lost just before it."""
MOST_RECORDS = 500


def main(endpoint: str, size: str, count: str, hz: str, seed: str) -> None:
    """Make messages, wait for a line, publish them, wait for another line."""
    data = payloads(int(seed), int(size), int(count))
    with open_bus(endpoint) as bus, ExitStack() as stack:
        for number in range(CARRIERS):
            stack.enter_context(bus.announce(keys.alive(RUN, f"c{number}", "b")))
            bus.serve(keys.BACKFILL.key(RUN, f"c{number}"), lambda q: answer(data, q))
        say("ready")
        sys.stdin.readline()
        publish(bus, data[:-CARRIERS], float(hz), 0)
        time.sleep(PAUSE_S)
        publish(bus, data[-CARRIERS:], 0.0, len(data) - CARRIERS)
        say("done")
        sys.stdin.readline()


def publish(bus: Bus, data: list[bytes], hz: float, first: int) -> None:
    """Publish at a rate; 0 Hz = as fast as it goes.

    Args:
        first: number of the first of them.
    """
    started_s, sent, total = time.perf_counter(), 0, len(data)
    while sent < total:
        due = round((time.perf_counter() - started_s) * hz) if hz else total
        for number in range(sent, min(due, total)):
            bus.publish(KEYS[(first + number) % CARRIERS], data[number], ENCODING, DATA)
        sent = max(sent, min(due, total))
        time.sleep(BATCH_S)


def answer(data: list[bytes], question: Sample) -> Iterable[Sample]:
    """What a carrier still has: everything."""
    request = codec.decode(BackfillRequest, question.payload, question.encoding)
    number = int(question.key.rpartition("/c")[2])
    last = min(request.last, request.first + MOST_RECORDS - 1)
    records = [
        BackfillRecord(key=KEYS[number], encoding=ENCODING, payload=data[place])
        for seq in range(request.first, last + 1)
        if (place := (seq - 1) * CARRIERS + number) < len(data)
    ]
    yield reply_to(question, BackfillReply(records=records))


def say(word: str) -> None:
    """Tell who has started this process."""
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
