"""Random fleets that nobody has tuned for: what the fusion centre makes of each, by family.

    python -m bench.fleets [--seed N] [--runs N] [--json]

`--runs` counts fleets, the families in turn. Each is a scenario in process: two to eight carriers
1 to 60 km apart, anywhere on Earth, radars of every quality, priors of 50 m to 3 km and .5 to 10
deg with errors drawn from them, three to sixty targets. It is played with its errors and with none.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from bench.figures import Figure, at_least, at_most, between, cpu_scale, options, report, told
from bench.in_process import played
from crossfix.evaluation import FrameError, PictureSummary, frame_errors
from crossfix.evaluation.pictures import picture_errors, summarise_picture
from estimation.consistency import mean_interval
from schemas.messages import Correction, Navigation, Tracks
from sim_world.scenario import Scenario, parse_scenario, with_overrides
from sim_world.scenario.toml_text import toml_text

Tree = dict[str, Any]
Draw = np.random.Generator
OWN = "c0"
FIVE_SIGMA = 31.8
"""Chi2 of 3 degrees of freedom, as unlikely as five sigmas of one."""
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


class Outcome(NamedTuple):
    """A fleet as it was played.

    Attributes:
        frames: errors of each other carrier while its correction was applied, those that were.
        others: how many other carriers there are.
        cpu_s: of all, a step.
    """

    frames: list[list[FrameError]]
    others: int
    picture: PictureSummary | None
    cpu_s: float


def judged(scenario: Scenario, away: Callable[[int], Container[str]]) -> Outcome:
    """Play a fleet and compare it with the truth."""
    known: list[Any] = []
    said: list[Any] = []
    began_s = time.process_time()
    for now in played(scenario, away=away):
        own = [m for m in now.said if isinstance(m, Navigation) and m.carrier == OWN]
        outputs = [out.message for out in now.outputs]
        known += [now.targets, now.carriers, *own, *(m for m in outputs if isinstance(m, Tracks))]
        said += [now.carriers, *(m for m in outputs if isinstance(m, Correction))]
    cpu_s = (time.process_time() - began_s) / scenario.declared.steps
    frames = frame_errors(scenario.declared, OWN, said).values()
    applied = [[error for error in errors if error.state == "applied"] for errors in frames]
    picture = summarise_picture(picture_errors(scenario.declared, OWN, known))
    others = len(scenario.declared.carriers) - 1
    return Outcome([errors for errors in applied if errors], others, picture, cpu_s)


def absences(family: str, steps: int) -> Callable[[int], Container[str]]:
    """Which carriers take no part in a step."""
    gone = {"late": range(steps // 3), "lost_and_back": range(steps // 3, steps // 2)}
    return lambda step: {"c1"} if step in gone.get(family, ()) else ()


def main() -> None:
    """Play all fleets and print the figures."""
    given = options(__doc__ or "", runs=3 * len(FAMILIES))
    report(_figures(given.seed, given.runs), given)


def _figures(seed: int, runs: int) -> Iterator[Figure]:
    wrong: list[Outcome] = []
    ratios = []
    for number in range(runs):
        family = list(FAMILIES)[number % len(FAMILIES)]
        scenario = drawn(family, 1000 * seed + number // len(FAMILIES))
        away = absences(family, scenario.declared.steps)
        erring = judged(scenario, away)
        exact = judged(with_overrides(scenario, {"errors.enabled": False}), away)
        wrong.append(erring)
        if erring.picture and exact.picture and exact.picture.gospa_m:
            ratios.append(erring.picture.gospa_m / exact.picture.gospa_m)
    yield from _of_frames(wrong)
    yield at_most("GOSPA / known frames, median of the fleets", float(np.median(ratios)), 1.05)
    yield told("share of fleets in which it is at most 1.05", float(np.mean(np.less(ratios, 1.05))))
    false = [outcome.picture.false for outcome in wrong if outcome.picture]
    yield told("false tracks of a fleet", float(np.mean(false)))
    cpu_s = max(outcome.cpu_s for outcome in wrong) * cpu_scale()
    yield at_most("slowest fleet, CPU a step of one second", cpu_s, 0.2, "s, scaled")


def _of_frames(outcomes: list[Outcome]) -> Iterator[Figure]:
    frames = [errors for outcome in outcomes for errors in outcome.frames]
    late = [np.mean([e.nees for e in errors[len(errors) // 2 :]]) / 3 for errors in frames]
    worst = max(error.nees for errors in frames for error in errors)
    yield told("fleets", len(outcomes))
    yield told("frames of other carriers", sum(outcome.others for outcome in outcomes))
    yield at_least("of these applied", len(frames), 1)
    yield at_most("worst NEES of a frame while applied (five sigma: 31.8)", worst, FIVE_SIGMA)
    low, high = mean_interval(3, len(frames), 0.999)
    yield between("NEES/dim of frames, mean", float(np.mean(late)), low, high)


if __name__ == "__main__":
    main()
