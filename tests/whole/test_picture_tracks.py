"""A whole run with radars that track by themselves: what they send is fused, each thing once."""

from __future__ import annotations

from typing import Any

import pytest
from scipy.stats import chi2

import carriers.reports
from bench.in_process import played
from bench.registration.tracking_sources import frames, tracking
from crossfix.evaluation import PictureSummary, summarise_picture
from tests.whole.test_picture import judged

STEPS, FRAME_STEPS = 60, 40


def summary(report: str) -> PictureSummary:
    scenario = tracking(report, 1)
    found = summarise_picture(judged(scenario, played(scenario, steps=STEPS)))
    assert found is not None
    return found


@pytest.mark.parametrize("report", [pytest.param("increment", marks=pytest.mark.slow), "track"])
def test_increments_and_filters_are_as_good_as_plots(report: str) -> None:
    found = summary(report)
    assert found.missed + found.false < 0.3
    assert found.error_m < 40  # the own radar alone; one of its plots has 50 m
    assert 0.4 < found.nees_per_dimension < 1.3  # as of plots


def test_frames_from_increments_are_those_from_plots() -> None:
    """The increments of a track are its plots; only the first looks are weighed otherwise."""
    by_plots, by_increments = (frames(tracking(k, 1), FRAME_STEPS) for k in ("", "increment"))
    assert by_plots.keys() == by_increments.keys() == {"poniente", "siroco"}
    for name, one in by_plots.items():
        other = by_increments[name]
        assert other.sigma_m == pytest.approx(one.sigma_m, rel=0.05)
        assert one.applied
        assert other.applied
        assert abs(other.error_m - one.error_m) < 0.5 * one.sigma_m
        assert other.nees < chi2.ppf(0.999, 3)


def test_tracks_without_a_filter_are_never_believed_too_much(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def bare(_: Any, tracks: Any) -> dict[str, Any]:
        return {"kind": ["track"] * len(tracks.number)}

    monkeypatch.setattr(carriers.reports, "_learnt", bare)
    found = summary("track")
    assert found.missed + found.false < 0.3
    assert found.error_m < 60
    assert found.nees_per_dimension < 1.1
