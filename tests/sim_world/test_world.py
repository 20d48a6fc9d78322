"""Laws of the world: a function of scenario and step, and nobody moves anybody else's truth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas import codec
from schemas.messages import TruthTargets
from sim_world.scenario import Scenario, with_overrides
from sim_world.world import World
from tests.sim_world.scenes import Tree, carrier, scenario, target

GROUP: Tree = {
    "name": "many", "count": 30, "box_m": [-2e4, 2e4, -1e4, 1e4], "speed_mps": [2.0, 15.0],
    "motions": {"constant_velocity": 1.0, "coordinated_turn": 1.0}, "identity_share": 0.5,
    "classes": {"cargo": 3.0, "yacht": 1.0},
}  # fmt: skip
CLASSES = [
    {"name": "cargo", "features": {"length_m": [150.0, 20.0], "height_m": [30.0, 0.0]}},
    {"name": "yacht", "features": {"length_m": [15.0, 2.0], "height_m": [20.0, 5.0]}},
]


def crowd(**keys: object) -> Scenario:
    return scenario(targets=[], target_groups=[GROUP | keys], classes=CLASSES)


def rows(truth: TruthTargets) -> dict[int, tuple[object, ...]]:
    """Everything that is said of each target, by its number."""
    columns = (
        truth.position_m, truth.velocity_mps, truth.acceleration_mps2, truth.classes,
        truth.identity, *truth.features.values(),
    )  # fmt: skip
    return {number: values for number, *values in zip(truth.number, *columns, strict=True)}


def assert_same_targets(
    one: dict[int, tuple[object, ...]], other: dict[int, tuple[object, ...]]
) -> None:
    """But for rounding: matrix products of more rows may end in another last bit."""
    assert one.keys() == other.keys()
    for number, values in one.items():
        for value, expected in zip(values, other[number], strict=True):
            exact = isinstance(expected, str)
            assert value == (expected if exact else pytest.approx(expected, rel=1e-12, abs=1e-9))


def test_the_same_seed_gives_the_same_bytes_in_any_order_of_asking() -> None:
    one, other = World(crowd()), World(crowd())
    steps = [*range(61)]
    first = {k: [codec.encode(m) for m in one.step(k)] for k in steps}
    second = {k: [codec.encode(m) for m in other.step(k)] for k in reversed(steps)}
    assert first == second


def test_another_seed_gives_another_world() -> None:
    one, other = World(crowd()), World(with_overrides(crowd(), {"seed": 8}))
    assert one.step(1)[0].position_m != other.step(1)[0].position_m


def test_messages_say_their_step_and_survive_the_wire() -> None:
    made = crowd()
    world = World(made, boot="b7")
    for message in world.step(60):
        assert (message.boot, message.seq, message.step) == ("b7", 60, 60)
        assert message.t_ns == made.declared.epoch_ns + 60_000_000_000
        assert codec.decode(type(message), codec.encode(message)) == message


def test_more_targets_change_none_that_were_there() -> None:
    small, large = World(crowd()), World(crowd(count=60))
    for step in (1, 40):
        before, after = rows(small.step(step)[0]), rows(large.step(step)[0])
        assert_same_targets({number: after[number] for number in before}, before)
        assert len(after) == 60


def test_a_target_less_changes_none_of_the_others() -> None:
    three = scenario(targets=[target("a"), target("b", speed_mps=3.0), target("c", east_m=0.0)])
    two = with_overrides(three, {"targets": three.tree["targets"][::2]})
    before, after = (rows(World(s).step(9)[0]) for s in (three, two))
    assert len(before) == 3
    assert len(after) == 2
    assert_same_targets({number: before[number] for number in after}, after)


def test_targets_are_there_from_start_to_end() -> None:
    lives = [target("a"), target("b", start_s=10.0), target("c", end_s=20.0)]
    world = World(scenario(targets=lives))
    seen = {k: world.step(k)[0].identity for k in (1, 9, 10, 20, 21)}
    assert seen == {
        1: ["a", "c"], 9: ["a", "c"], 10: ["a", "b", "c"], 20: ["a", "b", "c"], 21: ["a", "b"],
    }  # fmt: skip
    born = world.step(10)[0]
    assert born.position_m[1][:2] == [9_000.0, 4_000.0]  # a motion begins with its target


def test_a_group_is_drawn_as_it_is_told() -> None:
    truth = World(crowd(count=2000)).step(0)[0]
    place, speed = np.array(truth.position_m), np.linalg.norm(truth.velocity_mps, axis=1)
    assert np.all(np.abs(place[:, :2]) <= [2e4, 1e4])
    assert np.allclose(place[:, :2].std(axis=0) / [2e4, 1e4], 1 / np.sqrt(3), rtol=0.06)
    assert 2 - 1e-6 <= speed.min() < 2.1
    assert 14.9 < speed.max() <= 15 + 1e-3
    assert abs(np.mean([c == "cargo" for c in truth.classes]) - 0.75) < 5 * np.sqrt(0.1875 / 2000)
    assert abs(np.mean([bool(i) for i in truth.identity]) - 0.5) < 5 * np.sqrt(0.25 / 2000)
    turning = np.linalg.norm(np.array(truth.acceleration_mps2)[:, :2], axis=1) > 1e-6
    assert abs(turning.mean() - 0.5) < 5 * np.sqrt(0.25 / 2000)
    length = np.array(truth.features["length_m"])[[c == "cargo" for c in truth.classes]]
    assert abs(length.mean() - 150) < 5 * 20 / np.sqrt(len(length))
    height = np.array(truth.features["height_m"])[[c == "cargo" for c in truth.classes]]
    assert np.all(height == 30)


def test_a_feature_of_its_own_is_not_drawn() -> None:
    own = target("a", features={"length_m": 7.5}) | {"class": "yacht"}
    truth = World(scenario(targets=[own], classes=CLASSES)).step(1)[0]
    assert truth.features["length_m"] == [7.5]
    assert truth.features["height_m"] != [20.0]


@given(st.integers(0, 60))
def test_known_frames_are_exact_and_move_as_ever(step: int) -> None:
    erring = scenario([carrier("a"), carrier("b", errors={"clock_s": 0.1})])
    exact = with_overrides(erring, {"errors.enabled": False})
    (targets, carriers), (same, known) = World(erring).step(step), World(exact).step(step)
    assert same == targets
    assert known.position_m == carriers.position_m
    assert known.heading_rad == carriers.heading_rad
    assert known.north_error_rad == known.clock_offset_s == [0.0, 0.0]
    assert all(carriers.north_error_rad)
    assert carriers.clock_offset_s == [0.0, 0.1]


def test_numbers_are_small_enough_to_count_with() -> None:
    numbers = World(crowd(count=2000)).step(0)[0].number
    assert len(set(numbers)) == 2000
    assert min(numbers) >= 0
    assert max(numbers) < 2**32


def test_a_world_without_targets_says_so() -> None:
    assert World(scenario(targets=[])).step(1)[0].number == []
