"""Clocks that drift: the group for half an hour, whole runs in process, with and without drift.

Three carriers of scenario `group`, whose clocks gain 20 ppm (one sigma), and targets that come from
every side in turn, so that two or more are always in sight.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from bench.figures import Figure, between, told
from bench.in_process import played
from bench.navigation.live import SCENARIOS, Errors, errors
from estimation.consistency import mean_interval, rms
from estimation.frames import rotation_clockwise
from sim_world.scenario import Scenario, load_scenario, with_overrides

DURATION_S, STEP_S, SIGMA_PPM = 1800.0, 2.5, 20.0
LOOKED_AT_S = (600.0, 1200.0, 1800.0)
CARRIERS = ("one", "two", "three")
TARGETS, EVERY_S, LIFE_S, FAR_S = 24, 75.0, 360.0, 180.0
"""Each lives so long, half of it on its way in; the next comes so much later."""
ERRORS = 10
"""Of three places, two headings and two clocks, each against the own ones."""


def scenario(seed: int, sigma_ppm: float) -> Scenario:
    """Half an hour of three carriers whose clocks drift."""
    changes: dict[str, Any] = {
        "seed": seed,
        "time.duration_s": DURATION_S,
        "time.step_s": STEP_S,
        "targets": [_target(number) for number in range(TARGETS)],
    }
    for name in CARRIERS:
        changes[f"carriers.{name}.navigation.sigma_clock_drift_ppm"] = sigma_ppm
    return with_overrides(load_scenario(SCENARIOS / "group.toml"), changes)


def _target(number: int) -> dict[str, Any]:
    """One that passes the middle at some distance, three minutes after it has come."""
    course_deg, speed_mps = 137.5 * number % 360, 120.0 + 20 * (number % 6)
    start_s = max(EVERY_S * number - FAR_S, 0.0)
    aside_m, before_s = 3000.0 * (number % 5 - 2), start_s + FAR_S
    along = rotation_clockwise(np.radians(course_deg))
    east_m, north_m = along @ np.array([aside_m, -speed_mps * before_s])
    return {
        "name": f"t{number}",
        "identity": f"t{number}",
        "start_s": start_s,
        "end_s": start_s + LIFE_S,
        "motion": {
            "kind": "constant_velocity",
            "east_m": float(east_m),
            "north_m": float(north_m),
            "course_deg": course_deg,
            "speed_mps": speed_mps,
        },
    }


def looks(seed: int, sigma_ppm: float) -> list[Errors]:
    """Errors at the instants looked at."""
    steps = {round(at_s / STEP_S) for at_s in LOOKED_AT_S}
    run = played(scenario(seed, sigma_ppm))
    return [errors(step) for step in run if step.closed.step in steps]


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """How honest the joint state is as the clocks part."""
    count = max(runs // 25, 1)
    every = [looks(seed + i, SIGMA_PPM) for i in range(count)]
    low, high = mean_interval(ERRORS, count, 0.99)
    for at_s, found in zip(LOOKED_AT_S, zip(*every, strict=True), strict=True):
        name = f"clocks of 20 ppm, {at_s:.0f} s"
        honest = float(np.mean([e.nees for e in found]))
        yield between(f"{name}: NEES by dimension", honest, low, high)
        yield told(f"{name}: clock", float(rms([e.clock_s for e in found])), "s")
        claimed = rms([np.sqrt(np.diag(e.covariance)[-2:]) for e in found])
        yield told(f"{name}: clock, as claimed", float(claimed), "s")
        apart = float(rms([e.relative_m for e in found]))
        yield told(f"{name}: relative position, per axis", apart, "m")
