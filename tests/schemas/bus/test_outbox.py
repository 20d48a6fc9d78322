"""A process answers for what it has published, in the form it is asked in."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator

import msgpack
import pytest

from schemas import codec, keys
from schemas.bus.interface import Bus
from schemas.bus.memory_bus import MemoryNetwork
from schemas.bus.outbox import Outbox
from schemas.messages import BackfillRequest, SourceInfo, SourceProperties, SourceReport

RUN, ASKING_S = "r", 2.0
JSON = "application/json"
REPORT = keys.REPORT.key(RUN, "alpha", "radar")
BACKFILL = keys.BACKFILL.key(RUN, "alpha")


@pytest.fixture
def network() -> Iterator[MemoryNetwork]:
    with MemoryNetwork() as network:
        yield network


@pytest.fixture
def outbox(network: MemoryNetwork) -> Outbox:
    """Of alpha, which has introduced its radar and reported five times."""
    outbox = Outbox(RUN, "alpha", "b", network.bus("control"), network.bus("data"))
    envelope = {"carrier": "alpha", "boot": "b", "t_ns": 1}
    info = SourceInfo(
        **envelope, stream="info", seq=1, source="radar", properties=SourceProperties()
    )
    outbox.send(keys.SOURCE, ("alpha", "radar"), info)
    for seq in range(1, 6):
        report = SourceReport(**envelope, stream="radar", seq=seq)
        outbox.send(keys.REPORT, ("alpha", "radar"), report)
    return outbox


@pytest.fixture
def stranger(network: MemoryNetwork) -> Bus:
    return network.bus("stranger")


def request(**more: object) -> dict[str, object]:
    return {"stream": "radar", "first": 2, "last": 3, **more}


def test_what_was_published_is_had_again_byte_for_byte(outbox: Outbox, stranger: Bus) -> None:
    (reply,) = stranger.query(BACKFILL, msgpack.packb(request()), "", ASKING_S)
    assert reply.encoding == "application/msgpack;crossfix.BackfillReply"
    records = msgpack.unpackb(reply.payload)["records"]
    assert [record["key"] for record in records] == [REPORT, REPORT]
    reports = [codec.decode(SourceReport, record["payload"]) for record in records]
    assert [report.seq for report in reports] == [2, 3]


def test_who_asks_in_json_is_answered_in_json(outbox: Outbox, stranger: Bus) -> None:
    asked = json.dumps(request(first="2")).encode()  # 64-bit integers may be strings there
    (reply,) = stranger.query(BACKFILL, asked, JSON, ASKING_S)
    assert reply.encoding == "application/json;crossfix.BackfillReply"
    records = json.loads(reply.payload)["records"]
    payloads = [base64.b64decode(record["payload"]) for record in records]
    assert [codec.decode(SourceReport, payload).seq for payload in payloads] == [2, 3]


@pytest.mark.parametrize(
    ("payload", "encoding"),
    [(b"\xc1", ""), (b"", ""), (b"{", JSON), (b'{"stream": 7}', JSON), (b"[]", JSON)],
)
def test_a_question_that_is_none_is_not_answered_and_harms_nobody(
    payload: bytes, encoding: str, outbox: Outbox, stranger: Bus
) -> None:
    assert stranger.query(BACKFILL, payload, encoding, ASKING_S) == []
    asked = codec.encode(BackfillRequest(stream="radar", first=1, last=5))
    assert len(stranger.query(BACKFILL, asked, "", ASKING_S)) == 1


@pytest.mark.parametrize("more", [{"boot": "other"}, {"stream": "ais"}, {"first": 6, "last": 9}])
def test_what_is_not_held_is_an_empty_answer(
    more: dict[str, object], outbox: Outbox, stranger: Bus
) -> None:
    (reply,) = stranger.query(BACKFILL, msgpack.packb(request(**more)), "", ASKING_S)
    assert msgpack.unpackb(reply.payload) == {"records": []}


def test_a_last_value_is_found_by_its_key_and_by_an_expression(
    outbox: Outbox, stranger: Bus
) -> None:
    key = keys.SOURCE.key(RUN, "alpha", "radar")
    for asked in (key, keys.SOURCE.every(RUN)):
        (sample,) = stranger.query(asked, b"", "", ASKING_S)
        assert sample.key == key
        assert codec.decode(SourceInfo, sample.payload).source == "radar"
