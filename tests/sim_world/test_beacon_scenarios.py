"""The scenarios of papers 003 and 004: what goes over the wire is enough for their estimators."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from carriers.carrier import Carrier, Stamp
from estimation.frames import Site, enu_from_geodetic
from estimation.system_alignment import align, dead_reckoning, prior, ranges
from schemas.messages import DeclaredScenario, Navigation, Ranging, SourceReport
from sim_world.scenario import Scenario, load_scenario, with_overrides
from sim_world.scenario.declared import beacon_place_m
from sim_world.world import World

SCENARIOS = Path(__file__).parents[2] / "scenarios"


class Said(NamedTuple):
    """What a carrier said in a run."""

    navigation: list[Navigation]
    ranging: list[Ranging]
    reports: list[SourceReport]


def run(scenario: Scenario, name: str, steps: int) -> Said:
    world, carrier, stamp = World(scenario), Carrier(scenario, name), Stamp("b")
    messages = [
        out.message
        for step in range(1, steps + 1)
        for out in carrier.step(*world.step(step), stamp)
    ]
    return Said(
        [m for m in messages if isinstance(m, Navigation)],
        [m for m in messages if isinstance(m, Ranging)],
        [m for m in messages if isinstance(m, SourceReport)],
    )


def places_m(declared: DeclaredScenario) -> np.ndarray:
    """Declared places (J, 3) of the beacons at the scenario's origin."""
    origin = Site(*(getattr(declared.origin, n) for n in Site._fields))
    return np.array(
        [
            enu_from_geodetic(origin, b.latitude_rad, b.longitude_rad, b.altitude_m)
            for b in declared.beacons
        ]
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_the_beacons_are_surveyed_from_what_the_helicopter_says(seed: int) -> None:
    """Nothing but its messages and the declared scenario is used, as a stranger would."""
    scenario = with_overrides(load_scenario(SCENARIOS / "beacons.toml"), {"seed": seed})
    declared, steps = scenario.declared, 200
    said = run(scenario, "helicopter", steps)
    # its first message is where its way begins: that place it knows, by the scenario
    way = np.array([[n.reckoned_east_m, n.reckoned_north_m] for n in said.navigation])
    steps_m = np.diff(way, axis=0)
    start = np.array(World(scenario).step(1)[1].position_m[0][:2])
    own = declared.carriers[0]
    path = dead_reckoning(
        declared.step_ns * 1e-9,
        np.hypot(*steps_m.T) / (declared.step_ns * 1e-9),
        np.arctan2(*steps_m.T),
        own.sigma_log_noise_mps,
        own.sigma_compass_noise_rad,
        start_m=start,
    )
    number = {beacon.name: i for i, beacon in enumerate(declared.beacons)}
    heard = [m for m in said.ranging if m.step > 1]
    logs = ranges(
        [m.step - 2 for m in heard],
        [number[m.peer] for m in heard],
        [m.value_m for m in heard],
        [m.sigma_m for m in heard],
    )
    known = prior(places_m(declared), 50.0, sigma_wind_mps=own.sigma_current_mps)
    found = align(path, logs, known)
    truth = np.array([beacon_place_m(scenario.file, b) for b in scenario.file.beacons])
    error = (found.beacons_m - truth).ravel()
    where = np.arange(7, 13)
    normalised = error @ np.linalg.solve(found.covariance[np.ix_(where, where)], error) / 6
    assert found.status == "solved"
    assert normalised < 3.5  # a chi-squared of 6 once: .998; flat axes cost a metre here
    assert np.abs(error[[0, 1, 3, 4]]).max() < 25
    assert np.abs(places_m(declared) - truth).max() > 25  # before, tens of metres off


def test_the_formation_hears_as_the_paper_has_it() -> None:
    scenario = load_scenario(SCENARIOS / "formation.toml")
    for name, peers in (
        ("controller", set()),
        ("primary-2", {"controller", "ground-1", "ground-2"}),
        ("secondary", {f"primary-{i}" for i in range(1, 5)}),
    ):
        said = run(scenario, name, 3)
        assert {m.peer for m in said.ranging} == peers
        assert {m.kind for m in said.ranging} <= {"pseudorange"}
    clocks = [c.ranging[0].sigma_clock_m for c in scenario.declared.carriers[1:]]
    assert clocks == [300] * 5


def test_the_group_logs_all_targets_and_ranges_everybody() -> None:
    scenario = load_scenario(SCENARIOS / "group.toml")
    pairs: Counter[frozenset[str]] = Counter()
    for carrier in scenario.declared.carriers:
        said = run(scenario, carrier.name, 300)
        assert min(len(report.identity or ()) for report in said.reports) == 6
        assert len(said.reports) == 60
        pairs.update(frozenset({carrier.name, m.peer}) for m in said.ranging)
    assert len(pairs) == 6
    assert set(pairs.values()) == {120}
