"""Claimed sigmas against scatter: right claims pass, wrong ones are told, and how sure it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from schemas.conformance.residuals import LEAST_RESIDUALS, Residuals, SigmaCheck
from schemas.messages import SourceProperties, SourceReport

DECLARED = SourceProperties(period_s=1.0, sigma_range_m=30.0, sigma_bearing_rad=0.005)
TARGETS = 8


def reports(
    dice: np.random.Generator,
    scans: int,
    noise: float = 1.0,
    acceleration_mps2: float = 0.0,
    outliers: float = 0.0,
) -> Iterator[SourceReport]:
    """Ships on straight or curved courses, seen with `noise` times the declared sigmas."""
    start = dice.uniform(-12_000, 12_000, (TARGETS, 2))
    velocity, turn = dice.normal(0, 8, (TARGETS, 2)), dice.normal(0, 1, (TARGETS, 2))
    for k in range(scans):
        place = start + velocity * k + turn * acceleration_mps2 * k**2 / 2
        place = place + (dice.random((TARGETS, 1)) < outliers) * 5000.0
        slant = np.hypot(*place.T) + noise * dice.normal(0, 30.0, TARGETS)
        bearing = np.arctan2(*place.T) + noise * dice.normal(0, 0.005, TARGETS)
        yield SourceReport(
            carrier="a", boot="b", stream="radar", seq=k + 1, t_ns=(k + 100) * 10**9,
            bearing_rad=bearing.tolist(), range_m=np.abs(slant).tolist(),
            track_id=[f"t{i}" for i in range(TARGETS)],
        )  # fmt: skip


def checked(*arguments: object, **how: float) -> list[SigmaCheck]:
    residuals = Residuals()
    for report in reports(*arguments, **how):  # type: ignore[arg-type]
        residuals.take(report)
    return residuals.checks(DECLARED)


def test_right_claims_raise_no_alarm_in_a_hundred_runs() -> None:
    """The interval is of 99.994 %, and the limits lie beyond it: none of 200 checks should fire."""
    dice = np.random.default_rng(5)
    found = [check for _ in range(100) for check in checked(dice, 24)]
    assert [check.verdict for check in found] == ["consistent"] * 200
    ratios = np.array([check.ratio for check in found])
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.04)  # 200 of sigma 0.15: 0.011
    inside = np.mean([check.low < 1 < check.high for check in found])
    assert inside >= 0.995


def test_the_interval_holds_what_it_says() -> None:
    """The stated spread of the ratio is that of the ratio."""
    dice = np.random.default_rng(6)
    found = [check for _ in range(150) for check in checked(dice, 30)]
    logs = np.log([check.ratio for check in found])
    stated = np.log(found[0].high / found[0].ratio) / 4.0
    assert np.std(logs) == pytest.approx(stated, rel=0.15)


@pytest.mark.parametrize(("noise", "verdict"), [(3.0, "too small"), (0.2, "too large")])
def test_wrong_claims_are_told(noise: float, verdict: str) -> None:
    for check in checked(np.random.default_rng(7), 100, noise):
        assert check.verdict == verdict
        assert check.low < noise < check.high


def test_a_little_more_scatter_than_claimed_is_let_pass() -> None:
    for check in checked(np.random.default_rng(8), 300, 1.15):
        assert check.verdict == "consistent"


def test_few_plots_say_nothing() -> None:
    for check in checked(np.random.default_rng(9), 10, 5.0):
        assert check.number < LEAST_RESIDUALS
        assert check.verdict == "too few to say"


def test_manoeuvres_and_wild_plots_do_not_decide() -> None:
    wild = checked(np.random.default_rng(10), 100, 1.0, outliers=0.05)
    turning = checked(np.random.default_rng(11), 100, 1.0, acceleration_mps2=3.0)
    assert {check.verdict for check in (*wild, *turning)} == {"consistent"}


def test_tracks_scatter_less_than_they_are_wrong_and_are_not_blamed_for_it() -> None:
    residuals = Residuals()
    for report in reports(np.random.default_rng(12), 100, 0.1):
        residuals.take(report)
    tracks = SourceProperties(sends_tracks=True, sigma_range_m=30.0, sigma_bearing_rad=0.005)
    assert residuals.checks(tracks) == []
    assert [check.verdict for check in residuals.checks(DECLARED)] == ["too large"] * 2


def test_cartesian_plots_are_judged_by_their_covariance() -> None:
    dice, residuals = np.random.default_rng(13), Residuals()
    for k in range(200):
        east, north = 1000.0 + 5 * k + dice.normal(0, 30), 2000.0 + dice.normal(0, 30)
        residuals.take(
            SourceReport(
                carrier="a",
                boot="b",
                stream="lidar",
                seq=k + 1,
                t_ns=(k + 1) * 10**9,
                east_m=[east],
                north_m=[north],
                covariance_position=[[100.0, 0.0, 100.0]],
                identity=["x"],
            )
        )
    (check,) = residuals.checks(SourceProperties(coordinates="cartesian"))
    assert (check.column, check.verdict) == ("sigma_position_m", "too small")
