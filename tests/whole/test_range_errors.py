"""Radars whose ranges err by what they declare: found, told, and out of the picture."""

from __future__ import annotations

from typing import Any

import pytest

from bench.in_process import played
from crossfix.evaluation.pictures import picture_errors, summarise_picture
from schemas.messages import Navigation, Tracks
from sim_world.scenario import Scenario
from tests.whole.two_radars import two_radars

ADDED = {"own": (90.0, -3e-3), "other": (-70.0, 4e-3)}
STEPS = 30


def radar(bias_m: float, scale: float) -> dict[str, Any]:
    return {
        "sigma_range_m": 20.0,
        "sigma_bearing_deg": 0.15,
        "sigma_range_bias_m": 80.0,
        "sigma_range_scale": 3e-3,
        "errors": {"range_bias_m": bias_m, "range_scale": scale},
    }


def scene() -> Scenario:
    targets = {"count": 14, "box_m": [-12e3, 18e3, -14e3, 14e3]}
    radars = {name: radar(*added) for name, added in ADDED.items()}
    return two_radars(STEPS, radars, targets, sigma_north_deg=0.5)


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
