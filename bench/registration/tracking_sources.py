"""Frames of carriers whose radars track by themselves, on the strait: plots, increments, tracks.

Increments and filters say what plots said, so the frames must come out alike; of tracks alone a
correction must not claim more than is right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.figures import Figure, at_most, told
from bench.in_process import played
from crossfix.evaluation import frame_errors
from sim_world.scenario import Scenario, parse_scenario, with_overrides

STRAIT = Path(__file__).parents[2] / "scenarios" / "strait.toml"
SENSOR = "[[carriers.sensors]]\n"
STEPS = 120


class Frame(NamedTuple):
    """The last correction of a carrier: how wrong, how sure [m], NEES of 3 dof; was it applied."""

    error_m: float
    sigma_m: float
    nees: float
    applied: bool


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Errors, sigma and NEES of what each kind of report gives."""
    seeds = range(seed, seed + max(runs // 4000, 2))
    errors: dict[str, float] = {}
    for name, report in (("plots", ""), ("increments", "increment"), ("filters", "track")):
        found = [frame for s in seeds for frame in frames(tracking(report, s), STEPS).values()]
        errors[name] = float(np.sqrt(np.mean([f.error_m**2 for f in found])))
        of = f"strait, radars that send {name}"
        yield told(f"{of}: frames", len(found))
        yield told(f"{of}: error", errors[name], "m")
        yield told(f"{of}: sigma", float(np.mean([f.sigma_m for f in found])), "m")
        yield told(f"{of}: NEES / dim", float(np.mean([f.nees for f in found])) / 3)
        yield told(f"{of}: applied", float(np.mean([f.applied for f in found])))
    for name in ("increments", "filters"):
        yield at_most(f"error by {name} / error by plots", errors[name] / errors["plots"], 1.05)


def frames(scenario: Scenario, steps: int) -> dict[str, Frame]:
    """The last frame of every other carrier."""
    said: list[Any] = []
    for step in played(scenario, steps=steps):
        said += [step.carriers, *step.corrections.values()]
    errors = frame_errors(scenario.declared, scenario.declared.carriers[0].name, said)
    return {
        name: Frame(math.hypot(*e.after_m), e.sigma_m, e.nees, e.state == "applied")
        for name, e in ((name, found[-1]) for name, found in errors.items())
    }


def tracking(report: str, seed: int) -> Scenario:
    """The strait with radars that track and send `report`; with plain radars if that is empty."""
    key = f'tracking = {{ process_noise = 0.1, report = "{report}" }}\n' if report else ""
    text = STRAIT.read_text(encoding="utf-8")
    scenario = parse_scenario(text.replace(SENSOR, SENSOR + key), STRAIT.name)
    return with_overrides(scenario, {"seed": seed})
