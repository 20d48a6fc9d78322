"""The joint state in the system: scenarios `group` and `formation` through the whole pipeline.

Errors are those of the state at the last step. Places lie in the own carrier's axes, from a
surveyed beacon; clocks are counted from the own one, which nothing ties to the true time.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_most, between, scaled_seconds, told
from bench.in_process import Played, played
from estimation.arrays import Array
from estimation.consistency import mean_interval, nees, rms
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.joint_navigation.links import released, with_links
from estimation.joint_navigation.members import QUARTER_TURN, CarrierStart, founded, with_carrier
from estimation.joint_navigation.online import (
    HEADING,
    STAMP,
    Joint,
    Step,
    carried,
    improved,
)
from estimation.joint_navigation.online_rows import Range, Surroundings, range_rows
from fusion_center.group.joining import joint_of
from fusion_center.navigation import symmetric
from schemas.messages import Alignment, TruthCarriers
from sim_world.scenario import Scenario, load_scenario, with_overrides
from sim_world.scenario.declared import beacon_place_m

SCENARIOS = Path(__file__).parents[2] / "scenarios"
FLEET = 50


class Errors(NamedTuple):
    """Of all carriers of a group, at one step.

    Attributes:
        names: of the carriers, the own one first.
        place_m: (C, 2), relative_m: (C - 1, 2) from the own one, heading_rad and clock_s: (C - 1,).
        covariance: of places, then headings, then clocks, as the state has it.
        nees: of all these together, by dimension.
    """

    names: tuple[str, ...]
    place_m: Array
    relative_m: Array
    heading_rad: Array
    clock_s: Array
    covariance: Array
    nees: float


def errors(step: Played) -> Errors:
    """The joint state of a step against the truth, as the own carrier sees it."""
    group, own = step.state.group, step.state.own
    if group is None:
        raise ValueError("there is no group")
    names = [own, *(name for name in sorted(group.members) if name != own)]
    joint = joint_of(group)
    first = [joint.first(f"carrier/{name}") for name in names]
    back = rotation_clockwise(-joint.mean[first[0] + HEADING])
    places = [back @ joint.mean[at : at + 2] for at in first]
    heading = joint.mean[np.array(first[1:]) + HEADING] - joint.mean[first[0] + HEADING]
    clock = joint.mean[np.array(first[1:]) + STAMP] - joint.mean[first[0] + STAMP]
    true_places, true_heading, true_clock = _truth(step, names, group.pivot_m)
    place = np.array(places) - true_places
    turned = wrap_pi(heading - true_heading)
    by = _derivatives(joint, first, back, places)[:, joint.free]
    covariance = by @ joint.covariance @ by.T
    every = np.concatenate([place.ravel(), turned, clock - true_clock])
    unsure = np.flatnonzero(np.diag(covariance) > 0)
    normalised = float(nees(every[unsure], covariance[np.ix_(unsure, unsure)])) / len(unsure)
    apart = place[1:] - place[0]
    return Errors(tuple(names), place, apart, turned, clock - true_clock, covariance, normalised)


def _truth(step: Played, names: list[str], pivot_m: Array) -> tuple[Array, Array, Array]:
    """Places (C, 2) in own axes, headings and clocks (C - 1,) less the own ones."""
    group, truth = step.state.group, step.carriers
    rows = [truth.carrier.index(name) for name in names]
    north, clock = np.array(truth.north_error_rad)[rows], np.array(truth.clock_offset_s)[rows]
    there = []
    for row, name, late in zip(rows, names, clock, strict=True):
        at_ns = group.members[name].t_ns if group else truth.t_ns
        there.append(_place_m(truth, row, (at_ns - truth.t_ns) * 1e-9 - late))
    places = (np.array(there) - pivot_m[:2]) @ rotation_clockwise(-north[0]).T
    return places, north[1:] - north[0], clock[1:] - clock[0]


def _place_m(truth: TruthCarriers, row: int, after_s: float) -> Array:
    """(2,) of a carrier a moment after the step."""
    place, velocity = np.array(truth.position_m[row]), np.array(truth.velocity_mps[row])
    whole: Array = place + after_s * velocity
    whole += after_s**2 / 2 * np.array(truth.acceleration_mps2[row])
    return whole[:2]


def _derivatives(joint: Joint, first: list[int], back: Array, places: list[Array]) -> Array:
    """Of places in own axes, headings and clocks against the own ones, by all slots."""
    count, others = len(first), len(first) - 1
    by = np.zeros((2 * count + 2 * others, len(joint.mean)))
    for i, (at, place) in enumerate(zip(first, places, strict=True)):
        by[2 * i : 2 * i + 2, at : at + 2] = back
        by[2 * i : 2 * i + 2, first[0] + HEADING] -= QUARTER_TURN @ place
    for i, at in enumerate(first[1:]):
        for row, slot in ((2 * count + i, HEADING), (2 * count + others + i, STAMP)):
            by[row, at + slot], by[row, first[0] + slot] = 1.0, -1.0
    return by


def ended(scenario: Scenario) -> Errors:
    """Errors at the end of a run."""
    *_, last = played(scenario)
    return errors(last)


def runs_of(name: str, seed: int, runs: int) -> list[Errors]:
    """A scenario with so many seeds."""
    scenario = load_scenario(SCENARIOS / f"{name}.toml")
    return [ended(with_overrides(scenario, {"seed": seed + i})) for i in range(runs)]


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """What is demanded of the system, measured in it."""
    yield from _group(seed, max(runs // 8, 4))
    yield from _formation(seed, max(runs // 8, 4))
    yield from _beacons(seed, max(runs // 12, 4))
    yield from _fleet(seed)


def _group(seed: int, runs: int) -> Iterator[Figure]:
    found = runs_of("group", seed, runs)
    relative = float(rms([e.relative_m for e in found]))
    turned = float(np.degrees(rms([e.heading_rad for e in found])))
    yield at_most("group, live: relative position, per axis", relative, 6, "m")
    claimed = float(np.sqrt(np.mean([_relative_variance(e) for e in found])))
    yield told("group, live: relative position, per axis, as claimed", claimed, "m")
    yield at_most("group, live: heading", turned, 0.05, "deg")
    yield at_most("group, live: log clock", float(rms([e.clock_s for e in found])), 0.045, "s")
    own = float(rms([e.place_m for e in found]))
    yield at_most("group, live: own position, per axis", own, 6.5, "m")
    honest = float(np.mean([e.nees for e in found]))
    yield between("group, live: NEES by dimension", honest, 0.85, 1.25)


def _relative_variance(found: Errors) -> float:
    """Mean variance of a coordinate of the others from the own carrier, as claimed."""
    covariance, values = found.covariance, []
    for i in range(2, 2 * len(found.names)):
        own = i % 2
        values.append(covariance[i, i] + covariance[own, own] - 2 * covariance[i, own])
    return float(np.mean(values))


def _formation(seed: int, runs: int) -> Iterator[Figure]:
    found = runs_of("formation", seed, runs)
    place = [_nees_of_places(e) for e in found]
    low, high = mean_interval(2 * len(found[0].names), runs, 0.99)
    yield between("formation, live: NEES by dimension, places", float(np.mean(place)), low, high)
    number = found[0].names.index("secondary")
    radial = 2 * float(np.sqrt(np.mean([np.sum(e.place_m[number] ** 2) for e in found])))
    yield at_most("formation, live: 2 sigma_r of the secondary", radial, 56, "m")
    own = slice(2 * number, 2 * number + 2)
    variance = np.mean([np.trace(e.covariance[own, own]) for e in found])
    yield told("formation, live: 2 sigma_r as claimed", 2 * float(np.sqrt(variance)), "m")


def _nees_of_places(found: Errors) -> float:
    """Of all places together, by dimension."""
    count = found.place_m.size
    return float(nees(found.place_m.ravel(), found.covariance[:count, :count])) / count


def _beacons(seed: int, runs: int) -> Iterator[Figure]:
    """One carrier and two beacons that are known to 50 m."""
    scenario, apart, normalised = load_scenario(SCENARIOS / "beacons.toml"), [], []
    for i in range(runs):
        drawn = with_overrides(scenario, {"seed": seed + i})
        *_, last = played(drawn)
        true = {b.name: beacon_place_m(drawn.file, b) for b in drawn.file.beacons}
        for found in (out.message for out in last.outputs if isinstance(out.message, Alignment)):
            for beacon in found.beacons:
                error = np.subtract(beacon.position_m, true[beacon.beacon])
                apart.append(error)
                normalised.append(float(nees(error, symmetric(beacon.covariance, 3))) / 3)
    errors_m = np.array(apart)
    yield told("beacons, live: RMSE xy", float(rms(errors_m[:, :2])), "m")
    yield told("beacons, live: RMSE z", float(rms(errors_m[:, 2])), "m")
    yield between("beacons, live: NEES by dimension", float(np.mean(normalised)), 0.6, 1.4)


def _fleet(seed: int) -> Iterator[Figure]:
    """Fifty carriers that range to three others and to two beacons each, every second."""
    alone, ranges, there = fleet(seed)
    joint = with_links(alone, ranges)
    step = Step(1.0, np.array([50.0, 20.0]), 0.25 * np.eye(2))
    names = [name for name in joint.names if name.startswith("carrier/")]

    def update() -> None:
        moved = carried(joint, [(name, step) for name in names])
        released(improved(moved, range_rows(moved, ranges, there)).joint)

    yield at_most("joint state of 50 carriers, 1 s", 1e3 * scaled_seconds(update, 5), 100, "ms")


def fleet(seed: int) -> tuple[Joint, list[Range], Surroundings]:
    """A joint state of many carriers, one second of pseudoranges, and what is known beside."""
    rng = np.random.default_rng([seed, 30])
    names = [f"carrier/{i}" for i in range(FLEET)]
    true = np.column_stack([rng.uniform(-3e4, 3e4, (FLEET, 2)), rng.uniform(0, 9e3, FLEET)])
    starts = [
        CarrierStart(
            place[:2] + 100 * rng.standard_normal(2),
            np.diag([100.0, 100.0, 0.01]) ** 2,
            current_mps=0.5,
            clock_m=300.0,
            clock_drift_mps=0.3,
            stamp_s=0.1,
        )
        for place in true
    ]
    joint = founded(names[0], starts[0])
    for name, start in zip(names[1:], starts[1:], strict=True):
        joint = with_carrier(joint, name, start)
    beacons = {"beacon/a": np.array([1e4, 0.0, 0.0]), "beacon/b": np.array([-1e4, 5e3, 0.0])}
    places = dict(zip(names, true, strict=True)) | beacons
    ranges = []
    for i, name in enumerate(names):
        for peer in (*(names[(i + ahead) % FLEET] for ahead in (1, 7, 13)), *beacons):
            exact = float(np.linalg.norm(places[name] - places[peer]))
            ranges.append(Range(name, peer, "pseudorange", exact + 5 * rng.standard_normal(), 5.0))
    heights = {name: float(place[2]) for name, place in zip(names, true, strict=True)}
    speeds = dict.fromkeys(names, np.array([50.0, 20.0]))
    return joint, ranges, Surroundings(heights, speeds, beacons)
