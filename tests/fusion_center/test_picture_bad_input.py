"""Sources that are not what they say: they are told in `quality`, and the picture goes on."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace

from fusion_center import pipeline
from fusion_center.picture.watch import Look, false_plots, watched
from fusion_center.state import State, Watched, pack
from schemas.messages import Input, SourceReport, Tracks
from tests.fusion_center.scenes import closed, of_radar, two_ships

STEPS, TARGETS = 40, 8
Alter = Callable[[SourceReport, np.random.Generator], SourceReport]


@cache
def run(alter: Alter, steps: int = STEPS) -> tuple[State, list[pipeline.Outputs]]:
    """Two ships of which the own one's reports are altered."""
    scene, rng = two_ships(TARGETS), np.random.default_rng(1)
    state, outputs = scene.initial(), []
    for step in range(1, steps + 1):
        messages = [_altered(message, alter, rng) for message in scene.said(step, rng)]
        state, out = pipeline.step(state, closed(step, messages), messages)
        outputs.append(out)
    return state, outputs


def _altered(message: Input, alter: Alter, rng: np.random.Generator) -> Input:
    is_own = isinstance(message, SourceReport) and message.carrier == "a"
    return alter(message, rng) if is_own and isinstance(message, SourceReport) else message


def shown(outputs: pipeline.Outputs) -> Tracks:
    return next(out.message for out in outputs if isinstance(out.message, Tracks))


def scaled(factor: float) -> Alter:
    """Sigmas claimed so many times too large."""

    def alter(report: SourceReport, _: np.random.Generator) -> SourceReport:
        columns = {
            name: [factor * (sigma or 0.0) for sigma in getattr(report, name) or []]
            for name in ("sigma_bearing_rad", "sigma_range_m")
        }
        return replace(report, **columns)

    return alter


def flooded(report: SourceReport, rng: np.random.Generator) -> SourceReport:
    """Thirty plots of nothing, nameless, beside the true ones."""
    bearing, slant = report.bearing_rad or [], report.range_m or []
    sigma_bearing, sigma_range = report.sigma_bearing_rad or [], report.sigma_range_m or []
    n = 30
    return replace(
        report,
        bearing_rad=[*bearing, *rng.uniform(-3, 3, n).tolist()],
        range_m=[*slant, *rng.uniform(2e3, 4e4, n).tolist()],
        sigma_bearing_rad=[*sigma_bearing, *sigma_bearing[:1] * n],
        sigma_range_m=[*sigma_range, *sigma_range[:1] * n],
        identity=[*(report.identity or []), *[None] * n],
        identity_kind=None,
        track_id=None,
        kind=None,
    )


def renamed(report: SourceReport, rng: np.random.Generator) -> SourceReport:
    """Every report hands out the names, and the numbers of the tracks, anew."""
    order = rng.permutation(len(report)).tolist()
    names, numbers = report.identity or [], report.track_id or []
    return replace(
        report,
        identity=[names[i] for i in order] if names else None,
        track_id=[numbers[i] for i in order] if numbers else None,
    )


def jumping(report: SourceReport, rng: np.random.Generator) -> SourceReport:
    """Time stamps within a report that jump by minutes."""
    jumps = rng.choice([-120.0, 0.0, 0.4, 120.0], len(report)).tolist()
    return replace(report, time_offset_s=jumps)


def doubled(report: SourceReport, _: np.random.Generator) -> SourceReport:
    """From step 20 on the name of one target is told of another, and its number too."""
    if report.step < 20 or not report.identity or not report.track_id:
        return report
    return replace(
        report,
        identity=[None, report.identity[0], *report.identity[2:]],
        track_id=[None, report.track_id[0], *report.track_id[2:]],
    )


def recycling(report: SourceReport, _: np.random.Generator) -> SourceReport:
    """Numbers, and no names; at step 20 they are handed out anew."""
    numbers = report.track_id or []
    by = 1 if report.step >= 20 else 0
    return replace(report, identity=None, track_id=[*numbers[by:], *numbers[:by]])


def disordered(report: SourceReport, rng: np.random.Generator) -> SourceReport:
    """Every stamp is up to 2.5 s before what it should be, the logs in it right all the same."""
    back_s = float(rng.uniform(0.0, 2.5))
    return replace(
        report,
        t_ns=report.t_ns - round(back_s * 1e9),
        time_offset_s=[back_s] * len(report),
    )


def flags(outputs: list[pipeline.Outputs]) -> str:
    return of_radar(outputs[-1], "a").flag


def test_an_honest_source_is_not_flagged() -> None:
    _, outputs = run(scaled(1.0))
    rows = [of_radar(out, "a") for out in outputs[10:]]
    assert not any(row.flag for row in rows)
    dof = sum(row.track_nis_dof for row in rows)
    assert dof > 400
    mean = sum(row.track_nis * row.track_nis_dof for row in rows) / dof
    # two degrees a plot: one sigma of the mean is sqrt(2 / dof) = 0.07; targets that stand still
    # are foretold a little better than the motion allowed for says
    assert 0.6 < mean < 1.2


@pytest.mark.parametrize(
    ("factor", "said"), [(1 / 3, "farther"), (10.0, "nearer"), (1 / 20, "than")]
)
def test_a_sigma_that_is_far_off_is_flagged(factor: float, said: str) -> None:
    _, outputs = run(scaled(factor))
    assert said in flags(outputs)


def test_a_flood_of_false_plots_is_flagged_and_survived() -> None:
    _, outputs = run(flooded)
    assert "far more false plots" in flags(outputs)
    assert of_radar(outputs[-1], "a").lone > 20
    assert of_radar(outputs[-1], "b").flag == ""


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        (Look(taken=8, lone=2, nis=16.0, dof=16), 0.9),  # few enough
        (Look(taken=8, lone=30, nis=16.0, dof=16), 30.0),  # a flood
        (Look(taken=1, lone=30, nis=12.0, dof=2), 0.9),  # sigmas so small that plots miss
    ],
)
def test_a_flood_is_expected_once_it_has_shown(seen: Look, expected: float) -> None:
    """Counts begin after ten reports and fade over fifty: within a tenth after two hundred."""
    now = Watched()
    assert false_plots(now, 0.9) == 0.9
    for _ in range(200):
        now = watched(now, seen)
    assert false_plots(now, 0.9) == pytest.approx(expected, rel=0.1)


@pytest.mark.slow
def test_a_flood_begins_no_more_tracks_once_it_is_expected() -> None:
    """Thirty a report in a circle of 40 km; as declared it would be one more in fifteen steps."""
    _, outputs = run(flooded, 120)
    later = [len(shown(out).tracks) for out in outputs[30:]]
    assert max(later) == min(later)


def every_flag(outputs: list[pipeline.Outputs], carrier: str = "a") -> str:
    """All that was ever said of a carrier's radar."""
    return " ".join(of_radar(out, carrier).flag for out in outputs)


def test_names_that_wander_from_target_to_target_are_told_and_no_longer_used() -> None:
    _, outputs = run(renamed)
    assert "names are told of two targets, or of one that is elsewhere" in flags(outputs)
    assert "its names are not used" in flags(outputs)
    assert shown(outputs[-1]).objects < 2 * TARGETS
    error = np.array([t.position_m for t in shown(outputs[-1]).tracks])
    assert len(error) == pytest.approx(TARGETS, abs=2)


def test_one_name_of_two_targets_is_told_and_both_are_shown() -> None:
    _, outputs = run(doubled)
    assert "names are told of two targets" not in every_flag(outputs[:19])
    assert "names are told of two targets" in flags(outputs)
    assert "not used" not in flags(outputs)  # the others of its names are right
    assert len(shown(outputs[-1]).tracks) == TARGETS


def test_recycled_track_numbers_are_told() -> None:
    _, outputs = run(recycling)
    assert "stands for another target now" not in every_flag(outputs[:19])
    assert "stands for another target now" in every_flag(outputs[19:22])
    assert len(shown(outputs[-1]).tracks) == TARGETS


def test_stamps_that_jump_within_the_window_are_told() -> None:
    _, outputs = run(disordered)
    assert "stamps jump" in every_flag(outputs)
    assert "stamps jump" not in every_flag(outputs, "b")
    assert len(shown(outputs[-1]).tracks) == TARGETS


def test_logs_measured_minutes_from_their_report_are_told() -> None:
    _, outputs = run(jumping)
    assert "long before or after their report" in every_flag(outputs)


@pytest.mark.parametrize(
    "alter",
    [renamed, doubled, recycling, disordered, jumping, flooded, scaled(1e-9), scaled(1e9)],
    ids=lambda a: a.__name__,
)
def test_whatever_comes_the_picture_goes_on_and_stays_small(alter: Alter) -> None:
    half, _ = run(alter, STEPS // 2)
    state, outputs = run(alter)
    for out in outputs:
        for track in shown(out).tracks:
            assert np.isfinite([*track.position_m, *track.velocity_mps, *track.covariance]).all()
    assert len(pack(state)) < 2 * len(pack(half)) + 100_000
    assert shown(outputs[-1]).objects < 20 * TARGETS


def test_objects_are_counted_with_their_sigma() -> None:
    _, outputs = run(scaled(1.0))
    found = shown(outputs[-1])
    assert found.objects == pytest.approx(TARGETS, abs=max(3 * found.sigma_objects, 0.5))
    assert 0 < found.sigma_objects < 3
    assert shown(outputs[0]).sigma_objects > found.sigma_objects


def test_a_scan_that_cannot_be_computed_is_left_out_and_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def singular(*_: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr("fusion_center.picture.fusing.tracker.step", singular)
    state, outputs = run(lambda report, rng: report, steps=2)
    assert not shown(outputs[-1]).tracks
    assert "not in the picture" in of_radar(outputs[-1], "a").flag
    assert state.carriers["a"].logs
