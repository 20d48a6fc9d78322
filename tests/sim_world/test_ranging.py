"""Laws of ranging: true distances without errors, the declared errors with them, honest noise."""

import numpy as np
import pytest

from schemas.errors import ScenarioError
from schemas.messages import TruthCarriers
from sim_world.ranging import Measured, RangingDevice, ranging_error
from sim_world.scenario import Scenario
from sim_world.scenario.declared import beacon_error, beacon_place_m
from sim_world.scenario.file import ScenarioFile
from sim_world.world import World
from tests.sim_world.scenes import Tree, carrier, scenario

NORTH: Tree = {"name": "north", "east_m": 1_000.0, "north_m": 9_000.0, "altitude_m": 500.0}
WEST: Tree = {"name": "west", "east_m": -7_000.0, "north_m": 500.0, "sigma_position_m": 50.0}
HOUR: Tree = {"duration_s": 3600.0, "step_s": 1.0}


def ranging(**keys: object) -> Tree:
    return {"to": ["north", "west", "other"], "sigma_m": 5.0, **keys}


def made(*devices: Tree, **tables: object) -> Scenario:
    own = carrier("own", ranging=list(devices))  # type: ignore[arg-type]
    other = carrier("other", ranging=tables.pop("others", []))  # type: ignore[arg-type]
    return scenario([own, other], beacons=[NORTH, WEST], time=HOUR, **tables)


def device(of: Scenario, number: int = 0) -> RangingDevice:
    return RangingDevice(of.file, "own", of.file.carriers[0].ranging[number])


def measured(of: Scenario, steps: range = range(1, 201)) -> list[list[Measured]]:
    world, taken = World(of), device(of)
    return [
        taken.measure(look, step, world.step(step)[1]) for step in steps for look in taken.due(step)
    ]


def distances_m(of: Scenario, *steps: int) -> list[list[float]]:
    """True distances from `own` to north, west and the other carrier, at each step."""
    world = World(of)
    return [_distances_m(of, world.step(step)[1]) for step in steps]


def _distances_m(of: Scenario, truth: TruthCarriers) -> list[float]:
    places = [beacon_place_m(of.file, beacon) for beacon in of.file.beacons]
    peers = [*places, np.array(truth.position_m[1])]
    return [float(np.linalg.norm(place - truth.position_m[0])) for place in peers]


def test_ranges_are_true_distances_with_noise_of_the_declared_sigma() -> None:
    of = made(ranging())
    errors = [
        one.value_m - true
        for look, distances in zip(measured(of), distances_m(of, *range(1, 201)), strict=True)
        for one, true in zip(look, distances, strict=True)
    ]
    assert abs(np.mean(errors)) < 4 * 5 / np.sqrt(len(errors))
    assert np.std(errors) == pytest.approx(5.0, abs=4 * 5 / np.sqrt(2 * len(errors)))


def test_bias_and_scale_enter_as_declared() -> None:
    plain = made(ranging())
    wrong = made(ranging(errors={"range_bias_m": 12.0, "range_scale": 0.065}))
    for before, after, true in zip(
        measured(plain)[9], measured(wrong)[9], *distances_m(plain, 10), strict=True
    ):
        assert after.value_m - before.value_m == pytest.approx(12.0 + 0.065 * true)


def test_errors_are_drawn_from_their_sigmas_and_off_where_disabled() -> None:
    table = ranging(kind="pseudorange", sigma_range_scale=0.05, sigma_clock_m=300.0)
    drawn = np.array([_error(made(table, seed=seed).file) for seed in range(300)])
    assert np.std(drawn[:, [1, 2]], axis=0) == pytest.approx([0.05, 300.0], rel=0.17)  # 4 sigma
    assert not np.any(_error(made(table, errors={"enabled": False}).file))


def _error(file: ScenarioFile) -> tuple[float, ...]:
    return ranging_error(file, "own", file.carriers[0].ranging[0])


def test_a_pseudorange_holds_the_receivers_clock_less_the_senders() -> None:
    own: Tree = {"errors": {"clock_m": 100.0, "clock_drift_mps": 0.5}}
    other: Tree = {"errors": {"clock_m": 30.0, "clock_drift_mps": 0.0}}
    both = [ranging(kind="pseudorange", to=["own"], **other)]
    clocked = measured(made(ranging(kind="pseudorange", **own), others=both))[39]
    right = measured(made(ranging(kind="pseudorange"), others=[]))[39]
    shown = [a.value_m - b.value_m for a, b in zip(clocked, right, strict=True)]
    assert shown == pytest.approx([120.0, 120.0, 90.0])  # a beacon's clock is right


def test_a_difference_is_that_of_two_ranges_and_has_the_noise_of_both() -> None:
    of = made(ranging(kind="difference"))
    looks = measured(of)
    assert {(one.peer, one.reference) for one in looks[0]} == {
        ("west", "north"),
        ("other", "north"),
    }
    assert looks[0][0].sigma_m == pytest.approx(5 * 2**0.5)
    errors = [
        one.value_m - (true - to_reference)
        for look, (to_reference, *others) in zip(
            looks, distances_m(of, *range(1, 201)), strict=True
        )
        for one, true in zip(look, others, strict=True)
    ]
    assert np.std(errors) == pytest.approx(5 * 2**0.5, abs=4 * 7 / np.sqrt(len(errors)))


def test_without_its_reference_there_is_no_difference() -> None:
    deaf = made(ranging(kind="difference", range_max_m=8_500.0, to=["north", "west"]))
    assert distances_m(deaf, 1)[0][0] > 8_500.0
    assert measured(deaf, range(1, 3)) == [[], []]


def test_a_peer_out_of_range_is_not_heard() -> None:
    near = measured(made(ranging(range_max_m=9_800.0, to=["other", "west"])), range(1, 3))
    assert [[one.peer for one in look] for look in near] == [["other", "west"]] * 2
    assert measured(made(ranging(range_max_m=0.5, to=["west"])), range(1, 3)) == [[], []]


def test_reflections_lengthen_the_declared_share() -> None:
    quiet, gross = made(ranging()), made(ranging(outlier_share=0.2, outlier_m=[30.0, 300.0]))
    pairs = zip(measured(quiet), measured(gross), strict=True)
    added = np.array(
        [
            b.value_m - a.value_m
            for first, second in pairs
            for a, b in zip(first, second, strict=True)
        ]
    )
    share = np.mean(added > 0)
    assert share == pytest.approx(0.2, abs=4 * np.sqrt(0.16 / len(added)))
    assert 30 <= added[added > 0].min() <= added.max() <= 300


def test_another_peer_moves_no_noise() -> None:
    few, more = measured(made(ranging(to=["west"]))), measured(made(ranging(to=["north", "west"])))
    assert [look[0] for look in few] == [look[1] for look in more]


def test_ranges_come_at_their_period() -> None:
    of = made(ranging(period_s=2.0, phase_s=0.5))
    due = [(step, look) for step in range(1, 8) for look in device(of).due(step)]
    times = [step + look.after_step_ns * 1e-9 for step, look in due]
    assert times == pytest.approx([0.5, 2.5, 4.5, 6.5])


def test_a_declared_beacon_is_off_by_its_error() -> None:
    drawn = [
        beacon_error(file, file.beacons[1])
        for file in (made(ranging(), seed=seed).file for seed in range(300))
    ]
    assert np.std(np.array(drawn)[:, :2]) == pytest.approx(50.0, rel=0.12)  # 4 sigma
    assert not np.array(drawn)[:, 2].any()
    declared = made(ranging(), errors={"enabled": False}).declared.beacons[0]
    assert declared.altitude_m == pytest.approx(500.0, abs=1e-2)  # the surface is a series


@pytest.mark.parametrize(
    ("keys", "where", "what"),
    [
        ({"to": ["nort"]}, "to", "north"),
        ({"to": ["own"]}, "to", "no beacon or other carrier"),
        ({"to": ["west", "west"]}, "to", "given twice"),
        ({"to": ["west"], "kind": "difference"}, "to", "no difference"),
        ({"sigma_clock_m": 3.0}, "sigma_clock_m", "no clock"),
        ({"outlier_m": [3.0, 1.0]}, "outlier_m", "upside down"),
    ],
)
def test_contradictions_are_refused(keys: Tree, where: str, what: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        made(ranging(**keys))
    assert f"ranging.0.{where}" in str(refused.value) or f".{where}" in str(refused.value)
    assert what in str(refused.value)
