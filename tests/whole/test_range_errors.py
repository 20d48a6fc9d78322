"""Radars whose ranges err by what they declare: found, told, and out of the picture."""

from __future__ import annotations

from typing import Any

import pytest

from bench.in_process import played
from crossfix.evaluation.pictures import picture_errors, summarise_picture
from schemas.messages import Navigation, Tracks
from sim_world.scenario import Scenario, parse_scenario
from sim_world.scenario.toml_text import toml_text

ADDED = {"own": (90.0, -3e-3), "other": (-70.0, 4e-3)}
STEPS = 30


def carrier(name: str, east_m: float) -> dict[str, Any]:
    bias_m, scale = ADDED[name]
    return {
        "name": name,
        "motion": {"kind": "constant_velocity", "east_m": east_m, "north_m": 0.0},
        "navigation": {"sigma_position_m": 200.0, "sigma_north_deg": 0.5},
        "sensors": [
            {
                "name": "radar",
                "sigma_range_m": 20.0,
                "sigma_bearing_deg": 0.15,
                "detection_probability": 0.95,
                "sigma_range_bias_m": 80.0,
                "sigma_range_scale": 3e-3,
                "errors": {"range_bias_m": bias_m, "range_scale": scale},
            }
        ],
    }


def scene() -> Scenario:
    tree = {
        "name": "added",
        "seed": 3,
        "time": {"duration_s": STEPS},
        "origin": {"latitude_deg": -33.0, "longitude_deg": 18.0},
        "carriers": [carrier("own", 0.0), carrier("other", 9_000.0)],
        "target_groups": [
            {"name": "g", "count": 14, "box_m": [-12e3, 18e3, -14e3, 14e3], "speed_mps": [2, 10]}
        ],
    }
    return parse_scenario(toml_text(tree))


def test_range_errors_are_found_and_taken_out_of_the_picture() -> None:
    """The picture within what it claims, 15 m, of places that are reported 100 m off. Terms within
    3.3 sigmas, one in 1000 each.
    """
    known: list[Any] = []
    for now in played(scene()):
        own = [m for m in now.said if isinstance(m, Navigation) and m.carrier == "own"]
        drawn = [out.message for out in now.outputs if isinstance(out.message, Tracks)]
        known += [now.targets, now.carriers, *own, *drawn]
    assert now.carriers.range_bias_m == pytest.approx([b for b, _ in ADDED.values()])
    assert now.carriers.range_scale == pytest.approx([s for _, s in ADDED.values()])
    terms = {term.name: term for term in now.corrections["other"].terms}
    for name, true in zip(("range_bias_m", "range_scale"), ADDED["other"], strict=True):
        assert abs(terms[name].value - true) < 3.3 * terms[name].sigma
    assert terms["range_bias_m"].sigma < 40.0
    picture = summarise_picture(picture_errors(scene().declared, "own", known))
    assert picture is not None
    assert 0.3 < picture.nees_per_dimension < 1.7
    assert picture.error_m < 25.0
