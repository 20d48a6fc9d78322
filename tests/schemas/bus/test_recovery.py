"""What is missing is asked for; an owner speaks for itself only; a silent one holds up nobody."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from schemas import codec, keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.ledger import StreamKey
from schemas.bus.memory_bus import MemoryNetwork
from schemas.bus.outbox import MAX_RECORDS, Outbox
from schemas.bus.recovery import Gap, Recovery
from schemas.messages import BackfillRecord, BackfillReply, BackfillRequest, SourceReport
from tests.promptness import prompt, within

RUN = "r"
ALPHA = StreamKey("alpha", "b", "radar")
DEADLINE_S = 20.0


@pytest.fixture
def network() -> Iterator[MemoryNetwork]:
    with MemoryNetwork() as network:
        yield network


def report(seq: int) -> SourceReport:
    return SourceReport(carrier="alpha", boot="b", stream="radar", seq=seq, t_ns=seq)


def reply(*records: tuple[str, bytes]) -> list[Sample]:
    held = [BackfillRecord(key=key, encoding="", payload=payload) for key, payload in records]
    key = keys.BACKFILL.key(RUN, "alpha")
    return [Sample(key, codec.encode(BackfillReply(records=held)), "")]


def pursued(recovery: Recovery, gaps: list[Gap], until: threading.Event) -> list[Gap]:
    """Turn the loop as a receiver does, until something has happened."""
    hopeless: list[Gap] = []
    deadline_s = time.monotonic() + DEADLINE_S
    while not until.wait(0.01) and not hopeless and time.monotonic() < deadline_s:
        hopeless = recovery.pursue(gaps, time.monotonic())
    return hopeless


def test_an_owner_speaks_for_its_own_streams_only(network: MemoryNetwork) -> None:
    asked = threading.Event()
    honest = keys.REPORT.key(RUN, "alpha", "radar")
    foreign = [
        keys.STEP.key(RUN),
        keys.CLOSED_WORLD.key(RUN),
        keys.REPORT.key(RUN, "bravo", "radar"),
        keys.REPORT.key(RUN, "alpha", "ais"),
        keys.REPORT.key("other", "alpha", "radar"),
        f"{keys.PREFIX}/{RUN}/report/alpha/*",
    ]

    def answer(_: Sample) -> list[Sample]:
        asked.set()
        return reply(*((key, b"x") for key in [*foreign, honest]))

    network.bus("alpha").serve(keys.BACKFILL.key(RUN, "alpha"), answer)
    inbox: Inbox[Sample] = Inbox()
    recovery = Recovery(RUN, network.bus("fusion"), inbox)
    pursued(recovery, [(ALPHA, 1, 3)], asked)
    got = inbox.take(DEADLINE_S)
    recovery.close()
    assert [sample.key for sample in got] == [honest]
    assert (recovery.fetched, recovery.refused) == (1, len(foreign))
    assert inbox.drops == 0


def test_an_answer_that_is_none_leaves_the_gap_open(network: MemoryNetwork) -> None:
    asked = threading.Event()

    def answer(question: Sample) -> list[Sample]:
        asked.set()
        return [Sample(question.key, b"\xc1 rubbish", "")]

    network.bus("alpha").serve(keys.BACKFILL.key(RUN, "alpha"), answer)
    recovery = Recovery(RUN, network.bus("fusion"), Inbox())
    assert pursued(recovery, [(ALPHA, 1, 2**62)], asked) == []
    recovery.close()


@prompt
def test_one_silent_owner_holds_up_nobody(network: MemoryNetwork) -> None:
    """Its gap changes all the time, and none of its answers ever comes."""
    release, answered = threading.Event(), threading.Event()

    def hang(_: Sample) -> list[Sample]:
        release.wait(DEADLINE_S)
        return []

    def answer(_: Sample) -> list[Sample]:
        answered.set()
        return []

    network.bus("mute").serve(keys.BACKFILL.key(RUN, "mute"), hang)
    network.bus("alpha").serve(keys.BACKFILL.key(RUN, "alpha"), answer)
    recovery = Recovery(RUN, network.bus("fusion"), Inbox())
    mute = StreamKey("mute", "b", "radar")
    never = threading.Event()
    threading.Timer(1.5, never.set).start()
    first = 0
    while not never.wait(0.01):
        first += 1
        recovery.pursue([(mute, first, first)], time.monotonic())
    try:
        with within(3.5):  # eight questions were under way at most when it fell silent
            pursued(recovery, [(mute, first, first), (ALPHA, 1, 1)], answered)
    finally:
        release.set()
        recovery.close()
    assert answered.is_set()


def test_backfill_gives_what_is_left_of_a_long_gap(network: MemoryNetwork) -> None:
    bus = network.bus("alpha")
    outbox = Outbox(RUN, "alpha", "b", bus, bus)
    for seq in (2000, 2001, 2**62):
        outbox.send(keys.REPORT, ("alpha", "radar"), report(seq))
    got = asked_for(network, 1, 2**63 - 1)
    assert [record.seq for record in got] == [2000, 2001, 2**62]
    assert [record.seq for record in asked_for(network, 2001, 2001)] == [2001]
    assert asked_for(network, 9, 3) == []
    for seq in range(3000, 3000 + 2 * MAX_RECORDS):
        outbox.send(keys.REPORT, ("alpha", "radar"), report(seq))
    assert len(asked_for(network, 1, 2**63 - 1)) == MAX_RECORDS


def asked_for(network: MemoryNetwork, first: int, last: int) -> list[SourceReport]:
    request = BackfillRequest(boot="b", stream="radar", first=first, last=last)
    key = keys.BACKFILL.key(RUN, "alpha")
    (answer,) = network.bus("asker").query(key, codec.encode(request), "", DEADLINE_S)
    records = codec.decode(BackfillReply, answer.payload).records
    return [codec.decode(SourceReport, record.payload) for record in records]
