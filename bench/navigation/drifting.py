"""Clocks that drift: scenario `group` for half an hour, as told to the fusion centre and not told.

    python -m bench.navigation.drifting [--ppm SIGMA] [--duration SECONDS] [--declared]
                                        [--seed N] [--runs N] [--json]

Whole runs in process, some 40 s for each half hour. The clocks of its three carriers gain 20 ppm
(one sigma); targets come from every side in turn, four or five of them being there at a time. With
`--declared` only the runs of which the centre is told.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from bench.figures import Figure, between, options, report, told
from bench.in_process import played
from bench.navigation.live import SCENARIOS, Errors, errors
from estimation.consistency import mean_interval, rms
from estimation.frames import rotation_clockwise
from sim_world.scenario import Scenario, load_scenario, with_overrides

STEP_S = 2.5
CARRIERS = ("one", "two", "three")
EVERY_S, BEFORE_S = 75.0, 180.0
"""One passes the middle every so often, and is there so long before and after it."""
ERRORS = 10
"""Of three places, two headings and two clocks, each against the own ones."""


class Drift(NamedTuple):
    """How much clocks gain (one sigma), for how long."""

    sigma_ppm: float = 20.0
    duration_s: float = 1800.0


def scenario(seed: int, drift: Drift, *, declared: bool) -> Scenario:
    """Three carriers whose clocks drift, whether that is declared or not."""
    targets = int(drift.duration_s // EVERY_S) + 2
    drift_ppm = drift.sigma_ppm * np.random.default_rng([seed, 50]).standard_normal(len(CARRIERS))
    changes: dict[str, Any] = {
        "seed": seed,
        "time.duration_s": drift.duration_s,
        "time.step_s": STEP_S,
        "targets": [_target(number) for number in range(targets)],
    }
    for name, gained in zip(CARRIERS, drift_ppm.tolist(), strict=True):
        changes[f"carriers.{name}.errors.clock_drift_ppm"] = gained
        changes[f"carriers.{name}.navigation.sigma_clock_drift_ppm"] = drift.sigma_ppm * declared
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


def looks(seed: int, drift: Drift, *, declared: bool) -> list[Errors]:
    """Errors at the thirds of a run."""
    steps = {round(drift.duration_s * third / 3 / STEP_S) for third in (1, 2, 3)}
    run = played(scenario(seed, drift, declared=declared))
    return [errors(step) for step in run if step.closed.step in steps]


def measured(seed: int, runs: int, drift: Drift, *, untold: bool) -> Iterator[Figure]:
    """How honest the joint state is as the clocks part, and if it is not told that they do."""
    low, high = mean_interval(ERRORS, runs, 0.99)
    looked_at_s = [drift.duration_s * third / 3 for third in (1, 2, 3)]
    for declared, how in ((True, "drift"), (False, "drift not declared"))[: 1 + untold]:
        every = [looks(seed + i, drift, declared=declared) for i in range(runs)]
        for at_s, found in zip(looked_at_s, zip(*every, strict=True), strict=True):
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
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--ppm", type=float, default=Drift().sigma_ppm)
    parser.add_argument("--duration", type=float, default=Drift().duration_s)
    parser.add_argument("--declared", action="store_true")
    ways, rest = parser.parse_known_args()
    given = options(
        "Clocks that drift; --ppm SIGMA, --duration SECONDS, --declared.", runs=8, arguments=rest
    )
    drift = Drift(ways.ppm, ways.duration)
    report(measured(given.seed, given.runs, drift, untold=not ways.declared), given)


if __name__ == "__main__":
    main()
