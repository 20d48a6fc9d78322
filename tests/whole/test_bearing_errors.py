"""What a sensor adds to all its bearings turns its carrier's frame, and is judged as part of it."""

from __future__ import annotations

from math import radians
from typing import Any

import pytest

from bench.in_process import played
from crossfix.evaluation import frame_errors
from sim_world.scenario import Scenario
from tests.whole.two_radars import two_radars

ADDED_DEG = {"own": -0.8, "other": 1.2}
STEPS = 25


def radar(added_deg: float) -> dict[str, Any]:
    return {
        "sigma_range_m": 30.0,
        "sigma_bearing_deg": 0.2,
        "sigma_azimuth_bias_deg": 1.0,
        "errors": {"azimuth_bias_deg": added_deg},
    }


def scene() -> Scenario:
    targets = {"count": 9, "box_m": [-9e3, 15e3, -12e3, 12e3]}
    radars = {name: radar(added) for name, added in ADDED_DEG.items()}
    return two_radars(STEPS, radars, targets, sigma_north_deg=0.05)


def test_a_turn_of_all_bearings_is_found_and_honestly_claimed() -> None:
    """Twenty times what navigation allows north alone; each event of NEES below 1 in 1000."""
    said: list[Any] = []
    for now in played(scene()):
        said += [now.carriers, *now.corrections.values()]
    assert now.carriers.azimuth_bias_rad == pytest.approx([radians(a) for a in ADDED_DEG.values()])
    errors = frame_errors(scene().declared, "own", said)["other"]
    applied = [error for error in errors if error.state == "applied"]
    assert len(applied) > STEPS // 2
    assert all(error.nees < 16.3 for error in applied)
    assert abs(applied[-1].before_rad) > radians(1.5)
    assert abs(applied[-1].after_rad) < radians(0.15)
