"""What a lane reads, the codec reads; what the codec refuses, a lane refuses in the same words."""

from __future__ import annotations

from typing import Any

import msgpack
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from schemas import codec, shapes
from schemas.bus.ledger import StreamKey
from schemas.errors import WireError
from schemas.messages import Input, Navigation, SourceReport
from schemas.messages.inputs import MAX_LOGS
from schemas.shapes import Lane, Shapes

STREAM = StreamKey("alpha", "b1", "radar")
ENVELOPE: dict[str, Any] = {"carrier": "alpha", "boot": "b1", "stream": "radar", "seq": 7}
REPORT = ENVELOPE | {"t_ns": 5, "bearing_rad": [0.1, 0.2], "range_m": [10.0, None]}
ENCODING = codec.encoding_of(SourceReport)
FEATURES = {"length": {"values": [1.0, 2.0]}}
values = st.sampled_from(
    [0, -1, 2**63, 1.5, float("nan"), 7.0, "x", None, [], [0.1], [0.1, 0.2], [1, "x"], {}, FEATURES]
)
changes = st.dictionaries(
    st.sampled_from([*REPORT, "swept", "features", "covariance_polar", "kind", "unknown"]),
    values,
    max_size=3,
)


def lane(message: type[Input] = SourceReport, encoding: str = ENCODING, **met: object) -> Lane:
    """One that has met a report with these fields as well."""
    made = Lane(Shapes(), STREAM, message, encoding)
    if message is SourceReport and "json" not in encoding:
        assert made.next(packed(REPORT | met)) is not None
    return made


def packed(fields: dict[str, object]) -> bytes:
    return bytes(msgpack.packb(fields))


def outcome(read: Any) -> object:
    """What comes of reading: the envelope, nothing, or the reason."""
    try:
        message = read()
    except WireError as error:
        of_nobody = "matching regex" in str(error)  # a name that is none
        return "of another stream" if of_nobody else str(error)
    if message is None or [message.carrier, message.boot, message.stream] != [*STREAM]:
        return "of another stream"
    return message.seq, message.t_ns


@given(changes=changes, left_out=st.sets(st.sampled_from(list(REPORT)), max_size=2))
@example(changes={"range_m": [10.0]}, left_out=set())
@example(changes={"range_m": []}, left_out=set())
@example(changes={"range_m": None}, left_out=set())
@example(changes={"range_m": [10.0, -1.0]}, left_out=set())
@example(changes={"unknown": 1}, left_out={"range_m"})
@example(changes={"covariance_polar": [[1.0, 2.0, 1.0]] * 2}, left_out={"range_m"})
@example(changes={"features": {"length": {"values": [1.0]}}}, left_out={"range_m"})
def test_a_lane_and_the_codec_find_the_same(changes: dict[str, Any], left_out: set[str]) -> None:
    fields = {name: value for name, value in (REPORT | changes).items() if name not in left_out}
    payload, tried = packed(fields), lane()
    expected = outcome(lambda: codec.decode(SourceReport, payload, ENCODING))
    assert outcome(lambda: tried.next(payload)) == expected
    assert outcome(lambda: tried.next(payload)) == expected  # now that it has met it
    assert outcome(lambda: tried.next(packed(REPORT))) == (7, 5)


@given(place=st.integers(0, len(packed(REPORT)) - 1), bit=st.integers(0, 7))
def test_a_flipped_bit_is_found_as_the_codec_finds_it(place: int, bit: int) -> None:
    broken = bytearray(packed(REPORT))
    broken[place] ^= 1 << bit
    expected = outcome(lambda: codec.decode(SourceReport, bytes(broken), ENCODING))
    assert outcome(lambda: lane().next(bytes(broken))) == expected


def test_a_message_of_a_known_shape_is_not_read_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = lane()
    monkeypatch.setattr(SourceReport, "__post_init__", lambda report: pytest.fail("read whole"))
    assert tried.next(packed(REPORT | {"seq": 8, "range_m": [1.0, 2.0]})) is not None


def test_shapes_of_one_size_in_turn_are_all_read() -> None:
    tried = lane()
    other = {**REPORT, "elevation_rad": [0.0, 0.1]}
    del other["range_m"]
    for seq in range(8, 16):
        message = tried.next(packed((other if seq % 2 else REPORT) | {"seq": seq}))
        assert message is not None
        assert message.seq == seq


def test_json_and_other_messages_are_read_too() -> None:
    report = codec.decode(SourceReport, packed(REPORT))
    again = lane(encoding="application/json").next(codec.encode_json(report))
    assert again == report
    place = {"latitude_rad": 0.1, "longitude_rad": 0.2, "heading_rad": 0.3}
    navigation = packed(ENVELOPE | {"t_ns": 5, "pose": place})
    tried = lane(Navigation)
    for _ in range(2):
        assert outcome(lambda: tried.next(navigation)) == (7, 5)


def test_too_many_logs_and_too_many_bytes_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    many = packed(REPORT | {"bearing_rad": [0.1] * (MAX_LOGS + 1), "range_m": [1] * (MAX_LOGS + 1)})
    with pytest.raises(WireError, match="send several reports"):
        lane().next(many)
    monkeypatch.setattr(codec, "MAX_INPUT_BYTES", len(packed(REPORT)))
    codec.reader.cache_clear()
    tried = lane()
    with pytest.raises(WireError, match="too large"):
        tried.next(packed(REPORT | {"bearing_rad": [0.1] * 3, "range_m": [1.0] * 3}))
    codec.reader.cache_clear()


def test_only_so_many_shapes_are_learnt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapes, "MAX_SHAPES", 1)
    known = Shapes()
    first = known.learn(SourceReport, packed(REPORT))
    assert first is not None
    assert known.learn(SourceReport, packed(REPORT | {"east_m": [1.0, 2.0]})) is None
    assert known.learn(SourceReport, packed(REPORT)) is first


def test_a_field_that_nobody_reads_may_hold_anything() -> None:
    """Text that is none, in a field we do not know: the codec skips it, and so does a lane."""
    payload = packed(REPORT | {"unknown": "ab"}).replace(b"\xa2ab", b"\xa2\xff\xfe")
    fresh = Lane(Shapes(), STREAM, SourceReport, ENCODING)
    for tried in (fresh, lane()):
        assert outcome(lambda tried=tried: tried.next(payload)) == (7, 5)  # type: ignore[misc]
