"""A publisher that uses its corrections: right, and wrong in every way that can be seen."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from schemas import codec, keys
from schemas.bus.interface import Sample
from schemas.conformance import Conformance, Finding
from schemas.messages import Correction, Feedback
from tests.schemas.conformance.publishers import (
    CARRIER,
    EPOCH_NS,
    RUN,
    SECOND,
    Break,
    Message,
    Publisher,
    Sent,
)

FEEDBACK = Feedback(
    latitude_rad=1e-4,
    longitude_rad=-2e-4,
    latitude_rad_s=1e-8,
    north_rad=0.02,
    covariance=[25.0, 0.0, 0.0, 36.0, 0.0, 1e-6],
)
FIRST, LAST = 10, 60
"""Steps whose corrections can be applied; before and after they are suspended."""
BEHIND = 2
"""Steps after which a correction is used."""


def correction(step: int) -> Correction:
    usable = FIRST <= step <= LAST
    return Correction(
        centre=keys.FUSION, seq=step, step=step, t_ns=EPOCH_NS + step * SECOND, carrier=CARRIER,
        id=f"fusion/{CARRIER}/{step}", state="applied" if usable else "suspended",
        valid_t_ns=EPOCH_NS + step * SECOND, feedback=FEEDBACK if usable else None,
    )  # fmt: skip


def using(sent: Sent) -> list[Sent]:
    """What a right publisher makes of its message, with the correction of two steps before."""
    step = (sent.message["t_ns"] - EPOCH_NS) // SECOND - BEHIND
    if not FIRST <= step <= LAST or sent.kind == "SourceInfo":
        return [sent]
    said = {**sent.message, "correction_id": f"fusion/{CARRIER}/{step}"}
    if sent.kind == "Navigation":
        own = said["pose"]
        latitude = own["latitude_rad"] + FEEDBACK.latitude_rad + BEHIND * FEEDBACK.latitude_rad_s
        longitude = own["longitude_rad"] + FEEDBACK.longitude_rad
        pose = {**own, "latitude_rad": latitude, "longitude_rad": longitude}
        return [sent._replace(message={**said, "pose": pose, "uncorrected": own})]
    if "bearing_rad" in said:
        said["bearing_rad"] = [b + FEEDBACK.north_rad for b in said["bearing_rad"]]
    return [sent._replace(message={**said, "turned_rad": FEEDBACK.north_rad})]


def but(kind: str, **wrong: object) -> Break:
    """A right publisher, but for some fields of one kind of message; None: left out."""

    def broken(sent: Sent) -> list[Sent]:
        [right] = using(sent)
        if sent.kind != kind or "correction_id" not in right.message:
            return [right]
        changed: Message = {**right.message, **wrong}
        said = {name: value for name, value in changed.items() if value is not None}
        return [right._replace(message=said)]

    return broken


def late(sent: Sent) -> list[Sent]:
    """It goes on with the last correction when there is none to be applied any more."""
    step = (sent.message["t_ns"] - EPOCH_NS) // SECOND - BEHIND
    [right] = using(sent)
    if sent.kind != "SourceReport" or step <= LAST:
        return [right]
    held = {"correction_id": f"fusion/{CARRIER}/{step}", "turned_rad": FEEDBACK.north_rad}
    return [sent._replace(message={**sent.message, **held})]


def found(broken: Break, *, corrections_first: bool = True, from_step: int = 1) -> list[Finding]:
    conformance = Conformance(RUN)
    samples: Iterable[tuple[Sample, float]] = Publisher(broken=broken).samples()
    known = [as_sample(correction(step)) for step in range(from_step, 121)]
    for sample in known if corrections_first else ():
        conformance.take(sample, 0.0)
    for sample, arrived_s in samples:
        conformance.take(sample, arrived_s)
    for sample in () if corrections_first else known:
        conformance.take(sample, 0.0)
    return conformance.findings()


def as_sample(sent: Correction) -> Sample:
    key = keys.CORRECTION.key(RUN, keys.FUSION, CARRIER)
    return Sample(key, codec.encode(sent), codec.encoding_of(Correction))


@pytest.mark.parametrize("corrections_first", [True, False])
def test_who_says_all_of_it_is_clean_in_whatever_order_it_is_heard(
    corrections_first: bool,
) -> None:
    assert found(using, corrections_first=corrections_first) == []


def test_corrections_of_before_we_listened_are_not_missed() -> None:
    assert found(using, from_step=40) == []
    assert found(but("SourceReport", correction_id=f"fusion/{CARRIER}/3"), from_step=40) == []


OTHER_POSE = {"latitude_rad": 0.63, "longitude_rad": -0.096}
WRONG: dict[str, tuple[Break, set[tuple[str, str]]]] = {
    "no pose without it": (
        but("Navigation", uncorrected=None),
        {("correction_hidden", "navigation")},
    ),
    "a pose without it, of nothing": (
        but("Navigation", correction_id=None),
        {("correction_hidden", "navigation")},
    ),
    "turned, by nothing": (
        but("SourceReport", correction_id=None),
        {("correction_hidden", "radar")},
    ),
    "not added": (but("Navigation", pose=OTHER_POSE), {("correction_place", "navigation")}),
    "turned the other way": (but("SourceReport", turned_rad=-0.02), {("correction_turn", "radar")}),
    "turned in degrees": (but("SourceReport", turned_rad=1.146), {("correction_turn", "radar")}),
    "reports as they were": (
        but("SourceReport", correction_id=None, turned_rad=None),
        {("correction_half", "radar")},
    ),
    "another carrier's": (
        but("SourceReport", correction_id="fusion/guest/12"),
        {("correction_name", "radar")},
    ),
    "one of tomorrow": (
        but("SourceReport", correction_id=f"fusion/{CARRIER}/500"),
        {("correction_name", "radar")},
    ),
    "one that is suspended": (late, {("correction_name", "radar")}),
}


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_wrong_with_it_is_told_and_nothing_else(fault: str) -> None:
    broken, expected = WRONG[fault]
    findings = found(broken)
    assert {(f.code, f.source) for f in findings} == expected, findings
