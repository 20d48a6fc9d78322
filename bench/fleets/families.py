"""Random fleets, drawn by family and seed: scenarios that nobody has tuned for.

Two to eight carriers 1 to 60 km apart, anywhere on Earth, radars of every quality, priors of 50 m
to 3 km and .5 to 10 deg with errors drawn from them, three to sixty targets; each family alters
something of that.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from typing import Any, NamedTuple

import numpy as np

from sim_world.scenario import Scenario, parse_scenario
from sim_world.scenario.toml_text import toml_text

Tree = dict[str, Any]
Draw = np.random.Generator
OWN = "c0"
PLACES = ((1.3, 103.8), (-35.0, 18.0), (54.0, 8.0), (70.0, 20.0), (-52.0, 179.95), (15.0, -179.98))


class Fleet(NamedTuple):
    """A fleet being drawn: its scenario, and what its carriers and radars share.

    Attributes:
        targets: the only group of them.
    """

    tree: Tree
    carriers: list[Tree]
    targets: Tree

    def radars(self) -> list[Tree]:
        """One of each carrier."""
        return [carrier["sensors"][0] for carrier in self.carriers]


def drawn(family: str, seed: int) -> Scenario:
    """A fleet of a family."""
    draw = np.random.default_rng([seed, list(FAMILIES).index(family)])
    fleet = _base(draw, f"{family}-{seed}", seed)
    FAMILIES[family](fleet, draw)
    return parse_scenario(toml_text(fleet.tree))


def _base(draw: Draw, name: str, seed: int) -> Fleet:
    count, apart_m = int(draw.integers(2, 9)), _between(draw, 1e3, 60e3)
    reach_m = max(12e3, 0.75 * apart_m + float(draw.uniform(5e3, 15e3)))
    sigmas = _between(draw, 50.0, 3_000.0), _between(draw, 0.5, 10.0)
    carriers = [_carrier(draw, k, apart_m * (k > 0), reach_m, sigmas) for k in range(count)]
    east, north = np.array([[c["motion"][a] for c in carriers] for a in ("east_m", "north_m")])
    wide = 0.55 * reach_m
    box = [east.min() - wide, east.max() + wide, north.min() - wide, north.max() + wide]
    targets: Tree = {
        "name": "g",
        "count": int(draw.integers(3, 61)),
        "box_m": [float(side) for side in box],
        "speed_mps": [1.0, 12.0],
        "identity_share": 0.0,
        "motions": {"constant_velocity": 2, "coordinated_turn": 1},
    }
    latitude, longitude = PLACES[draw.integers(len(PLACES))]
    tree: Tree = {
        "name": name.replace("_", "-"),
        "seed": seed,
        "time": {"duration_s": 25.0 * max(c["sensors"][0]["period_s"] for c in carriers) + 40.0},
        "origin": {"latitude_deg": latitude, "longitude_deg": longitude},
        "fusion": {"own": OWN},
        "carriers": carriers,
        "target_groups": [targets],
    }
    return Fleet(tree, carriers, targets)


def _carrier(
    draw: Draw, number: int, apart_m: float, reach_m: float, sigmas: tuple[float, float]
) -> Tree:
    angle, away_m = draw.uniform(0, 2 * np.pi), apart_m * draw.uniform(0.3, 1.0)
    return {
        "name": f"c{number}",
        "motion": {
            "kind": "coordinated_turn",
            "east_m": float(away_m * np.sin(angle)),
            "north_m": float(away_m * np.cos(angle)),
            "altitude_m": 20.0,
            "course_deg": float(draw.uniform(0, 360)),
            "speed_mps": float(draw.choice([0.0, draw.uniform(2, 12)])),
            "turn_rate_deg_s": float(draw.choice([0.0, draw.uniform(-1.5, 1.5)])),
        },
        "navigation": {
            "sigma_position_m": sigmas[0],
            "sigma_north_deg": sigmas[1],
            "sigma_north_drift_deg_per_sqrt_h": 0.05,
            "sigma_speed_mps": 0.2,
            "sigma_current_mps": 0.3,
            "sigma_clock_s": 0.01,
        },
        "sensors": [_radar(draw, reach_m)],
    }


def _radar(draw: Draw, reach_m: float) -> Tree:
    return {
        "name": "radar",
        "period_s": float(draw.choice([1, 2, 2, 4, 5])),
        "phase_s": float(draw.uniform(0, 1)),
        "sigma_range_m": _between(draw, 15.0, 100.0),
        "sigma_bearing_deg": _between(draw, 0.1, 1.0),
        "range_min_m": 200.0,
        "range_max_m": reach_m * float(draw.uniform(0.8, 1.2)),
        "detection_probability": float(draw.uniform(0.6, 0.95)),
        "clutter_per_scan": float(draw.uniform(0, 4)),
        "identity_share": 0.0,
    }


def _between(draw: Draw, low: float, high: float) -> float:
    """Any order of magnitude as likely."""
    return float(np.exp(draw.uniform(np.log(low), np.log(high))))


def _named(share: float) -> Callable[[Fleet, Draw], None]:
    def alter(fleet: Fleet, _: Draw) -> None:
        fleet.targets["identity_share"] = share
        for radar in fleet.radars():
            radar["identity_share"] = 1.0

    return alter


def _navigating(**sigmas: float) -> Callable[[Fleet, Draw], None]:
    def alter(fleet: Fleet, _: Draw) -> None:
        for carrier in fleet.carriers:
            carrier["navigation"].update(sigmas)

    return alter


def _moving(**how: Any) -> Callable[[Fleet, Draw], None]:
    def alter(fleet: Fleet, _: Draw) -> None:
        fleet.targets.update(how)

    return alter


def _chain(fleet: Fleet, draw: Draw) -> None:
    """In a row, each sees as far as half-way beyond its neighbour."""
    step_m = float(draw.uniform(10e3, 30e3))
    for k, (carrier, radar) in enumerate(zip(fleet.carriers, fleet.radars(), strict=True)):
        carrier["motion"].update(east_m=k * step_m, north_m=float(draw.normal(0, 0.1 * step_m)))
        radar["range_max_m"] = 0.8 * step_m
    end_m = step_m * (len(fleet.carriers) - 0.4)
    fleet.targets["box_m"] = [-0.6 * step_m, end_m, -0.6 * step_m, 0.6 * step_m]


def _convoy(fleet: Fleet, draw: Draw) -> None:
    """A lattice of ships of one course, and one that is not of it."""
    side, course = float(draw.uniform(600, 1500)), float(draw.uniform(0, 360))
    rows, columns = draw.integers(2, 5, 2)
    middle = draw.normal(0, 3000, 2)
    fleet.tree["targets"] = [
        {
            "name": f"v{i}-{j}",
            "motion": {
                "kind": "constant_velocity",
                "east_m": float(middle[0] + i * side),
                "north_m": float(middle[1] + j * side),
                "course_deg": course,
                "speed_mps": 7.0,
            },
        }
        for i in range(rows)
        for j in range(columns)
    ]
    fleet.targets["count"] = 1


def _erring(**sigmas: float) -> Callable[[Fleet, Draw], None]:
    """Radars with systematic errors, drawn from what they declare."""

    def alter(fleet: Fleet, _: Draw) -> None:
        for radar in fleet.radars():
            radar.update(sigmas)

    return alter


def _short_own(fleet: Fleet, _: Draw) -> None:
    fleet.radars()[0]["range_max_m"] *= 0.35


def _tracking(fleet: Fleet, draw: Draw) -> None:
    for radar in fleet.radars():
        if draw.random() < 0.6:
            radar["tracking"] = {"report": str(draw.choice(["track", "increment"]))}


def _passive(fleet: Fleet, _: Draw) -> None:
    last = fleet.radars()[-1]
    last.update(coordinates="bearing", kind="passive")
    del last["sigma_range_m"]


def _as_drawn(fleet: Fleet, draw: Draw) -> None:
    pass


FAMILIES: Mapping[str, Callable[[Fleet, Draw], None]] = {
    "nameless": _as_drawn,
    "named": _named(1.0),
    "partly_named": _named(0.3),
    "chain": _chain,
    "convoy": _convoy,
    "parallel": _moving(
        course_deg=[40.0, 40.01], speed_mps=[6.0, 6.01], motions={"constant_velocity": 1}
    ),
    "moored": _moving(speed_mps=[0.0, 0.5]),
    "aircraft": _moving(speed_mps=[80.0, 250.0], altitude_m=[100.0, 500.0]),
    "tracking": _tracking,
    "passive": _passive,
    "drifting": _navigating(
        sigma_speed_mps=1.0, sigma_current_mps=1.5, sigma_north_drift_deg_per_sqrt_h=0.5
    ),
    "clocks": _navigating(sigma_clock_s=0.3),
    "wide": _navigating(sigma_position_m=3000.0, sigma_north_deg=10.0),
    "surveyed": _navigating(sigma_position_m=5.0, sigma_north_deg=0.05, sigma_current_mps=0.0),
    "short_own": _short_own,
    "late": _as_drawn,
    "lost_and_back": _as_drawn,
    "range_bias": _erring(sigma_range_bias_m=60.0),
    "range_scale": _erring(sigma_range_scale=0.004),
    "radar_errors": _erring(
        sigma_range_bias_m=60.0, sigma_range_scale=0.004, sigma_azimuth_bias_deg=0.3
    ),
}


def absences(family: str, steps: int) -> Callable[[int], Container[str]]:
    """Which carriers take no part in a step."""
    gone = {"late": range(steps // 3), "lost_and_back": range(steps // 3, steps // 2)}
    return lambda step: {"c1"} if step in gone.get(family, ()) else ()
