"""Small scenarios for the tests of world and carriers, written as users write them."""

from __future__ import annotations

from typing import Any

from sim_world.scenario import Scenario, parse_scenario
from sim_world.scenario.toml_text import toml_text

Tree = dict[str, Any]


def radar(**keys: Any) -> Tree:
    """A radar that sees everything to 60 km."""
    return {
        "name": "radar",
        "sigma_bearing_deg": 0.3,
        "sigma_range_m": 30.0,
        "range_max_m": 60_000.0,
        "identity_share": 1.0,
        **keys,
    }


def carrier(name: str = "own", *sensors: Tree, **tables: Tree) -> Tree:
    """A carrier under way to the north-east with errors of the paper's size."""
    return {
        "name": name,
        "motion": {
            "kind": "constant_velocity",
            "east_m": 2_000.0,
            "north_m": -1_000.0,
            "course_deg": 45.0,
            "speed_mps": 8.0,
            "altitude_m": 20.0,
        },
        "navigation": {"sigma_position_m": 1500.0, "sigma_north_deg": 1.0},
        "sensors": list(sensors) or [radar()],
        **tables,
    }


def target(name: str, **keys: Any) -> Tree:
    """A target that goes straight, its name its identity; keys of its motion may be given."""
    outer = {
        k: keys.pop(k) for k in ("class", "start_s", "end_s", "features", "words") if k in keys
    }
    motion = {
        "kind": "constant_velocity",
        "east_m": 9_000.0,
        "north_m": 4_000.0,
        "course_deg": 200.0,
        "speed_mps": 12.0,
    }
    return {"name": name, "identity": name, **outer, "motion": {**motion, **keys}}


def tree(carriers: list[Tree] | None = None, **tables: Any) -> Tree:
    """A whole file: a minute at 41 deg north, one carrier, two targets."""
    return {
        "name": "test",
        "seed": 7,
        "time": {"duration_s": 60.0},
        "origin": {"latitude_deg": 41.0, "longitude_deg": 29.0},
        "carriers": carriers or [carrier()],
        "targets": [target("ada"), target("bob", east_m=-5_000.0)],
        **tables,
    }


def scenario(carriers: list[Tree] | None = None, **tables: Any) -> Scenario:
    """The same as a scenario."""
    return parse_scenario(toml_text(tree(carriers, **tables)))
