"""Radars that err by what they do not declare: named in `quality`, without harm to the others."""

from __future__ import annotations

from typing import Any

import pytest

from bench.in_process import Played, played
from schemas.messages import Quality
from sim_world.scenario import Scenario
from tests.whole.two_radars import two_radars

STEPS = 20
LONG = "ranges read longer"


def radar(**errors: float) -> dict[str, Any]:
    return {"sigma_range_m": 20.0, "sigma_bearing_deg": 0.15, "errors": errors}


def scene(own: dict[str, Any], other: dict[str, Any], sigma_north_deg: float = 0.5) -> Scenario:
    targets = {"count": 14, "box_m": [-12e3, 18e3, -14e3, 14e3]}
    return two_radars(STEPS, {"own": own, "other": other}, targets, sigma_north_deg)


def named(runs: list[Played]) -> dict[str, set[str]]:
    """What was said of each carrier's radar after the first step, when nobody was placed yet."""
    flags: dict[str, set[str]] = {}
    for now in runs[1:]:
        for out in now.outputs:
            if isinstance(out.message, Quality):
                for source in out.message.sources:
                    if source.flag:
                        flags.setdefault(source.carrier, set()).update(source.flag.split("; "))
    return flags


@pytest.mark.parametrize("erring", ["own", "other"])
def test_ranges_twice_their_sigma_too_long_are_named(erring: str) -> None:
    """Two sigmas of one plot, 6 of what an event tells: within a few events, and the right one."""
    radars = {"own": radar(), "other": radar()}
    radars[erring] = radar(range_bias_m=40.0, azimuth_bias_deg=0.5)
    flags = named(list(played(scene(**radars))))
    assert any(flag.startswith(LONG) for flag in flags[erring])


def test_ranges_that_read_too_short_are_named_so() -> None:
    flags = named(list(played(scene(radar(), radar(range_bias_m=-40.0)))))
    assert any(flag.startswith("ranges read shorter") for flag in flags["other"])


def test_nobody_is_named_where_ranges_are_as_declared() -> None:
    """Bearings off by .5 deg are part of the frame, as north is: they harm nobody."""
    runs = list(played(scene(radar(), radar(azimuth_bias_deg=0.5))))
    assert named(runs) == {}
    assert runs[-1].corrections["other"].state == "applied"


def test_what_is_declared_is_no_error() -> None:
    declared = {**radar(range_bias_m=40.0), "sigma_range_bias_m": 50.0}
    assert named(list(played(scene({**radar(), "sigma_range_bias_m": 50.0}, declared)))) == {}
