"""Laws of the codec: what is not valid is refused by name, what is newer is accepted."""

from __future__ import annotations

import math
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from schemas import codec, keys
from schemas import messages as m
from schemas.errors import WireError
from schemas.messages.values import is_positive_definite, order_of_triangle

ENVELOPE: dict[str, Any] = {
    "carrier": "alpha",
    "boot": "b1",
    "stream": "radar",
    "seq": 1,
    "t_ns": 10,
}
POSE = {"latitude_rad": 0.7, "longitude_rad": 0.5}
TOPIC_MESSAGES = sorted({t.message for t in keys.TOPICS}, key=lambda message: message.__name__)


def report(**columns: Any) -> bytes:
    packed: bytes = msgpack.packb(ENVELOPE | columns)
    return packed


def refused(message: type[msgspec.Struct], payload: bytes, *named: str) -> None:
    with pytest.raises(WireError) as caught:
        codec.decode(message, payload)
    assert caught.value.where == message.__name__
    for words in named:
        assert words in str(caught.value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1.0, "12", True, [1.0]])
def test_a_range_that_is_none_is_refused_by_field(value: object) -> None:
    refused(m.SourceReport, report(range_m=[1.0, value]), "$.range_m[1]")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("seq", 0),
        ("seq", 1.5),
        ("seq", 2**63),
        ("t_ns", -1),
        ("t_ns", "10"),
        ("carrier", "Alpha"),
        ("carrier", ""),
        ("carrier", "a" * 33),
        ("boot", "b1\n"),
        ("step", None),
        ("bearing_rad", [361.0]),
        ("bearing_rad", 1.0),
        ("sigma_range_m", [0.0]),
        ("kind", ["guess"]),
        ("track_id", ["t" * 1025]),
        ("swept", {"start_rad": 0.0}),
    ],
)
def test_a_field_out_of_bounds_or_of_another_type_is_refused_by_name(
    field: str, value: object
) -> None:
    refused(m.SourceReport, report(**{field: value}), field)


def test_columns_of_different_lengths_are_refused_by_name() -> None:
    refused(m.SourceReport, report(bearing_rad=[0.1, 0.2], range_m=[5.0]), "range_m: got 1 logs")
    features = {"length": {"values": [1.0, 2.0]}}
    refused(m.SourceReport, report(bearing_rad=[0.1], features=features), "features.length.values")
    features = {"length": {"values": [1.0], "sigmas": [1.0, 2.0]}}
    refused(m.SourceReport, report(bearing_rad=[0.1], features=features), "features.length.sigmas")


@pytest.mark.parametrize(
    ("triangle", "why"),
    [
        ([1.0, 0.0, 0.0, 1.0, 0.0, -1.0], "not positive definite"),
        ([1.0, 2.0, 0.0, 1.0, 0.0, 1.0], "not positive definite"),
        ([0.0] * 6, "not positive definite"),
        ([1.0, 0.0], "got 2 elements, expected 6 or 21"),
        ([1.0, 0.0, 1.0], "got 3 elements, expected 6 or 21"),
        ([], "got 0 elements"),
        ([1.0, 0.0, 0.0, math.nan, 0.0, 1.0], "$.pose.covariance"),
    ],
)
def test_what_is_no_covariance_is_refused_by_name(triangle: list[float], why: str) -> None:
    payload = msgpack.packb(ENVELOPE | {"pose": POSE | {"covariance": triangle}})
    refused(m.Navigation, payload, "covariance", why)


def test_a_track_filter_needs_the_covariance_of_its_state() -> None:
    track = {"model": "cv", "q": 1.0, "previous_t_ns": 1, "state": [0.0] * 4}
    good = track | {"covariance": [1, 0, 0, 0, 1, 0, 0, 1, 0, 1]}
    assert len(codec.decode(m.SourceReport, report(filter=[good]))) == 1
    refused(m.SourceReport, report(filter=[track | {"covariance": [1.0, 0.0, 1.0]}]), "covariance")


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.floats(-3, 1))
@settings(deadline=None)
def test_positive_definite_as_numpy_finds_it(seed: int, order: int, shift: float) -> None:
    root = np.random.default_rng(seed).normal(size=(order, order))
    matrix = root @ root.T + shift * np.eye(order)
    triangle = [float(x) for x in matrix[np.triu_indices(order)]]
    least = float(np.linalg.eigvalsh(matrix)[0])
    if abs(least) > 1e-9:  # nearer to singular, rounding decides
        assert is_positive_definite(triangle) == (least > 0)
    assert order_of_triangle(len(triangle)) == order


@pytest.mark.parametrize("length", [0, 2, 4, 5, 7, 9, 77])
def test_other_lengths_are_no_triangle(length: int) -> None:
    assert order_of_triangle(length) == 0
    assert not is_positive_definite([1.0] * length)


def test_a_newer_sender_is_understood_and_an_older_one_gets_the_defaults() -> None:
    newer = report(bearing_rad=[0.5], plasma_density=[1.0], swept=None)
    assert codec.decode(m.SourceReport, newer) == m.SourceReport(**ENVELOPE, bearing_rad=[0.5])
    oldest = codec.decode(m.Step, msgpack.packb({"boot": "b1", "step": 3, "t_ns": 5}))
    assert (oldest.mode, oldest.final, oldest.ended) == ("lockstep", False, "")
    assert len(codec.decode(m.SourceReport, report())) == 0


def test_whole_numbers_pass_for_real_ones() -> None:
    assert codec.decode(m.SourceReport, report(range_m=[5])).range_m == [5.0]


def test_json_takes_decimal_strings_for_64_bit_integers_only() -> None:
    payload = b'{"boot": "b1", "step": "7", "t_ns": "1767225600000000001"}'
    step = codec.decode(m.Step, payload, "application/json;crossfix.Step")
    assert (step.step, step.t_ns) == (7, 1767225600000000001)
    for bad in (b'{"boot": "b1", "step": "7.0", "t_ns": 1}', b'{"boot": 7, "step": 7, "t_ns": 1}'):
        with pytest.raises(WireError, match="Step: Expected"):
            codec.decode(m.Step, bad, "application/json")


@given(st.binary(max_size=200))
@example(b"")
@example(b"\xc1")
@example(b"\x81" * 5000)
@example(b"[" * 5000)
@settings(deadline=None, max_examples=150)
def test_random_bytes_are_refused_and_nothing_else_is_raised(payload: bytes) -> None:
    for message in TOPIC_MESSAGES:
        for encoding in ("", "application/json"):
            with pytest.raises(WireError):
                codec.decode(message, payload, encoding)


@given(st.data())
@settings(deadline=None, max_examples=30)
def test_cut_or_altered_payloads_are_refused_or_valid(
    messages_of: Any, data: st.DataObject
) -> None:
    message = data.draw(messages_of(data.draw(st.sampled_from(TOPIC_MESSAGES))))
    whole = bytearray(codec.encode(message))
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(WireError):
        codec.decode(type(message), bytes(whole[:cut]))
    whole[cut] ^= 1 << data.draw(st.integers(0, 7))
    try:
        altered = codec.decode(type(message), bytes(whole))
    except WireError:
        return
    assert codec.decode(type(message), codec.encode(altered)) == altered


def test_size_is_bounded_both_ways() -> None:
    huge = m.TruthScenario(name="a", seed=1, text="x" * codec.MAX_PAYLOAD_BYTES)
    with pytest.raises(WireError, match="TruthScenario too large; got 83"):
        codec.encode(huge)
    with pytest.raises(WireError, match="TruthScenario too large"):
        codec.decode(m.TruthScenario, bytes(codec.MAX_PAYLOAD_BYTES + 1))


def test_what_anybody_may_say_is_bounded_in_bytes_and_in_logs() -> None:
    with pytest.raises(WireError, match="SourceReport too large"):
        codec.decode(m.SourceReport, bytes(codec.MAX_INPUT_BYTES + 1))
    envelope = {"carrier": "a", "boot": "b", "stream": "s", "seq": 1, "t_ns": 1}
    many = msgpack.packb({**envelope, "covariance_position": [[1, 0, 1]] * 100_000})
    with pytest.raises(WireError, match="got 100000 logs, expected at most 10000"):
        codec.decode(m.SourceReport, many)


def test_encoding_names_form_and_message() -> None:
    assert codec.encoding_of(m.Step) == "application/msgpack;crossfix.Step"
    assert codec.encoding_of(m.Step, "json") == "application/json;crossfix.Step"
