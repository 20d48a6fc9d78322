"""Beacons aligned in a whole run: their error shrinks as claimed, what is hidden is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from bench.in_process import Played, played
from estimation.arrays import Array
from fusion_center import pipeline
from fusion_center.navigation import symmetric
from fusion_center.settings import settings_from
from fusion_center.state import pack, unpack
from schemas import codec
from schemas.messages import AlignedCarrier, Alignment
from sim_world.scenario import Scenario, load_scenario, with_overrides
from sim_world.scenario.declared import beacon_place_m

SCENARIOS = Path(__file__).parents[2] / "scenarios"
BEACONS = load_scenario(SCENARIOS / "beacons.toml")
SEEDS = range(1, 9)
RANGING = {"kind": "two_way", "to": ["east", "west"], "period_s": 3, "sigma_m": 3.46}
STRAIGHT = {
    "carriers.helicopter.motion": {
        "kind": "constant_velocity",
        "east_m": 0.0,
        "north_m": 0.0,
        "course_deg": 0.0,
        "speed_mps": 30.0,
    }
}


def with_seed(seed: int, **more: Any) -> Scenario:
    return with_overrides(BEACONS, {"seed": seed} | more)


@pytest.fixture(scope="module")
def runs() -> list[tuple[Scenario, list[Played]]]:
    scenarios = [with_seed(seed) for seed in SEEDS]
    return [(scenario, list(played(scenario))) for scenario in scenarios]


def told(step: Played) -> Alignment:
    return next(out.message for out in step.outputs if isinstance(out.message, Alignment))


def of_carrier(step: Played) -> AlignedCarrier:
    (carrier,) = told(step).carriers
    return carrier


def beacon_errors(scenario: Scenario, step: Played) -> tuple[Array, Array]:
    """(J, 3) told less true places, (J, 3, 3) as claimed."""
    true = {b.name: beacon_place_m(scenario.file, b) for b in scenario.file.beacons}
    beacons = told(step).beacons
    errors = [np.subtract(beacon.position_m, true[beacon.beacon]) for beacon in beacons]
    return np.array(errors), np.array([symmetric(beacon.covariance, 3) for beacon in beacons])


def normalised(errors: Array, covariances: Array) -> Array:
    solved = np.linalg.solve(covariances, errors[..., None])[..., 0]
    found: Array = np.mean(errors * solved, axis=-1)
    return found


def test_beacons_come_out_better_than_they_were_known(
    runs: list[tuple[Scenario, list[Played]]],
) -> None:
    first = [beacon_errors(scenario, run[0])[0] for scenario, run in runs]
    last = [beacon_errors(scenario, run[-1])[0] for scenario, run in runs]
    assert np.sqrt(np.mean(np.square(last))) < 0.4 * np.sqrt(np.mean(np.square(first)))
    for _, run in runs:
        assert of_carrier(run[-1]).ranges > 400
        assert of_carrier(run[-1]).status != "undetermined"
        assert not of_carrier(run[-1]).unobservable


@pytest.mark.parametrize("step", [10, 50, 100, 205])
def test_errors_are_as_large_as_claimed(
    runs: list[tuple[Scenario, list[Played]]], step: int
) -> None:
    """Mean of 16 beacons' NEES / 3: its sigma is sqrt(2 / 48) = .2; three of them either way."""
    nees = [normalised(*beacon_errors(scenario, run[step - 1])) for scenario, run in runs]
    assert 0.4 < np.mean(nees) < 1.6
    assert np.max(nees) < 7  # chi2 of 3 beyond 21: one in ten thousand


def test_the_carrier_knows_where_it_is_and_what_current_it_is_in(
    runs: list[tuple[Scenario, list[Played]]],
) -> None:
    """Mean of 8 carriers' NEES / 2: its sigma is sqrt(2 / 16) = .35; three of them."""
    found, sigmas = [], []
    for _, run in runs:
        carrier = of_carrier(run[-1])
        error = np.subtract(carrier.position_m, run[-1].carriers.position_m[0][:2])
        found.append(normalised(error, symmetric(carrier.covariance, 2)))
        sigmas.append(np.sqrt(np.diag(symmetric(carrier.current_covariance, 2))))
    assert np.mean(found) < 2.1
    assert np.max(sigmas) < 0.1  # of 1 m/s before


def test_a_straight_way_leaves_three_directions_and_says_which() -> None:
    run = list(played(with_seed(1, **STRAIGHT), steps=60))
    carrier = of_carrier(run[-1])
    assert carrier.status == "undetermined"
    assert set(carrier.unobservable) == {
        "beacon east turned about the track",
        "beacon west turned about the track",
        "the whole picture turned about the start",
    }
    hidden = {beacon.beacon: beacon.unobservable for beacon in told(run[-1]).beacons}
    assert "beacon east turned about the track" in hidden["east"]
    assert "beacon east turned about the track" not in hidden["west"]
    assert "the whole picture turned about the start" in hidden["west"]


def test_range_differences_align_as_well() -> None:
    scenario = with_seed(3, **{"carriers.helicopter.ranging": [{**RANGING, "kind": "difference"}]})
    last = list(played(scenario))[-1]
    errors, covariances = beacon_errors(scenario, last)
    assert of_carrier(last).ranges > 200
    assert np.all(np.linalg.eigvalsh(covariances)[:, 0] < 20**2)
    assert np.max(normalised(errors, covariances)) < 7


def test_a_range_far_out_of_line_moves_nothing() -> None:
    scenario = with_seed(2)
    often = {**RANGING, "outlier_share": 0.1, "outlier_m": [1_000.0, 3_000.0]}
    reflected = with_seed(2, **{"carriers.helicopter.ranging": [often]})
    clean, dirty = (list(played(s))[-1] for s in (scenario, reflected))
    apart = beacon_errors(scenario, clean)[0] - beacon_errors(reflected, dirty)[0]
    assert np.abs(apart).max() < 25  # less than a sigma of what remains


def test_the_alignment_passes_the_wire_and_the_state_survives_packing(
    runs: list[tuple[Scenario, list[Played]]],
) -> None:
    last = runs[0][1][-1]
    message = told(last)
    assert codec.decode(Alignment, codec.encode(message)) == message
    assert pack(unpack(pack(last.state))) == pack(last.state)


def test_a_cut_of_time_changes_nothing() -> None:
    """Two steps closed at once leave the state that two closings leave, and after packing too."""
    scenario = with_seed(4)
    steps = list(played(scenario, steps=40))
    declared = scenario.declared
    state = pipeline.initial(declared, settings_from(declared.fusion))
    for one, two in zip(steps[::2], steps[1::2], strict=True):
        closed = replace(two.closed, step=two.closed.step)
        state, _ = pipeline.step(unpack(pack(state)), closed, one.said + two.said)
    assert pack(replace(state, past=(), published={})) == pack(
        replace(steps[-1].state, past=(), published={})
    )


def test_a_new_boot_begins_anew() -> None:
    scenario = with_seed(1)
    steps = list(played(scenario, steps=20))
    last = steps[-1]
    said = [replace(m, boot="b2", seq=1, t_ns=m.t_ns + 10**9) for m in last.said[:1]]
    ends = [replace(end, boot="b2", last_seq=1) for end in last.closed.manifest]
    ends = [end for end in ends if end.stream == said[0].stream]
    closed = replace(last.closed, step=21, t_ns=last.closed.t_ns + 10**9, manifest=ends)
    state, _ = pipeline.step(last.state, closed, said)
    assert state.group.members["helicopter"].boot == 2
    assert state.group.members["helicopter"].ranges == 0


def test_without_beacons_or_when_told_so_nothing_is_said() -> None:
    strait = load_scenario(SCENARIOS / "paper000.toml")
    off = {"own": "helicopter", "alignment": {"enabled": False}}
    for run in (played(strait, steps=3), played(with_seed(1), off, steps=3)):
        for step in run:
            assert not any(isinstance(out.message, Alignment) for out in step.outputs)
            assert step.state.group is None


def test_beacons_are_bounded_in_number() -> None:
    one = {"own": "helicopter", "alignment": {"most_beacons": 1}}
    *_, last = played(with_seed(1), one, steps=10)
    assert [beacon.beacon for beacon in told(last).beacons] == ["east"]
