"""Laws of sensors: what is measured is the geometry plus what is declared, and nothing else."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from estimation.frames import Site, site_at, target_from_source
from schemas.messages import TruthCarriers, TruthTargets
from sim_world.logs import Logs
from sim_world.scenario import Scenario
from sim_world.scenario.declared import origin_of
from sim_world.scene import stand_of, targets_of
from sim_world.schedule import Look
from sim_world.sensors import Sensor, systematic_errors
from sim_world.world import World
from tests.sim_world.scenes import Tree, carrier, radar, scenario, target

SHARP: Tree = {"sigma_bearing_deg": 1e-9, "sigma_range_m": 1e-6}
GROUP: Tree = {
    "name": "many", "count": 400, "box_m": [-2e4, 2e4, -2e4, 2e4], "speed_mps": [0.0, 15.0],
}  # fmt: skip


class Scene(NamedTuple):
    """A sensor at one step of a world."""

    scenario: Scenario
    sensor: Sensor
    truth: tuple[TruthTargets, TruthCarriers]

    def observe(self, look: Look | None = None) -> Logs:
        targets, carriers = self.truth
        stand = stand_of(carriers, "own", origin_of(self.scenario.file))
        return self.sensor.observe(look or Look(3, 0), stand, targets_of(targets))


def scene(step: int = 3, *, enabled: bool = True, **tables: Any) -> Scene:
    """What the own carrier's radar has before it; tables of the file may be given."""
    keys = tables.pop("radar", {})
    own = carrier("own", radar(**keys), **tables.pop("own", {}))
    made = scenario([own, *tables.pop("others", [])], errors={"enabled": enabled}, **tables)
    sensor = Sensor(made.file, "own", made.file.carriers[0].sensors[0])
    return Scene(made, sensor, World(made).step(step))


def geometry(site: Site, origin: Site, place_m: list[float]) -> tuple[float, float, float]:
    """True bearing, range and elevation, by way of the frames alone."""
    east, north, up = target_from_source(site, origin).apply(place_m)
    level = math.hypot(east, north)
    return math.atan2(east, north) % (2 * math.pi), math.hypot(level, up), math.atan2(up, level)


@pytest.mark.parametrize("altitude_m", [0.0, 3000.0])
def test_measured_is_geometry_less_the_error_of_north(altitude_m: float) -> None:
    sharp = SHARP | {"sigma_elevation_deg": 1e-9}
    far = [target("far", east_m=4e4, north_m=-2e4, altitude_m=altitude_m)]
    seen = scene(radar=sharp, own={"errors": {"north_deg": 7.0}}, targets=far)
    logs = seen.observe()
    targets, carriers = seen.truth
    origin = origin_of(seen.scenario.file)
    here = site_at(origin, carriers.position_m[0])
    bearing, slant, elevation = geometry(here, origin, targets.position_m[0])
    assert logs.bearing_rad[0] == pytest.approx(bearing - math.radians(7), abs=1e-9)
    assert logs.range_m[0] == pytest.approx(slant, abs=1e-4)
    assert logs.elevation_rad[0] == pytest.approx(elevation, abs=1e-9)


def test_systematic_errors_enter_as_declared() -> None:
    errors = {"range_bias_m": 50.0, "range_scale": 0.01, "azimuth_bias_deg": 2.0}
    keys = SHARP | {"errors": errors}
    biased, plain = scene(radar=keys).observe(), scene(radar=SHARP).observe()
    assert np.allclose(biased.bearing_rad - plain.bearing_rad, math.radians(2), atol=1e-9)
    assert np.allclose(biased.range_m, plain.range_m * 1.01 + 50, atol=1e-4)
    known = scene(radar=keys, enabled=False)
    assert known.sensor.errors == (0.0, 0.0, 0.0, 0.0)


def test_systematic_errors_are_drawn_from_their_sigmas() -> None:
    sigmas = {"sigma_range_bias_m": 20.0, "sigma_range_scale": 0.01,
              "sigma_azimuth_bias_deg": 0.5, "sigma_clock_s": 0.1}  # fmt: skip
    made = scene(radar=sigmas).scenario
    drawn = []
    for seed in range(1500):
        file = replace(made.file, seed=seed)
        drawn.append(systematic_errors(file, "own", file.carriers[0].sensors[0]))
    ratio = np.std(drawn, axis=0) / [20, 0.01, math.radians(0.5), 0.1]
    assert np.all(np.abs(ratio - 1) < 5 / math.sqrt(2 * 1500))


@given(st.floats(-2.0, 0.0))
def test_between_steps_both_ends_are_extrapolated(dt: float) -> None:
    turn = {"kind": "coordinated_turn", "turn_rate_deg_s": 1.0}
    seen = scene(radar=SHARP, targets=[target("ada", **turn)], own={"errors": {"north_deg": 0.0}})
    after_ns = round(dt * 1e9)
    logs = seen.observe(Look(3, after_ns))
    targets, carriers = seen.truth

    def then(truth: TruthTargets | TruthCarriers) -> np.ndarray:
        p, v, a = (
            np.array(x[0]) for x in (truth.position_m, truth.velocity_mps, truth.acceleration_mps2)
        )
        return p + v * after_ns * 1e-9 + a * (after_ns * 1e-9) ** 2 / 2

    origin = origin_of(seen.scenario.file)
    bearing, slant, _ = geometry(site_at(origin, then(carriers)), origin, then(targets).tolist())
    assert logs.bearing_rad[0] == pytest.approx(bearing, abs=1e-9)
    assert logs.range_m[0] == pytest.approx(slant, abs=1e-4)


def test_extrapolated_reports_agree_with_the_truth_of_finer_steps() -> None:
    turn = {"kind": "coordinated_turn", "turn_rate_deg_s": 1.0}
    coarse, fine = (
        scene(
            step,
            radar=SHARP,
            targets=[target("ada", **turn)],
            time={"duration_s": 60.0, "step_s": step_s},
        )
        for step, step_s in ((3, 1.0), (10, 0.25))
    )
    early = coarse.observe(Look(3, -500_000_000))
    exact = fine.observe(Look(3, 0))
    assert early.range_m[0] == pytest.approx(exact.range_m[0], abs=1e-2)  # jerk of the turn
    assert early.bearing_rad[0] == pytest.approx(exact.bearing_rad[0], abs=1e-6)


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({}, {1: [(1, 0)], 2: [(2, 0)]}),
        ({"phase_s": 0.4}, {1: [(0, -6e8)], 2: [(1, -6e8)]}),
        ({"period_s": 2.5}, {1: [], 2: [], 3: [(1, -5e8)], 5: [(2, 0)]}),
        ({"period_s": 0.4}, {1: [(1, -6e8), (2, -2e8)], 2: [(3, -8e8), (4, -4e8), (5, 0)]}),
        ({"period_s": 10, "phase_s": 12.5}, {3: [], 12: [], 13: [(0, -5e8)], 23: [(1, -5e8)]}),
    ],
)
def test_reports_are_due_after_the_step_before_up_to_this_one(
    keys: Tree, expected: dict[int, list[tuple[int, float]]]
) -> None:
    sensor = scene(radar=keys).sensor
    assert {step: sensor.due(step) for step in expected} == expected


@given(st.floats(0.05, 7), st.floats(0, 9), st.floats(0.1, 3))
def test_every_report_is_due_once(period_s: float, phase_s: float, step_s: float) -> None:
    seen = scene(
        1,
        radar={"period_s": period_s, "phase_s": phase_s},
        time={"duration_s": 60.0, "step_s": step_s},
    )
    looks = [look for step in range(1, 12) for look in seen.sensor.due(step)]
    numbers = [look.number for look in looks]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))) if numbers else True
    end_ns, period_ns, phase_ns = (round(t * 1e9) for t in (step_s, period_s, phase_s))
    instants = [n for n in range(11 * end_ns // period_ns + 2) if phase_ns + n * period_ns > 0]
    assert numbers == [n for n in instants if phase_ns + n * period_ns <= 11 * end_ns]


def test_noise_has_the_declared_sigmas() -> None:
    keys = {"sigma_elevation_deg": 0.2}
    noisy = scene(radar=keys, targets=[], target_groups=[GROUP])
    calm = scene(
        radar=SHARP | {"sigma_elevation_deg": 1e-9}, targets=[], target_groups=[GROUP]
    ).observe()
    by_name = {name: n for n, name in enumerate(calm.identity)}
    errors = []
    for number in range(20):
        logs = noisy.observe(Look(number, 0))
        order = [by_name[name] for name in logs.identity]
        turned = logs.bearing_rad - calm.bearing_rad[order]
        errors.append(
            np.stack(
                [
                    (turned + np.pi) % (2 * np.pi) - np.pi,
                    logs.range_m - calm.range_m[order],
                    logs.elevation_rad - calm.elevation_rad[order],
                ]
            )
        )
    sample = np.concatenate(errors, axis=1)
    n = sample.shape[1]
    assert n == 8000
    ratio = sample.std(axis=1) / [math.radians(0.3), 30, math.radians(0.2)]
    assert np.all(np.abs(ratio - 1) < 5 / math.sqrt(2 * n))
    assert np.all(np.abs(sample.mean(axis=1) / sample.std(axis=1)) < 5 / math.sqrt(n))
    assert np.all(np.abs(np.corrcoef(sample) - np.eye(3)) < 5 / math.sqrt(n))


def test_detection_probability_is_the_share_detected() -> None:
    seen = scene(radar={"detection_probability": 0.7}, targets=[], target_groups=[GROUP])
    counts = [len(seen.observe(Look(n, 0)).bearing_rad) for n in range(25)]
    share, n = sum(counts) / (25 * 400), 25 * 400
    assert abs(share - 0.7) < 5 * math.sqrt(0.21 / n)


def test_false_alarms_are_poisson_and_uniform_over_the_area() -> None:
    keys = {
        "clutter_per_scan": 20.0, "range_min_m": 1e4, "range_max_m": 3e4,
        "sector_deg": [300.0, 120.0],
    }  # fmt: skip
    seen = scene(radar=keys, targets=[])
    looks = [seen.observe(Look(n, 0)) for n in range(400)]
    counts = np.array([len(logs.bearing_rad) for logs in looks])
    assert abs(counts.mean() - 20) < 5 * math.sqrt(20 / 400)
    assert abs(counts.var() / 20 - 1) < 5 * math.sqrt(2 / 400)
    slant = np.concatenate([logs.range_m for logs in looks])
    bearing = np.degrees(np.concatenate([logs.bearing_rad for logs in looks]))
    area = (slant**2 - 1e8) / (9e8 - 1e8)
    turn = (bearing - 300) % 360 / 120
    for uniform in (area, turn):
        assert uniform.min() >= 0
        assert uniform.max() <= 1
        counts, _ = np.histogram(uniform, bins=20, range=(0, 1))
        mean = len(uniform) / 20
        assert abs(((counts - mean) ** 2).sum() / mean - 19) < 5 * math.sqrt(2 * 19)


@given(st.floats(-360, 360), st.floats(10, 360), st.floats(0, 1e4), st.floats(1.1e4, 3e4))
def test_only_targets_in_range_and_sector_are_seen(
    start_deg: float, width_deg: float, least_m: float, most_m: float
) -> None:
    limits = {
        "sector_deg": [start_deg, width_deg], "range_min_m": least_m, "range_max_m": most_m,
    }  # fmt: skip
    group = [GROUP | {"count": 60}]
    all_of_them = scene(radar=SHARP, targets=[], target_groups=group).observe()
    seen = scene(radar=SHARP | limits, targets=[], target_groups=group).observe()
    turn = np.mod(all_of_them.bearing_rad - math.radians(start_deg), 2 * np.pi)
    inside = (turn <= math.radians(width_deg)) & (least_m <= all_of_them.range_m)
    inside &= all_of_them.range_m <= most_m
    assert list(seen.identity) == list(all_of_them.identity[inside])


def test_a_bearing_only_sensor_tells_no_ranges() -> None:
    own = carrier("own", {"name": "eye", "coordinates": "bearing", "sigma_bearing_deg": 1.0})
    made = scenario([own])
    sensor = Sensor(made.file, "own", made.file.carriers[0].sensors[0])
    logs = Scene(made, sensor, World(made).step(1)).observe()
    assert logs.range_m is None
    assert logs.identity is None
    assert len(logs.bearing_rad) == 2


def test_a_rotating_antenna_says_when_it_passed_each_target() -> None:
    fast = [target("a", speed_mps=300.0), target("b", east_m=-9e3, speed_mps=300.0)]
    keys = SHARP | {"rotating": True, "period_s": 4.0}
    seen = scene(8, radar=keys, targets=fast, own={"errors": {"north_deg": 0.0}})
    logs = seen.observe(Look(2, 0))
    turn = logs.bearing_rad / (2 * np.pi)
    assert np.allclose(logs.time_offset_s, 4 * (turn - 1), atol=0.3)  # it moved meanwhile
    assert np.all((logs.time_offset_s >= -4) & (logs.time_offset_s <= 0))
    still = scene(8, radar=SHARP, targets=fast, own={"errors": {"north_deg": 0.0}})
    for name, offset in zip(logs.identity, logs.time_offset_s, strict=True):
        then = still.observe(Look(2, round(offset * 1e9)))
        n, m = list(then.identity).index(name), list(logs.identity).index(name)
        assert logs.range_m[m] == pytest.approx(then.range_m[n], abs=1e-2)


def test_identities_are_read_in_their_share_and_always_the_same() -> None:
    seen = scene(radar={"identity_share": 0.6}, targets=[], target_groups=[GROUP])
    read = [{name for name in seen.observe(Look(n, 0)).identity if name} for n in range(3)]
    assert read[0] == read[1] == read[2]
    assert abs(len(read[0]) / 400 - 0.6) < 5 * math.sqrt(0.24 / 400)


def test_classes_are_confused_as_declared() -> None:
    classes = [{"name": name} for name in ("cargo", "ferry", "yacht")]
    group = GROUP | {"classes": {"ferry": 1.0}}
    seen = scene(
        radar={"classes": {"accuracy": 0.7}}, targets=[], target_groups=[group], classes=classes
    )
    info = seen.sensor.declared.features["class"]
    assert info.categories == ["cargo", "ferry", "yacht"]
    assert np.allclose(np.sum(info.confusion, axis=1), 1)
    told = np.concatenate([seen.observe(Look(n, 0)).classes for n in range(20)])
    for name, probability in zip(info.categories, info.confusion[1], strict=True):
        sigma = math.sqrt(probability * (1 - probability) / len(told))
        assert abs(np.mean(told == name) - probability) < 5 * sigma


def test_features_are_measured_with_their_sigma() -> None:
    classes = [{"name": "cargo", "features": {"length_m": [150.0, 20.0]}}]
    feature = {"name": "length_m", "unit": "m", "sigma": 4.0, "population": [5.0, 400.0]}
    seen = scene(
        radar={"features": [feature], "clutter_per_scan": 5.0},
        targets=[],
        target_groups=[GROUP | {"classes": {"cargo": 1.0}}],
        classes=classes,
    )
    true = dict(zip(seen.truth[0].identity, seen.truth[0].features["length_m"], strict=True))
    assert np.std(list(true.values())) == pytest.approx(20, rel=5 / math.sqrt(800))
    errors, false = [], []
    for n in range(10):
        logs = seen.observe(Look(n, 0))
        for name, length in zip(logs.identity, logs.features["length_m"], strict=True):
            if name:
                errors.append(length - true[name])
            else:
                false.append(length)
    assert np.std(errors) == pytest.approx(4, rel=5 / math.sqrt(2 * 4000))
    assert 5 <= min(false) < max(false) <= 400


def test_a_nearer_target_hides_one_behind_it() -> None:
    pair = [target("near", east_m=1e4, north_m=0.0), target("far", east_m=1.004e4, north_m=0.0)]
    apart = scene(radar=SHARP, targets=pair).observe()
    assert set(apart.identity) == {"near", "far"}
    for resolution_m, seen in ((100.0, {"near"}), (10.0, {"near", "far"})):
        coarse = {"resolution_bearing_deg": 1.0, "resolution_range_m": resolution_m}
        assert set(scene(radar=SHARP | coarse, targets=pair).observe().identity) == seen


def test_logs_come_in_order_of_bearing() -> None:
    seen = scene(radar={"clutter_per_scan": 50.0}, targets=[], target_groups=[GROUP])
    assert np.all(np.diff(seen.observe().bearing_rad) >= 0)
