"""Laws of a carrier: it says what it believes, by its own clock and north, without a hole."""

import math
import time
from typing import Any

import numpy as np
import pytest

from carriers.carrier import LIGHT_MPS, Carrier, Outgoing, Stamp
from estimation.frames import Site, enu_from_geodetic, site_at
from schemas import codec, keys
from schemas.errors import ScenarioError
from schemas.messages import Navigation, Ranging, SourceInfo, SourceReport
from sim_world.scenario import Scenario, with_overrides
from sim_world.scenario.declared import origin_of
from sim_world.world import World
from tests.sim_world.scenes import Tree, carrier, radar, scenario, target

TURN_RAD = 2 * math.pi
LOOP: Tree = {
    "kind": "waypoints", "points_m": [[0.0, 0.0], [6e3, 0.0], [6e3, 5e3]], "speed_mps": 12.0,
    "closed": True,
}  # fmt: skip
PRIOR: Tree = {
    "sigma_position_m": 1500.0, "sigma_north_deg": 1.0, "sigma_north_drift_deg_per_sqrt_h": 0.5,
    "sigma_speed_mps": 0.2, "sigma_current_mps": 0.3, "sigma_clock_s": 0.05,
}  # fmt: skip


def said(made: Scenario, name: str = "own", steps: range = range(1, 31)) -> list[Outgoing]:
    """Everything a carrier says in some steps, in one life."""
    world, teller, stamp = World(made), Carrier(made, name), Stamp("b1")
    return [out for k in steps for out in teller.step(*world.step(k), stamp)]


def payloads(outgoing: list[Outgoing]) -> list[bytes]:
    return [codec.encode(out.message) for out in outgoing]


def of(kind: type[Any], outgoing: list[Outgoing]) -> list[Any]:
    return [out.message for out in outgoing if isinstance(out.message, kind)]


def full(**tables: Any) -> Scenario:
    own = carrier(
        "own",
        radar(clutter_per_scan=3.0, phase_s=0.4, detection_probability=0.8),
        {"name": "eye", "coordinates": "bearing", "sigma_bearing_deg": 1.0, "period_s": 2.0},
        motion=LOOP,
        navigation=PRIOR,
    )
    return scenario([own, *tables.pop("others", [])], **tables)


def test_the_same_seed_gives_the_same_bytes() -> None:
    assert payloads(said(full())) == payloads(said(full()))
    assert payloads(said(full())) != payloads(said(with_overrides(full(), {"seed": 8})))


def test_every_message_travels_and_fits_its_key() -> None:
    for topic, ids, message in said(full()):
        assert codec.decode(topic.message, codec.encode(message)) == message
        address = keys.parse(topic.key("run", *ids))
        assert keys.stream(address) == message.stream
        assert address.ids["carrier"] == message.carrier


def test_streams_have_no_hole_and_the_manifest_says_how_far_they_came() -> None:
    made = full()
    world, teller, stamp = World(made), Carrier(made, "own"), Stamp("b1")
    seqs: dict[str, list[int]] = {}
    for k in range(5, 20):
        for out in teller.step(*world.step(k), stamp):
            assert out.message.boot == "b1"
            assert out.message.step == k
            seqs.setdefault(out.message.stream, []).append(out.message.seq)
        ends = {end.stream: end.last_seq for end in stamp.manifest("own")}
        assert ends == {stream: seq[-1] for stream, seq in seqs.items()}
    assert set(seqs) == {"info", "navigation", "radar", "eye"}
    assert all(seq == list(range(1, len(seq) + 1)) for seq in seqs.values())
    assert len(seqs["info"]) == 2  # sources are told once a life


def test_a_new_life_tells_its_sources_again_and_reckons_from_there() -> None:
    made = full()
    world, teller = World(made), Carrier(made, "own")
    first, second = Stamp("b1"), Stamp("b2")
    for k in range(1, 11):
        old = list(teller.step(*world.step(k), first))
    new = [out for k in (10, 11) for out in teller.step(*world.step(k), second)]
    assert len(of(SourceInfo, new)) == 2
    began, went_on = of(Navigation, new)
    assert (began.seq, began.reckoned_east_m, began.reckoned_north_m) == (1, 0.0, 0.0)
    assert math.hypot(went_on.reckoned_east_m, went_on.reckoned_north_m) == pytest.approx(12, abs=2)
    assert began.pose == of(Navigation, old)[0].pose
    assert [r.bearing_rad for r in of(SourceReport, new)][:2] == [
        r.bearing_rad for r in of(SourceReport, old)
    ]


def test_sources_declare_what_the_scenario_does() -> None:
    made = full()
    told = {info.source: info.properties for info in of(SourceInfo, said(made, steps=range(1, 2)))}
    assert told == made.declared.carriers[0].sources


def reports_of(made: Scenario, name: str = "own") -> list[dict[str, tuple[float, float]]]:
    """Of each radar report, bearing and range by identity."""
    reports = [m for m in of(SourceReport, said(made, name)) if m.stream == "radar"]
    assert any(report.identity for report in reports)
    return [
        {
            identity: (bearing, slant)
            for identity, bearing, slant in zip(
                m.identity or (), m.bearing_rad or (), m.range_m or (), strict=False
            )
            if identity
        }
        for m in reports
    ]


def assert_same_logs(
    one: dict[str, tuple[float, float]], other: dict[str, tuple[float, float]]
) -> None:
    """But for rounding: matrix products of more rows may end in another last bit."""
    assert one.keys() == other.keys()
    for name, log in one.items():
        assert log == pytest.approx(other[name], rel=1e-12)


def test_another_carrier_or_target_moves_no_noise() -> None:
    before = full()
    others = [carrier("aaa"), carrier("zzz")]
    crowd = [target("new", east_m=0.0), *before.tree["targets"], target("newer", east_m=1.0)]
    alone = reports_of(before)
    assert payloads(said(full(others=others))) == payloads(said(before))
    crowded = reports_of(with_overrides(before, {"targets": crowd}))
    for seen, among in zip(alone, crowded, strict=True):
        assert_same_logs({name: among[name] for name in seen}, seen)
    fewer = reports_of(with_overrides(before, {"targets": before.tree["targets"][1:]}))
    for seen, left in zip(alone, fewer, strict=True):
        assert_same_logs(left, {name: log for name, log in seen.items() if name != "ada"})


def test_another_sensor_moves_no_noise() -> None:
    before = full()
    sensors = [radar(name="second"), *before.tree["carriers"][0]["sensors"]]
    after = with_overrides(before, {"carriers.own.sensors": sensors})
    assert reports_of(after) == reports_of(before)


def test_with_known_frames_what_is_said_is_true() -> None:
    made = with_overrides(full(), {"errors.enabled": False})
    world, origin = World(made), origin_of(made.file)
    for message in of(Navigation, said(made)):
        _, truth = world.step(message.step)
        site = site_at(origin, truth.position_m[0])
        assert (message.pose.latitude_rad, message.pose.longitude_rad) == site[:2]
        assert message.pose.heading_rad == pytest.approx(truth.heading_rad[0], abs=1e-12)
        assert message.t_ns == truth.t_ns


def test_known_frames_change_the_noise_of_no_log() -> None:
    erring = full()
    exact = with_overrides(erring, {"errors.enabled": False})
    norths = [World(erring).step(k)[1].north_error_rad[0] for k in range(1, 31)]
    for seen, true, north in zip(reports_of(erring), reports_of(exact), norths, strict=True):
        assert seen.keys() == true.keys()
        for name, (bearing, slant) in seen.items():
            assert slant == pytest.approx(true[name][1], abs=1e-6)
            turned = (bearing + north - true[name][0]) % TURN_RAD
            assert min(turned, TURN_RAD - turned) < 1e-12


def test_the_reported_place_is_off_by_the_given_error() -> None:
    errors = {"position_east_m": 800.0, "position_north_m": -600.0, "north_deg": 2.0}
    prior = {"sigma_position_m": 1500.0, "sigma_north_deg": 1.0}
    made = scenario([carrier("own", errors=errors, navigation=prior)])
    message = of(Navigation, said(made, steps=range(1, 2)))[0]
    _, truth = World(made).step(0)
    start = site_at(origin_of(made.file), truth.position_m[0])
    reported = Site(message.pose.latitude_rad, message.pose.longitude_rad)
    east, north, _ = enu_from_geodetic(start, *reported[:2], start.altitude_m)
    way_m = 8 / math.sqrt(2)  # of the first second
    assert (east, north) == pytest.approx((800 + way_m, -600 + way_m), abs=0.4)
    assert message.pose.heading_rad == pytest.approx(math.radians(45 - 2), abs=1e-3)
    assert message.pose.altitude_m == pytest.approx(20, abs=1e-3)


def test_the_pose_moves_as_reckoned() -> None:
    messages = of(Navigation, said(full()))
    for before, after in zip(messages, messages[5:], strict=False):
        here = Site(before.pose.latitude_rad, before.pose.longitude_rad)
        moved = enu_from_geodetic(here, after.pose.latitude_rad, after.pose.longitude_rad, 0.0)
        reckoned = (
            after.reckoned_east_m - before.reckoned_east_m,
            after.reckoned_north_m - before.reckoned_north_m,
        )
        assert moved[:2] == pytest.approx(reckoned, abs=0.05)


def test_clocks_are_in_every_stamp() -> None:
    eye = radar(phase_s=0.25, sigma_clock_s=0.1, errors={"clock_s": 0.03})
    made = scenario([carrier("own", eye, errors={"clock_s": -0.2})])
    outgoing = said(made, steps=range(1, 4))
    epoch_ns = made.declared.epoch_ns
    assert [m.t_ns - epoch_ns for m in of(Navigation, outgoing)] == [8e8, 18e8, 28e8]
    assert [m.t_ns - epoch_ns for m in of(SourceReport, outgoing)] == [8e7, 108e7, 208e7]


def test_a_fix_is_called_one() -> None:
    prior = {"sigma_position_m": 9.0, "fix": {"period_s": 10.0, "sigma_m": 9.0}}
    messages = of(Navigation, said(scenario([carrier("own", navigation=prior)])))
    assert [m.step for m in messages if m.kind == "fix"] == [10, 20, 30]
    assert {m.correlation_time_s for m in messages} == {10.0}


def test_an_empty_report_is_sent_too() -> None:
    reports = of(SourceReport, said(scenario(targets=[])))
    assert len(reports) == 30
    assert all(len(report) == 0 for report in reports)


def test_columns_are_those_of_the_sensor() -> None:
    by_source = {m.stream: m for m in of(SourceReport, said(full()))}
    eye, dish = by_source["eye"], by_source["radar"]
    assert len(eye.sigma_bearing_rad) == len(eye) > 0
    assert (eye.range_m, eye.identity) == (None, None)
    assert dish.sigma_range_m == [30.0] * len(dish)
    assert None in dish.identity
    assert dish.identity_kind == [name and "name" for name in dish.identity]


def test_classes_and_features_are_told_with_what_they_are_worth() -> None:
    eye = radar(
        classes={"accuracy": 0.9},
        features=[{"name": "length_m", "unit": "m", "sigma": 4.0}],
        clutter_per_scan=8.0,
    )
    classes = [
        {"name": n, "features": {"length_m": [size, 0.0]}} for n, size in (("a", 9.0), ("b", 99.0))
    ]
    ships = [target("ada") | {"class": "a"}, target("bob", east_m=0.0) | {"class": "b"}]
    made = scenario([carrier("own", eye)], targets=ships, classes=classes)
    for report in of(SourceReport, said(made)):
        assert all(names in (["a"], ["b"]) for names in report.classes)
        assert set(report.class_confidence) == {0.9}
        lengths = report.features["length_m"]
        told = [v is not None for v in lengths.values]
        assert told == [name is not None for name in report.identity]  # clutter: no population
        assert set(lengths.sigmas) == {4.0}


def test_ranges_are_stamped_by_the_clock_of_the_carrier_and_light_takes_its_time() -> None:
    beacon: Tree = {"name": "north", "east_m": 1_000.0, "north_m": 9_000.0}
    kinds = ("two_way", "pseudorange")
    own = carrier(
        "own",
        navigation=PRIOR,
        ranging=[{"kind": kind, "to": ["north"], "sigma_m": 5.0} for kind in kinds],
    )
    made = scenario([own], beacons=[beacon])
    heard = of(Ranging, said(made))
    _, truth = World(made).step(heard[0].step)
    assert [one.kind for one in heard[:2]] == list(kinds)
    assert [one.seq for one in heard] == list(range(1, len(heard) + 1))
    for one, ways in zip(heard[:2], (2, 1), strict=True):
        assert one.t_ns == truth.t_ns + round(truth.clock_offset_s[0] * 1e9)
        assert one.t_rx_ns == one.t_ns
        assert one.t_rx_ns - one.t_tx_ns == pytest.approx(
            ways * one.value_m / LIGHT_MPS * 1e9, abs=1
        )


def test_truth_of_different_steps_is_refused() -> None:
    made = full()
    world, teller = World(made), Carrier(made, "own")
    targets, carriers = world.step(1)[0], world.step(2)[1]
    with pytest.raises(ValueError, match="targets 1, carriers 2"):
        list(teller.step(targets, carriers, Stamp("b1")))
    with pytest.raises(ScenarioError, match="no such carrier"):
        Carrier(made, "nobody")


def test_a_thousand_targets_and_three_carriers_take_seconds() -> None:
    group = {
        "name": "many", "count": 1000, "box_m": [-2e4, 2e4, -2e4, 2e4], "speed_mps": [1.0, 9.0],
    }  # fmt: skip
    made = scenario([carrier(n) for n in ("a", "b", "c")], targets=[], target_groups=[group])
    kernel_s = min(_kernel_s() for _ in range(3))
    begin_s = time.perf_counter()
    world = World(made)
    carriers = [(Carrier(made, n), Stamp(n)) for n in ("a", "b", "c")]
    logs = 0
    for k in range(1, 61):
        truth = world.step(k)
        for one, stamp in carriers:
            outgoing = list(one.step(*truth, stamp))
            payloads(outgoing)
            logs += sum(len(m) for m in of(SourceReport, outgoing))
    took_s = time.perf_counter() - begin_s
    print(f"{logs} logs in {took_s:.2f} s, {took_s / kernel_s:.0f} kernels of {kernel_s:.4f} s")  # noqa: T201
    assert logs == 180_000
    assert took_s / kernel_s < 200  # 31 kernels, 1.7 s, where it was written


def _kernel_s() -> float:
    """Time of a fixed piece of numpy, to measure the machine by."""
    angles = np.linspace(0, 100, 500_000)
    begin_s = time.perf_counter()
    np.hypot(np.sin(angles), np.cos(angles))
    return time.perf_counter() - begin_s
