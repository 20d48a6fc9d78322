"""What a line of JSON may say, and how a wrong one is refused: by the field to blame."""

from __future__ import annotations

import json
from math import pi, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from carriers.bridges.jsonl import reading_of
from carriers.bridges.listening import line_of
from carriers.bridges.records import Reading, RecordError
from schemas import codec, keys
from schemas.bus.interface import Sample
from schemas.messages import Navigation, Pose, SourceReport
from tests.carriers.bridges.outlets import NOW_NS, SECOND, Bench


def read(**said: object) -> Reading:
    return reading_of(json.dumps(said).encode(), "harbour", "radar")


def test_degrees_and_plain_values_become_columns_in_radians() -> None:
    reading = read(bearing_deg=90, range_m=5300, sigma_bearing_deg=[0.3], track_id="17")
    assert reading.topic is keys.REPORT
    assert reading.source == "radar"
    assert reading.fields == {
        "bearing_rad": [pi / 2],
        "range_m": [5300],
        "sigma_bearing_rad": [pytest.approx(radians(0.3))],
        "track_id": ["17"],
    }


def test_what_is_absent_in_one_log_is_null_and_what_is_absent_in_all_is_left_out() -> None:
    reading = read(bearing_deg=[None, 180], identity=None)
    assert reading.fields == {"bearing_rad": [None, pi], "identity": None}


def test_degrees_hold_inside_too() -> None:
    pose = {"latitude_deg": 45, "longitude_deg": -5, "heading_rad": 1}
    reading = read(topic="navigation", pose=pose)
    assert reading.topic is keys.NAVIGATION
    inner = reading.fields["pose"]
    assert inner["latitude_rad"] == pytest.approx(pi / 4)
    assert inner["heading_rad"] == 1
    assert read(swept={"start_deg": 90, "width_deg": 180}).fields["swept"]["width_rad"] == pi


@pytest.mark.parametrize(
    ("time", "t_ns"),
    [
        ({"t_ns": NOW_NS}, NOW_NS),
        ({"t_ns": str(NOW_NS)}, NOW_NS),
        ({"t_s": NOW_NS / SECOND + 0.25}, NOW_NS + SECOND // 4),
        ({}, None),
    ],
)
def test_times(time: dict[str, object], t_ns: int | None) -> None:
    assert read(**time).t_ns == t_ns


@pytest.mark.parametrize(
    ("line", "field", "words"),
    [
        ("rubbish", "line", "not JSON"),
        ("[1, 2]", "line", "no JSON object"),
        ('{"bearing_rad": 1e999}', "line", "not JSON"),
        ("\xff", "line", "not JSON"),
        ("[" * 100_000, "line", "not JSON"),
        ('{"rnage_m": 1}', "rnage_m", "range_m"),
        ('{"bearing_deg": 1, "bearing_rad": 1}', "bearing_rad", "given twice"),
        ('{"t_ns": 1, "t_s": 1}', "t_s", "given twice"),
        ('{"t_ns": 1.5}', "t_ns", "whole number"),
        ('{"t_ns": -1}', "t_ns", "no time"),
        ('{"t_ns": true}', "t_ns", "no time"),
        ('{"t_ns": "1e9"}', "t_ns", "no time"),
        ('{"t_s": "noon"}', "t_s", "no time"),
        ('{"t_s": -1}', "t_s", "no time"),
        ('{"topic": "correction"}', "topic", "navigation"),
        ('{"topic": ["report"]}', "topic", "navigation"),
        ('{"carrier": "other"}', "carrier", "harbour"),
        ('{"source": 7}', "source", "no name"),
        ('{"bearing_deg": "north"}', "bearing_deg", "no number"),
        ('{"bearing_deg": [[1]]}', "bearing_deg", "no number"),
        ('{"topic": "navigation", "pose": {"lat": 1}}', "lat", "no such field"),
    ],
)
def test_a_wrong_line_names_its_field(line: str, field: str, words: str) -> None:
    with pytest.raises(RecordError) as raised:
        reading_of(line.encode("latin-1"), "harbour", "radar")
    assert raised.value.field == field
    assert words in str(raised.value)


def test_what_a_run_prints_can_be_read_again() -> None:
    envelope = {"carrier": "harbour", "boot": "b", "seq": 9, "step": 4, "t_ns": NOW_NS}
    report = SourceReport(**envelope, stream="ais", bearing_rad=[0.5, 1], range_m=[10, None])
    pose = Pose(latitude_rad=0.6, longitude_rad=-0.1, covariance=[1, 0, 0, 1, 0, 1])
    navigation = Navigation(**envelope, stream="navigation", pose=pose, kind="fix")
    bench = Bench()
    for message, key in (
        (report, keys.REPORT.key("r", "harbour", "ais")),
        (navigation, keys.NAVIGATION.key("r", "harbour")),
    ):
        assert bench.feed(line_of(Sample(key, codec.encode(message), ""))) == []
    (again,) = bench.kept.of(SourceReport)
    assert (again.stream, again.bearing_rad, again.range_m) == ("ais", [0.5, 1], [10, None])
    assert (again.seq, again.step, again.t_ns) == (1, 0, NOW_NS)
    assert bench.kept.of(Navigation)[-1].pose == pose


_JSON = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.integers() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["pose", "latitude_deg", "x"]), inner, max_size=3)
    ),
    max_leaves=8,
)
_NAMES = ["topic", "t_ns", "t_s", "source", "stream", "pose", "properties", "features", "kind"]
_NAMES += ["bearing_deg", "range_m", "covariance_polar", "filter", "increment", "swept", "classes"]
_VALUES = _JSON | st.sampled_from(["report", "navigation", "source", "ranging", "radar", NOW_NS])


@given(st.lists(st.dictionaries(st.sampled_from(_NAMES), _VALUES), max_size=4), st.binary())
def test_whatever_comes_is_published_or_counted_and_nothing_is_raised(
    objects: list[dict[str, object]], rubbish: bytes
) -> None:
    bench = Bench()
    lines = [json.dumps(said).encode() for said in objects]
    given_lines = len(lines) + sum(bool(r.strip()) for r in rubbish.split(b"\n"))
    refused = bench.feed(b"\n".join([*lines, rubbish]))
    counts = bench.bridge.counts
    assert counts.received == counts.decoded + counts.rejected == given_lines
    assert counts.rejected == len(refused) == sum(counts.rejected_by.values())
    assert counts.published == len(bench.kept.sent)
    streams: dict[str, int] = {}
    for _, message in bench.kept.sent:
        streams[message.stream] = streams.get(message.stream, 0) + 1
        assert message.seq == streams[message.stream]
