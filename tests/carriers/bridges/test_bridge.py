"""What a bridge adds to the records of its feed: envelopes, SourceInfo, navigation, counts."""

from __future__ import annotations

import json
import math
from collections import Counter

import pytest
from msgspec.structs import replace

from carriers.bridges.bridge import MAX_SOURCES, Station
from carriers.bridges.counts import MAX_FIELDS, OTHER, Counts
from schemas.messages import (
    Correction,
    Feedback,
    Navigation,
    Ranging,
    SourceInfo,
    SourceProperties,
    SourceReport,
)
from tests.carriers.bridges.outlets import NOW_NS, POSE, SECOND, Bench

LOG = {"bearing_deg": 10, "range_m": 500}


def line(**said: object) -> bytes:
    return json.dumps(said).encode() + b"\n"


def test_streams_are_gapless_and_a_refused_line_takes_no_number() -> None:
    bench = Bench()
    for source in ("radar", "radar", "ais", "radar"):
        bench.feed(line(**LOG, source=source) + line(bearing_deg=[1], range_m=[-5]))
    reports = bench.kept.of(SourceReport)
    assert [(r.stream, r.seq) for r in reports] == [
        ("radar", 1), ("radar", 2), ("ais", 1), ("radar", 3),
    ]  # fmt: skip
    assert {(r.carrier, r.boot, r.step, r.t_ns) for r in reports} == {("harbour", "b1", 0, NOW_NS)}
    assert bench.bridge.counts.rejected_by == {"range_m": 4}


def test_key_and_envelope_agree() -> None:
    bench = Bench()
    bench.feed(line(**LOG, source="ais"))
    assert [key.removeprefix("crossfix/@v1/r/") for key, _ in bench.kept.sent] == [
        "navigation/harbour",
        "source/harbour/ais",
        "report/harbour/ais",
    ]


@pytest.mark.parametrize(
    ("logs", "coordinates"),
    [
        ({"bearing_deg": 1, "range_m": 2}, "bearing_range"),
        ({"bearing_deg": [1]}, "bearing"),
        ({"east_m": 1, "north_m": 2}, "cartesian"),
        ({"latitude_deg": 1, "longitude_deg": 2}, "geodetic"),
    ],
)
def test_a_source_is_told_by_its_first_logs(logs: dict[str, object], coordinates: str) -> None:
    bench = Bench(Station(properties=SourceProperties(kind="ais", sigma_position_m=5.0)))
    bench.feed(line() + line(**logs) + line(**logs))
    (info,) = bench.kept.of(SourceInfo)
    assert (info.source, info.properties.coordinates) == ("radar", coordinates)
    assert (info.properties.kind, info.properties.sigma_position_m) == ("ais", 5.0)
    assert len(bench.kept.of(SourceReport)) == 3  # one of them empty


def test_a_source_that_tells_itself_is_not_told_again() -> None:
    bench = Bench()
    bench.feed(line(topic="source", properties={"kind": "lidar"}) + line(**LOG))
    assert [info.properties.kind for info in bench.kept.of(SourceInfo)] == ["lidar"]


def test_a_carrier_at_rest_says_where_it_is_before_it_reports_and_once_a_second() -> None:
    bench = Bench()
    bench.feed(line(**LOG))
    bench.bridge.stand()
    assert isinstance(bench.kept.sent[0][1], Navigation)
    for tenth in range(30):
        bench.now_ns = NOW_NS + tenth * SECOND // 10
        bench.bridge.stand()
    navigation = bench.kept.of(Navigation)
    assert [n.t_ns - NOW_NS for n in navigation] == [0, SECOND, 2 * SECOND]
    assert all(n.pose == POSE and n.kind == "fix" for n in navigation)


def test_navigation_of_the_feed_gets_the_stations_covariance_unless_it_has_its_own() -> None:
    ours, theirs = [9.0, 0, 0, 9, 0, 1], [4.0, 0, 0, 4, 0, 1]
    bench = Bench(Station(covariance=ours))
    place = {"latitude_deg": 36, "longitude_deg": -5}
    bench.feed(line(topic="navigation", pose=place))
    bench.feed(line(topic="navigation", pose={**place, "covariance": theirs}))
    assert [n.pose.covariance for n in bench.kept.of(Navigation)] == [ours, theirs]
    bench.bridge.stand()
    assert len(bench.kept.sent) == 2  # nobody told it where it stands


def test_ranges_pass_too() -> None:
    bench = Bench()
    bench.feed(line(topic="ranging", peer="alpha", kind="two_way", value_m=1200, sigma_m=3))
    assert [(r.stream, r.seq, r.peer) for r in bench.kept.of(Ranging)] == [("ranging", 1, "alpha")]


def test_late_lines_are_published_and_counted_and_those_of_the_future_refused() -> None:
    bench = Bench()
    stamps = [NOW_NS - 2 * SECOND, NOW_NS - SECOND, NOW_NS + SECOND, NOW_NS + SECOND + 1]
    refused = [bench.feed(line(**LOG, t_ns=t_ns)) for t_ns in stamps]
    assert refused == [[], [], [], ["t_ns"]]
    assert bench.bridge.counts.late == 1
    assert len(bench.kept.of(SourceReport)) == 3


def test_stamps_of_another_clock_can_be_left_aside() -> None:
    bench = Bench(Station(stamp_arrivals=True))
    assert bench.feed(line(**LOG, t_ns=9 * NOW_NS // 8)) == []
    assert bench.kept.of(SourceReport)[0].t_ns == NOW_NS


@pytest.mark.parametrize("source", ["", "A", "a b", "*", "info", "navigation", "x" * 33])
def test_a_source_that_could_not_be_told_from_others_is_refused(source: str) -> None:
    bench = Bench()
    assert bench.feed(line(**LOG, source=source)) == ["source"]
    assert bench.kept.sent == []


def test_sources_without_end_take_bounded_memory() -> None:
    bench = Bench()
    for n in range(MAX_SOURCES):
        assert bench.feed(line(**LOG, source=f"s{n}")) == []
    assert bench.feed(line(**LOG, source="one-more")) == ["source"]
    assert bench.feed(line(**LOG, source="s0")) == []


def test_counts_by_field_are_bounded() -> None:
    counts = Counts()
    for n in range(3 * MAX_FIELDS):
        counts.reject(f"field{n}")
    counts.reject("field1")
    assert len(counts.rejected_by) == MAX_FIELDS + 1
    assert counts.rejected_by[OTHER] == 2 * MAX_FIELDS
    assert counts.rejected_by["field1"] == 2
    assert counts.counters()["rejected field1"] == 2
    assert counts.rejected == 3 * MAX_FIELDS + 1


FEEDBACK = Feedback(
    latitude_rad=1e-4, longitude_rad=2e-4, north_rad=0.02, covariance=[9.0, 0, 0, 9.0, 0, 1e-6]
)


def correction(step: int, **more: object) -> Correction:
    fields = {"state": "applied", "valid_t_ns": NOW_NS, "feedback": FEEDBACK} | more
    return Correction(
        centre="fusion", seq=step, step=step, t_ns=NOW_NS, carrier="harbour",
        id=f"fusion/harbour/{step}", **fields,
    )  # fmt: skip


def test_a_bridge_that_uses_its_corrections_says_everything_with_the_newest() -> None:
    bench = Bench(Station(pose=POSE, use_corrections=True))
    bench.feed(line(**LOG))
    bench.bridge.hear(correction(7))
    bench.now_ns += SECOND
    bench.feed(line(**LOG))
    before, after = bench.kept.of(Navigation)
    assert (before.correction_id, before.uncorrected) == ("", None)
    assert after.uncorrected == before.pose
    assert after.pose.latitude_rad == pytest.approx(POSE.latitude_rad + 1e-4, abs=1e-12)
    plain, turned = bench.kept.of(SourceReport)
    assert (after.correction_id, turned.correction_id) == ("fusion/harbour/7",) * 2
    assert turned.bearing_rad is not None
    assert plain.bearing_rad is not None
    assert turned.bearing_rad[0] - plain.bearing_rad[0] == pytest.approx(turned.turned_rad)
    bench.bridge.hear(correction(8, state="suspended", feedback=None))
    bench.feed(line(**LOG))
    assert bench.kept.of(SourceReport)[-1].correction_id == ""


def test_records_that_hold_a_correction_pass_unless_the_bridge_applies_them() -> None:
    own = {"latitude_rad": 0.63, "longitude_rad": -0.1}
    name = "fusion/harbour/7"
    said = line(topic="navigation", pose=own, uncorrected=own, correction_id=name)
    turned = line(**LOG, turned_deg=1.5, correction_id=name)
    passing, applying = Bench(), Bench(Station(pose=POSE, use_corrections=True))
    assert passing.feed(said + turned) == []
    assert [r.correction_id for r in passing.kept.of(SourceReport)] == [name]
    assert passing.kept.of(SourceReport)[0].turned_rad == pytest.approx(math.radians(1.5))
    assert applying.feed(said + turned) == ["correction_id", "correction_id"]


def test_a_covariance_that_cannot_be_turned_costs_its_record_alone() -> None:
    bench = Bench(Station(pose=POSE, use_corrections=True))
    bench.bridge.hear(correction(7, feedback=replace(FEEDBACK, north_rad=0.7)))
    needles = [[k * 1e12, 0.0, 1e-30] for k in range(1, 21)]  # rounding decides, twenty times
    bad = line(east_m=[1.0] * 20, north_m=[2.0] * 20, covariance_position=needles)
    assert bench.feed(line(**LOG) + bad + line(**LOG)) == ["covariance"]
    assert [report.seq for report in bench.kept.of(SourceReport)] == [1, 2]


def test_sums_agree_though_records_are_refused_meanwhile() -> None:
    class Busy(Counter[str]):
        def copy(self) -> Counter[str]:
            before = Counter(self)
            self["line"] += 1
            return before

    counts = Counts()
    counts.rejected_by = Busy(line=3, range_m=2)
    told = counts.counters()
    assert told["received"] == told["rejected"] == told["rejected line"] + told["rejected range_m"]
