"""Each broken publisher gets the right diagnosis, and nothing else is found wrong with it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
import pytest

from schemas import codec, keys
from schemas.bus.interface import Sample
from schemas.conformance import CODES, Conformance, ConformanceTests, Finding
from schemas.messages import Step
from tests.schemas.conformance.publishers import (
    BOOT,
    CARRIER,
    RUN,
    SECOND,
    STEPS,
    Break,
    Message,
    Publisher,
    Sent,
    in_reports,
    without,
)


def found(publisher: Publisher) -> list[Finding]:
    conformance = Conformance(RUN)
    for sample, arrived_s in publisher.samples():
        conformance.take(sample, arrived_s)
    return conformance.findings()


def told(findings: Iterable[Finding]) -> set[tuple[str, str]]:
    assert all(f.carrier == CARRIER for f in findings)
    return {(f.code, f.source) for f in findings}


def scaled(column: str, factor: float) -> Break:
    def change(message: Message) -> Message:
        return {**message, column: [factor * value for value in message[column]]}

    return in_reports(change)


def every(nth: int, change: Callable[[Sent], list[Sent]]) -> Break:
    """A fault of every nth report."""
    count = 0

    def broken(sent: Sent) -> list[Sent]:
        nonlocal count
        if sent.kind != "SourceReport":
            return [sent]
        count += 1
        return change(sent) if count % nth == 0 else [sent]

    return broken


def with_fields(**fields: Any) -> Callable[[Sent], list[Sent]]:
    return lambda sent: [sent._replace(message={**sent.message, **fields})]


def shifted(offset_s: float) -> Callable[[Sent], list[Sent]]:
    def change(sent: Sent) -> list[Sent]:
        t_ns = sent.message["t_ns"] + round(offset_s * SECOND)
        return [sent._replace(message={**sent.message, "t_ns": t_ns})]

    return change


def in_info(**properties: Any) -> Break:
    def broken(sent: Sent) -> list[Sent]:
        if sent.kind != "SourceInfo":
            return [sent]
        changed = {**sent.message["properties"], **properties}
        return [sent._replace(message={**sent.message, "properties": changed})]

    return broken


def both(*faults: Break) -> Break:
    def broken(sent: Sent) -> list[Sent]:
        some = [sent]
        for fault in faults:
            some = [after for before in some for after in fault(before)]
        return some

    return broken


def unless_empty(sent: Sent) -> list[Sent]:
    is_empty = sent.kind == "SourceReport" and "range_m" not in sent.message
    return [] if is_empty else [sent]


def rekeyed(old: str, new: str) -> Break:
    return lambda sent: [sent._replace(key=sent.key.replace(old, new))]


def swapped_targets(message: Message) -> Message:
    """Two tracks exchange their numbers in the middle: each leaps across the scene."""
    half = message["t_ns"] % (STEPS * SECOND) > STEPS * SECOND // 2
    names = list(message["track_id"])
    names[0], names[-1] = (names[-1], names[0]) if half else (names[0], names[-1])
    return {**message, "track_id": names}


RADAR, NAVIGATION, INFO = "radar", "navigation", "info"

BROKEN_BEFORE_NUMBERING: dict[str, tuple[Break, set[tuple[str, str]]]] = {
    "bearings in degrees": (scaled("bearing_rad", 180 / math.pi), {("degrees", RADAR)}),
    "ranges in kilometres": (scaled("range_m", 1e-3), {("kilometres", RADAR)}),
    "sigmas a third of the scatter": (
        both(scaled("sigma_range_m", 1 / 3), scaled("sigma_bearing_rad", 1 / 3)),
        {("sigma_too_small", RADAR)},
    ),
    "sigmas five times the scatter": (
        both(scaled("sigma_range_m", 5.0), scaled("sigma_bearing_rad", 5.0)),
        {("sigma_too_large", RADAR)},
    ),
    "bearing sigmas in degrees": (
        scaled("sigma_bearing_rad", 180 / math.pi),
        {("sigma_absurd", RADAR)},
    ),
    "a sigma of nothing": (
        in_reports(lambda m: {**m, "sigma_range_m": [0.0, *m["sigma_range_m"][1:]]}),
        {("sigma_zero", RADAR)},
    ),
    "no SourceInfo": (without("SourceInfo"), {("source_info", RADAR)}),
    "no navigation": (without("Navigation"), {("navigation", NAVIGATION)}),
    "empty reports left out": (unless_empty, {("empty_reports", RADAR)}),
    "twice as often as declared": (in_info(period_s=2.0), {("rate", RADAR)}),
    "from the future": (every(1, shifted(5.0)), {("time_future", RADAR)}),
    "backwards now and then": (every(10, shifted(-3.0)), {("time_backwards", RADAR)}),
    "jitter": (every(2, shifted(0.35)), {("time_jitter", RADAR)}),
    "stamps in milliseconds": (
        lambda sent: [
            sent._replace(message={**sent.message, "t_ns": sent.message["t_ns"] // 10**6})
        ],
        {("time_unit", RADAR), ("time_unit", NAVIGATION)},
    ),
    "ragged columns": (
        in_reports(lambda m: {**m, "range_m": m["range_m"][:-1]}),
        {("ragged", RADAR)},
    ),
    "NaN": (
        in_reports(lambda m: {**m, "range_m": [math.nan, *m["range_m"][1:]]}),
        {("not_finite", RADAR)},
    ),
    "a covariance that is none": (
        in_reports(lambda m: {**m, "covariance_polar": [[1.0, 5.0, 1.0]] * len(m["range_m"])}),
        {("covariance", RADAR)},
    ),
    "text for a number": (
        in_reports(lambda m: {**m, "range_m": [str(r) for r in m["range_m"]]}),
        {("schema", RADAR)},
    ),
    "a field nobody reads": (
        in_reports(lambda m: {**m, "bearing_sigma": m["sigma_bearing_rad"]}),
        {("unknown_field", RADAR)},
    ),
    "a carrier that is not the key's": (
        rekeyed("report/visitor/radar", "report/guest/radar"),
        {("envelope", RADAR)},
    ),
    "a source called as a stream": (
        rekeyed("report/visitor/radar", "report/visitor/navigation"),
        {("name", NAVIGATION)},
    ),
    "an id in capitals": (
        rekeyed("report/visitor/radar", "report/visitor/Radar"),
        {("key", "Radar")},
    ),
    "other coordinates than declared": (in_info(coordinates="geodetic"), {("coordinates", RADAR)}),
    "ranges beyond the declared limit": (in_info(range_max_m=6000.0), {("range_limits", RADAR)}),
    "two logs of one name": (
        in_reports(lambda m: {**m, "track_id": [*m["track_id"][:-1], "t0"]}),
        {("claimed_twice", RADAR)},
    ),
    "a track number used again": (in_reports(swapped_targets), {("track_reused", RADAR)}),
}
BROKEN_AFTER_NUMBERING: dict[str, tuple[Break, set[tuple[str, str]]]] = {
    "messages left out": (every(7, lambda sent: []), {("seq_missing", RADAR)}),
    "messages sent twice": (every(7, lambda sent: [sent, sent]), {("seq_repeated", RADAR)}),
    "one seq for two messages": (
        every(7, lambda sent: [sent, *with_fields(swept=None, step=0, kind=None)(sent)]),
        {("seq_reused", RADAR)},
    ),
    "streams that begin with 5": (
        lambda sent: [sent._replace(message={**sent.message, "seq": sent.message["seq"] + 4})],
        {("seq_start", RADAR), ("seq_start", NAVIGATION), ("seq_start", INFO)},
    ),
}


def test_a_right_publisher_is_clean() -> None:
    assert found(Publisher()) == []


@pytest.mark.parametrize("fault", BROKEN_BEFORE_NUMBERING)
def test_what_is_wrong_with_the_messages_is_told_and_nothing_else(fault: str) -> None:
    broken, expected = BROKEN_BEFORE_NUMBERING[fault]
    findings = found(Publisher(broken=broken))
    if fault == "a carrier that is not the key's":
        findings = [msgspec.structs.replace(f, carrier=CARRIER) for f in findings]
    assert told(findings) == expected, findings


@pytest.mark.parametrize("fault", BROKEN_AFTER_NUMBERING)
def test_what_is_wrong_with_the_numbering_is_told_and_nothing_else(fault: str) -> None:
    broken, expected = BROKEN_AFTER_NUMBERING[fault]
    assert told(found(Publisher(spoiled=broken))) == expected


def test_a_restart_without_a_new_boot_is_told() -> None:
    conformance = Conformance(RUN)
    for publisher in (Publisher(steps=100), Publisher(first=110, steps=50)):
        for sample, arrived_s in publisher.samples():
            conformance.take(sample, arrived_s)
    expected = {("seq_reused", RADAR), ("seq_reused", NAVIGATION), ("seq_reused", INFO)}
    assert told(conformance.findings()) == expected


def test_two_processes_with_one_name_are_told() -> None:
    conformance = Conformance(RUN)
    one, two = Publisher(boot="one"), Publisher(boot="two", seed=2)
    for (a, arrived_s), (b, _) in zip(one.samples(), two.samples(), strict=True):
        conformance.take(a, arrived_s)
        conformance.take(b, arrived_s)
    assert told(conformance.findings()) == {("two_processes", "")}


@pytest.mark.parametrize(
    ("behind_s", "expected"),
    [(86_400.0, {("time_past", RADAR), ("time_past", NAVIGATION)}), (9.0, set())],
)
def test_a_clock_of_yesterday_is_told_and_a_busy_machine_is_not(
    behind_s: float, expected: set[tuple[str, str]]
) -> None:
    conformance = Conformance(RUN)
    for sample, arrived_s in Publisher(broken=shifted(-behind_s)).samples():
        step = Step(boot="b", step=1, t_ns=round(arrived_s * SECOND))
        encoding = codec.encoding_of(Step, "msgpack")
        conformance.take(Sample(keys.STEP.key(RUN), codec.encode(step), encoding), arrived_s)
        conformance.take(sample, arrived_s)
    assert told(conformance.findings()) == expected


def test_a_life_after_another_is_no_fault() -> None:
    conformance = Conformance(RUN)
    for publisher in (Publisher(boot="one", steps=100), Publisher(boot="two", first=110)):
        for sample, arrived_s in publisher.samples():
            conformance.take(sample, arrived_s)
    assert conformance.findings() == []


def test_what_is_whole_only_for_those_who_heard_the_beginning() -> None:
    late = [*Publisher().samples()][100:]
    midway, whole = Conformance(RUN, whole=False), Conformance(RUN, whole=False)
    whole.began(CARRIER, BOOT)
    for sample, arrived_s in late:
        midway.take(sample, arrived_s)
        whole.take(sample, arrived_s)
    assert told(midway.findings()) == {("source_unheard", RADAR)}
    assert ("seq_start", RADAR) in told(whole.findings())


def test_only_the_carrier_asked_for_is_looked_at() -> None:
    conformance = Conformance(RUN, "somebody")
    for sample, arrived_s in Publisher(broken=scaled("bearing_rad", 57.3)).samples():
        conformance.take(sample, arrived_s)
    assert conformance.findings() == []
    assert conformance.heard() == {}


def test_json_is_as_good_as_messagepack() -> None:
    conformance = Conformance(RUN)
    for sample, arrived_s in Publisher().samples():
        message = msgspec.msgpack.decode(sample.payload)
        as_json = json.dumps(message).encode()
        encoding = sample.encoding.replace("msgpack", "json")
        conformance.take(Sample(sample.key, as_json, encoding), arrived_s)
    assert conformance.findings() == []
    unsaid = Conformance(RUN)
    for sample, arrived_s in Publisher(steps=3).samples():
        message = msgspec.msgpack.decode(sample.payload)
        unsaid.take(Sample(sample.key, json.dumps(message).encode(), ""), arrived_s)
    assert {"payload", "encoding"} == {f.code for f in unsaid.findings()}


def test_every_code_has_advice_and_findings_are_sorted_by_weight() -> None:
    fault = both(scaled("sigma_range_m", 5.0), every(10, shifted(-3.0)))
    findings = found(Publisher(broken=fault))
    assert [f.severity for f in findings] == sorted(f.severity for f in findings)
    for finding in findings:
        assert finding.advice == CODES[finding.code].advice
    assert all(len(code.advice) > 20 for code in CODES.values())


class TestRightPublisher(ConformanceTests):
    """The mixin, as a publisher's author uses it."""

    def samples(self) -> Iterable[Sample]:
        return [sample for sample, _ in Publisher().samples()]


def test_the_mixin_fails_with_what_to_do() -> None:
    class Broken(ConformanceTests):
        def samples(self) -> Iterable[Sample]:
            broken = Publisher(broken=scaled("bearing_rad", 180 / math.pi))
            return [sample for sample, _ in broken.samples()]

    with pytest.raises(AssertionError, match=r"degrees of visitor radar.*multiply by pi/180"):
        Broken().test_publisher_conforms()
    allowing = Broken()
    allowing.allowed = ("degrees",)
    allowing.test_publisher_conforms()
