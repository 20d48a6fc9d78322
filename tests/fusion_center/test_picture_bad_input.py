"""Sources that are not what they say: they are told in `quality`, and the picture goes on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace

from fusion_center import pipeline
from fusion_center.state import State, pack
from schemas.messages import Input, SourceReport, Tracks
from tests.fusion_center.scenes import closed, of_radar, two_ships

STEPS, TARGETS = 40, 8
Alter = Callable[[SourceReport, np.random.Generator], SourceReport]


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
    "alter", [renamed, jumping, flooded, scaled(1e-9), scaled(1e9)], ids=lambda a: a.__name__
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
