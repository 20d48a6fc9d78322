"""Ranges by a detour: scenario `group`, and groups of more carriers, with a share of them too long.

    python -m bench.navigation.detours [--seed N] [--runs N] [--json]

Whole runs in process, 60 s each, some 5 s of one core with three carriers. Detours add 30 to 300 m
from the first range on. Groups of more than three start on a ring.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from bench.figures import Figure, between, options, report, told
from bench.in_process import played
from bench.navigation.live import SCENARIOS, Errors, errors
from estimation.consistency import mean_interval, rms
from sim_world.scenario import Scenario, load_scenario, with_overrides

NAMES = ("one", "two", "three", "four", "five", "six", "seven", "eight")
LOOKED_AT_S = (20, 60)
SHARES, FLEETS = (0.0, 0.05, 0.1, 0.2), (5, 8)
FLEET_SHARE = 0.1


def scenario(seed: int, share: float, carriers: int = 3) -> Scenario:
    """A group of some carriers that all range each other and the beacon."""
    group = load_scenario(SCENARIOS / "group.toml")
    changes: dict[str, Any] = {"seed": seed, "time.duration_s": LOOKED_AT_S[-1]}
    if carriers > 3:
        tables = [_carrier(number) for number in range(carriers)]
        changes["carriers"] = tables
    for number, name in enumerate(NAMES[:carriers]):
        ranging = {
            "kind": "two_way",
            "to": [*NAMES[number + 1 : carriers], "mark"],
            "period_s": 2.5,
            "sigma_m": 5,
            "outlier_share": share,
            "outlier_m": [30.0, 300.0],
        }
        if carriers > 3:
            changes["carriers"][number]["ranging"] = [ranging]
        else:
            changes[f"carriers.{name}.ranging"] = [ranging]
    return with_overrides(group, changes)


def _carrier(number: int) -> dict[str, Any]:
    """One like those of the scenario."""
    turned = 2.4 * number
    return {
        "name": NAMES[number],
        "motion": {
            "kind": "coordinated_turn",
            "east_m": 4_500 * float(np.sin(turned)),
            "north_m": 4_500 * float(np.cos(turned)),
            "course_deg": (70.0 * number + 30.0) % 360,
            "speed_mps": 60,
            "turn_rate_deg_s": 0.6 if number % 2 else -0.6,
        },
        "navigation": {
            "sigma_position_m": 200,
            "sigma_north_deg": 1,
            "sigma_current_mps": 0.5,
            "sigma_log_noise_mps": 1,
            "sigma_compass_noise_deg": 0.5,
            "sigma_clock_s": 0.5,
        },
        "sensors": [
            {
                "name": "radar",
                "period_s": 5,
                "sigma_range_m": 30,
                "sigma_bearing_deg": 0.5,
                "range_max_m": 80_000,
                "identity_share": 1,
            }
        ],
    }


def looks(seed: int, share: float, carriers: int) -> list[Errors]:
    """Errors at the instants looked at."""
    run = played(scenario(seed, share, carriers))
    return [errors(step) for step in run if step.closed.step in LOOKED_AT_S]


def measured(seed: int, runs: int) -> Iterator[Figure]:
    """How honest and how near the joint state is."""
    kinds = [(share, 3) for share in SHARES] + [(FLEET_SHARE, size) for size in FLEETS]
    for share, carriers in kinds:
        every = [looks(seed + i, share, carriers) for i in range(runs)]
        low, high = mean_interval(4 * carriers - 2, runs, 0.99)
        for at_s, found in zip(LOOKED_AT_S, zip(*every, strict=True), strict=True):
            name = f"{carriers} carriers, share {share:g}, {at_s} s"
            honest = [e.nees for e in found]
            yield between(f"{name}: NEES by dimension", float(np.mean(honest)), low, high)
            yield told(f"{name}: NEES by dimension, worst run", max(honest))
            apart = float(rms([e.relative_m for e in found]))
            yield told(f"{name}: relative position, per axis", apart, "m")


def main() -> None:
    """Measure, print."""
    given = options("Ranges by a detour in groups of 3, 5 and 8 carriers.", runs=4)
    report(measured(given.seed, given.runs), given)


if __name__ == "__main__":
    main()
