"""A whole run with radars that track by themselves: what they send is fused, and not too often."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import carriers.reports
from bench.in_process import played
from crossfix.tracking_errors import PictureSummary, summarise_picture
from sim_world.scenario import Scenario, parse_scenario
from tests.whole.test_picture import judged

STRAIT = Path(__file__).parents[2] / "scenarios" / "strait.toml"
SENSOR = "[[carriers.sensors]]\n"
STEPS = 60


def tracking(report: str) -> Scenario:
    """The strait with radars that track."""
    key = f'tracking = {{ process_noise = 0.1, report = "{report}" }}\n'
    text = STRAIT.read_text(encoding="utf-8")
    return parse_scenario(text.replace(SENSOR, SENSOR + key), STRAIT.name)


def summary(report: str) -> PictureSummary:
    scenario = tracking(report)
    found = summarise_picture(judged(scenario, played(scenario, steps=STEPS)))
    assert found is not None
    return found


@pytest.mark.parametrize("report", ["increment", "track"])
def test_increments_and_filters_are_as_good_as_plots(report: str) -> None:
    found = summary(report)
    assert found.missed + found.false < 0.3
    assert found.error_m < 40  # the own radar alone; one of its plots has 50 m
    assert 0.4 < found.nees / 2 < 1.3  # as of plots


def test_tracks_without_a_filter_are_never_believed_too_much(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def bare(_: Any, tracks: Any) -> dict[str, Any]:
        return {"kind": ["track"] * len(tracks.number)}

    monkeypatch.setattr(carriers.reports, "_learnt", bare)
    found = summary("track")
    assert found.missed + found.false < 0.3
    assert found.error_m < 60
    assert found.nees / 2 < 1.1
