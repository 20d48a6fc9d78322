"""Two ships at rest 9 km apart whose radars see the same targets, each with errors of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim_world.scenario import Scenario, parse_scenario
from sim_world.scenario.toml_text import toml_text


def two_radars(
    steps: int,
    radars: Mapping[str, Mapping[str, Any]],
    targets: Mapping[str, Any],
    sigma_north_deg: float,
) -> Scenario:
    """A scenario.

    Args:
        radars: by carrier, `own` first, what is to be said of its radar.
        targets: number and box of the targets.
    """
    carriers = [
        {
            "name": name,
            "motion": {"kind": "constant_velocity", "east_m": 9e3 * number, "north_m": 0.0},
            "navigation": {"sigma_position_m": 200.0, "sigma_north_deg": sigma_north_deg},
            "sensors": [{"name": "radar", "detection_probability": 0.95, **radar}],
        }
        for number, (name, radar) in enumerate(radars.items())
    ]
    tree = {
        "name": "added",
        "seed": 3,
        "time": {"duration_s": steps},
        "origin": {"latitude_deg": -33.0, "longitude_deg": 18.0},
        "carriers": carriers,
        "target_groups": [{"name": "g", "speed_mps": [2, 10], **targets}],
    }
    return parse_scenario(toml_text(tree))
