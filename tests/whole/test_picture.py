"""The picture of a whole run: every target once, as wrong as it says, named and classed right."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.in_process import Played, played
from crossfix.evaluation import PictureError, picture_errors, summarise_picture
from fusion_center.state import pack, unpack
from schemas.messages import Navigation, Tracks
from sim_world.scenario import Scenario, load_scenario, with_overrides

STRAIT = load_scenario(Path(__file__).parents[2] / "scenarios" / "strait.toml")
STEPS = 90


def judged(scenario: Scenario, steps: Iterable[Played]) -> list[PictureError]:
    """The errors of every picture of a run."""
    own = scenario.declared.carriers[0].name
    messages: list[Any] = []
    for step in steps:
        messages += [step.targets, step.carriers]
        messages += [m for m in step.said if isinstance(m, Navigation)]
        messages += [out.message for out in step.outputs if isinstance(out.message, Tracks)]
    return picture_errors(scenario.declared, own, messages)


def pictures(steps: Iterable[Played]) -> list[Tracks]:
    return [o.message for step in steps for o in step.outputs if isinstance(o.message, Tracks)]


@pytest.fixture(scope="module")
def strait() -> list[Played]:
    return list(played(STRAIT, steps=STEPS))


def test_every_target_is_shown_once_and_as_wrong_as_it_says(strait: list[Played]) -> None:
    found = summarise_picture(judged(STRAIT, strait))
    assert found is not None
    assert found.missed < 0.2
    assert found.false < 0.2
    assert found.identity_changes == 0
    assert found.error_m < 20  # one plot has 50 m at the middle of the scene
    assert (
        0.4 < found.nees_per_dimension < 1.3
    )  # careful: a ship goes straighter than is allowed for


def test_registered_frames_are_as_good_as_known_ones(strait: list[Played]) -> None:
    known = with_overrides(STRAIT, {"errors.enabled": False})
    best = summarise_picture(judged(known, played(known, steps=STEPS)))
    found = summarise_picture(judged(STRAIT, strait))
    assert best is not None
    assert found is not None
    assert found.gospa_m < 1.05 * best.gospa_m


def test_only_trusted_frames_feed_the_picture(strait: list[Played]) -> None:
    first_applied = {
        name: next(
            (n for n, step in enumerate(strait) if step.corrections[name].state == "applied"), STEPS
        )
        for name in strait[-1].corrections
    }
    assert all(n < STEPS for n in first_applied.values())
    for n, picture in enumerate(pictures(strait)):
        feeding = {carrier for track in picture.tracks for carrier in track.carriers}
        for name, since in first_applied.items():
            assert name not in feeding or n >= since
    last = pictures(strait)[-1]
    assert {"levante", *first_applied} == {c for track in last.tracks for c in track.carriers}


def test_tracks_keep_their_names_and_tell_their_logs(strait: list[Played]) -> None:
    before, last = pictures(strait)[STEPS // 2], pictures(strait)[-1]
    assert {track.id for track in before.tracks} <= {track.id for track in last.tracks}
    for track in last.tracks:
        assert track.logs
        assert {log.partition("/")[0] for log in track.logs} == set(track.carriers)
        assert track.existence > 0.9


def test_classes_are_told_and_mostly_right(strait: list[Played]) -> None:
    """The right one is first; what a target is comes by its matched number."""
    last = strait[-1]
    error = judged(STRAIT, strait)[-1]
    tracks = {track.id: track for track in pictures(strait)[-1].tracks}
    names = dict(zip(last.targets.number, last.targets.classes, strict=True))
    right = [
        max(tracks[track].classes, key=tracks[track].classes.__getitem__) == names[number]
        for number, track in error.pairs
        if names[number]
    ]
    assert np.mean(right) > 0.9


def test_the_picture_survives_packing(strait: list[Played]) -> None:
    state = strait[-1].state
    assert pack(unpack(pack(state))) == pack(state)


def test_no_picture_where_none_is_wanted() -> None:
    off = list(played(STRAIT, {"own": "levante", "picture": {"enabled": False}}, steps=5))
    assert all(not picture.tracks for picture in pictures(off))
