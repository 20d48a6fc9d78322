"""Clocks that drift: scenario `group` for half an hour, as told to the fusion centre and not told.

    python -m bench.navigation.drifting [--seed N] [--runs N] [--json]

Whole runs in process, some 40 s each. The clocks of its three carriers gain 20 ppm (one sigma);
targets come from every side in turn, four or five of them being there at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from bench.figures import Figure, between, options, report, told
from bench.in_process import played
from bench.navigation.live import SCENARIOS, Errors, errors
from estimation.consistency import mean_interval, rms
from estimation.frames import rotation_clockwise
from sim_world.scenario import Scenario, load_scenario, with_overrides

DURATION_S, STEP_S, SIGMA_PPM = 1800.0, 2.5, 20.0
LOOKED_AT_S = (600.0, 1200.0, 1800.0)
CARRIERS = ("one", "two", "three")
TARGETS, EVERY_S, BEFORE_S = 26, 75.0, 180.0
"""One passes the middle every so often, and is there so long before and after it."""
ERRORS = 10
"""Of three places, two headings and two clocks, each against the own ones."""


def scenario(seed: int, *, declared: bool) -> Scenario:
    """Half an hour of three carriers whose clocks drift, whether that is declared or not."""
    drift_ppm = SIGMA_PPM * np.random.default_rng([seed, 50]).standard_normal(len(CARRIERS))
    changes: dict[str, Any] = {
        "seed": seed,
        "time.duration_s": DURATION_S,
        "time.step_s": STEP_S,
        "targets": [_target(number) for number in range(TARGETS)],
    }
    for name, gained in zip(CARRIERS, drift_ppm.tolist(), strict=True):
        changes[f"carriers.{name}.errors.clock_drift_ppm"] = gained
        changes[f"carriers.{name}.navigation.sigma_clock_drift_ppm"] = SIGMA_PPM * declared
    return with_overrides(load_scenario(SCENARIOS / "group.toml"), changes)


def _target(number: int) -> dict[str, Any]:
    """One that goes straight past the middle."""
    course_deg, speed_mps = 137.5 * number % 360, 120.0 + 20 * (number % 6)
    passes_s = EVERY_S * number
    start_s = max(passes_s - BEFORE_S, 0.0)
    way_m = np.array([3000.0 * (number % 5 - 2), -speed_mps * (passes_s - start_s)])
    east_m, north_m = (rotation_clockwise(np.radians(course_deg)) @ way_m).tolist()
    return {
        "name": f"t{number}",
        "identity": f"t{number}",
        "start_s": start_s,
        "end_s": passes_s + BEFORE_S,
        "motion": {
            "kind": "constant_velocity",
            "east_m": east_m,
            "north_m": north_m,
            "course_deg": course_deg,
            "speed_mps": speed_mps,
        },
    }


def looks(seed: int, *, declared: bool) -> list[Errors]:
    """Errors at the instants looked at."""
    steps = {round(at_s / STEP_S) for at_s in LOOKED_AT_S}
    run = played(scenario(seed, declared=declared))
    return [errors(step) for step in run if step.closed.step in steps]


def measured(seed: int, runs: int) -> Iterator[Figure]:
    """How honest the joint state is as the clocks part."""
    low, high = mean_interval(ERRORS, runs, 0.99)
    for declared, how in ((True, "drift"), (False, "drift not declared")):
        every = [looks(seed + i, declared=declared) for i in range(runs)]
        for at_s, found in zip(LOOKED_AT_S, zip(*every, strict=True), strict=True):
            name, honest = f"{how}, {at_s:.0f} s", float(np.mean([e.nees for e in found]))
            label = f"{name}: NEES by dimension"
            yield between(label, honest, low, high) if declared else told(label, honest)
            yield told(f"{name}: clock", float(rms([e.clock_s for e in found])), "s")
            claimed = rms([np.sqrt(np.diag(e.covariance)[-2:]) for e in found])
            yield told(f"{name}: clock, as claimed", float(claimed), "s")
            apart = float(rms([e.relative_m for e in found]))
            yield told(f"{name}: relative position, per axis", apart, "m")


def main() -> None:
    """Measure, print."""
    given = options("Clocks that drift for half an hour.", runs=8)
    report(measured(given.seed, given.runs), given)


if __name__ == "__main__":
    main()
