"""The states of a correction, report event by report event."""

from __future__ import annotations

from typing import Literal

import pytest

from fusion_center.relative_frames.monitor import after_registration
from fusion_center.settings import MonitorSettings
from fusion_center.state import Estimate, Monitor
from schemas.messages import Direction, FixedAxes, OwnAxes, Pose

SETTINGS = MonitorSettings(apply_after=3, leave_after=3, suspend_after=2, chi2_false_alarm=1e-3)
POSE = Pose(latitude_rad=0.7, longitude_rad=0.5)
Kind = Literal["good", "weak", "excessive", "none"]
LIMIT = 31.264  # chi2 of 11 dof that 0.1 % pass, from a table


def estimate(kind: Kind) -> Estimate | None:
    if kind == "none":
        return None
    weak = kind == "weak"
    worst = Direction(
        name="orientation", ratio=0.7 if weak else 0.4, status="weak" if weak else "determined"
    )
    return Estimate(
        valid_t_ns=1,
        own_pose=POSE,
        other_pose=POSE,
        own_axes=OwnAxes(
            east_m=1.0, north_m=2.0, rotation_rad=0.1, covariance=[], reported_east_m=0.0,
            reported_north_m=0.0,
        ),
        fixed_axes=FixedAxes(
            offset_east_m=0.0, offset_north_m=0.0, c1_rad=0.0, c2_rad=0.0, covariance=[]
        ),
        directions=(worst,),
        pairs=5,
        chi2=LIMIT + 0.01 if kind == "excessive" else LIMIT - 0.01,
        dof=11,
    )  # fmt: skip


def history(*kinds: Kind) -> list[tuple[str, bool]]:
    """(state, adopted) after each event."""
    monitor, states = Monitor(), []
    for kind in kinds:
        monitor, adopted = after_registration(monitor, estimate(kind), SETTINGS)
        states.append((monitor.state, adopted))
    return states


def states(*kinds: Kind) -> list[str]:
    return [state for state, _ in history(*kinds)]


def test_applied_after_good_ones_in_a_row() -> None:
    assert states("none", "weak", "good", "good", "good", "good") == [
        "observing", "observing", "candidate", "candidate", "applied", "applied",
    ]  # fmt: skip


@pytest.mark.parametrize("spoiler", ["weak", "none", "excessive"])
def test_a_bad_one_begins_the_row_anew(spoiler: Kind) -> None:
    assert states("good", "good", spoiler, "good", "good")[-1] == "candidate"
    assert states("good", "good", spoiler, "good", "good", "good")[-1] == "applied"


def test_an_excessive_chi2_keeps_a_candidate_from_being_applied() -> None:
    assert set(states(*["excessive"] * 10)) == {"candidate"}


@pytest.mark.parametrize(
    ("bad", "stays", "then"), [("weak", 2, "observing"), ("none", 2, "observing"),
                               ("excessive", 1, "suspended")]
)  # fmt: skip
def test_applied_is_left_with_hysteresis(bad: Kind, stays: int, then: str) -> None:
    after = history("good", "good", "good", *[bad] * (stays + 1))[3:]
    assert after == [("applied", False)] * stays + [(then, True)]


def test_one_good_one_ends_the_doubt() -> None:
    doubt: list[Kind] = ["good", "good", "good", "weak", "weak", "good", "weak", "weak", "good"]
    assert set(states(*doubt)[2:]) == {"applied"}


def test_kinds_of_doubt_add_up_separately_but_none_is_forgotten() -> None:
    row: list[Kind] = ["good", "good", "good", "excessive", "weak", "excessive"]
    assert states(*row)[-2:] == ["applied", "suspended"]


def test_what_is_applied_is_always_determined_and_believable() -> None:
    """Whatever the history: an estimate adopted as applied was itself good."""
    for number in range(4**6):
        kinds: list[Kind] = [("good", "weak", "excessive", "none")[number // 4**i % 4]
                             for i in range(6)]  # fmt: skip
        for kind, (state, adopted) in zip(kinds, history(*kinds), strict=True):
            assert not (state == "applied" and adopted and kind != "good")


def test_what_is_applied_stays_so_when_more_is_asked_of_newcomers() -> None:
    monitor, _ = after_registration(Monitor(state="applied", good=3), estimate("good"), SETTINGS)
    stricter = MonitorSettings(apply_after=100)
    assert after_registration(monitor, estimate("good"), stricter)[0].state == "applied"
    assert after_registration(Monitor(), estimate("good"), stricter)[0].state == "candidate"


def test_suspended_leads_back_through_candidate() -> None:
    row: list[Kind] = ["good"] * 3 + ["excessive"] * 3 + ["good"] * 3
    assert states(*row)[4:] == ["suspended", "suspended", "candidate", "candidate", "applied"]


def test_reasons_are_sentences_with_the_figures() -> None:
    weak, _ = after_registration(Monitor(), estimate("weak"), SETTINGS)
    assert weak.reason == "orientation is weak: 0.7 of the prior sigma"
    excessive, _ = after_registration(Monitor(), estimate("excessive"), SETTINGS)
    assert excessive.reason == "chi2 31.27 of 11 degrees of freedom is above 31.26"
    nothing, _ = after_registration(Monitor(), None, SETTINGS)
    assert nothing.reason == "no pair of logs"
