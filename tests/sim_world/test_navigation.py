"""Laws of a carrier's errors: none, exactly; their integral; a covariance that is honest."""

import numpy as np
import pytest
from msgspec.structs import replace

from estimation.frames import site_at, target_from_source, wrap_pi, yaw_rad
from sim_world.navigation import declared_covariances, frame_error, sail
from sim_world.scenario import with_overrides
from sim_world.scenario.declared import origin_of
from sim_world.scenario.file import ScenarioFile
from tests.sim_world.scenes import Tree, carrier, scenario

MINUTES = 20
TIME = {"duration_s": 60.0 * MINUTES, "step_s": 2.0}
STEPS = 30 * MINUTES
LOOP: Tree = {
    "kind": "waypoints",
    "points_m": [[0.0, 0.0], [6e3, 0.0], [6e3, 5e3], [0.0, 5e3]],
    "speed_mps": 12.0,
    "turn_radius_m": 800.0,
    "closed": True,
}
ALL_SIGMAS: Tree = {
    "sigma_position_m": 200.0,
    "sigma_north_deg": 1.0,
    "sigma_north_drift_deg_per_sqrt_h": 1.0,
    "sigma_speed_mps": 0.3,
    "sigma_current_mps": 0.4,
    "sigma_clock_s": 0.1,
    "sigma_clock_drift_ppm": 20.0,
}
READINGS: Tree = {"sigma_log_noise_mps": 2.0, "sigma_compass_noise_deg": 10.0}
NO_ERRORS: Tree = {
    "position_east_m": 0.0, "position_north_m": 0.0, "north_deg": 0.0, "speed_mps": 0.0,
    "current_east_mps": 0.0, "current_north_mps": 0.0, "clock_s": 0.0, "clock_drift_ppm": 0.0,
}  # fmt: skip


def file(errors: Tree | None = None, **navigation: object) -> ScenarioFile:
    own = carrier(
        motion=LOOP, navigation=ALL_SIGMAS | navigation, errors=errors or {}, use_corrections=False
    )
    return scenario([own], time=TIME).file


def voyage(of: ScenarioFile):
    return sail(of, of.carriers[0], origin_of(of), STEPS)


def test_errors_disabled_are_exactly_zero() -> None:
    fix = {"period_s": 30.0, "sigma_m": 10.0}
    for given in (file(), file({"north_deg": 3.0}), file(fix=fix)):
        calm = voyage(replace(given, errors=replace(given.errors, enabled=False)))
        assert not calm.position_error_m.any()
        assert not calm.north_error_rad.any()
        assert not calm.clock_offset_s.any()


def test_the_truth_does_not_depend_on_the_errors() -> None:
    one, other = voyage(file()), voyage(replace(file(), seed=99))
    for a, b in zip(one.truth, other.truth, strict=True):
        assert np.array_equal(a, b)


def test_given_errors_are_taken_and_the_others_drawn_as_without_them() -> None:
    drawn, given = file(), file({"north_deg": 2.5, "clock_s": 0.25})
    a, b = (frame_error(f, f.carriers[0]) for f in (drawn, given))
    assert b.north_rad == np.radians(2.5)
    assert b.clock_s == 0.25
    assert np.array_equal(a.position_m, b.position_m)
    assert (a.speed_mps, a.clock_drift_ppm) == (b.speed_mps, b.clock_drift_ppm)


def test_draws_have_their_sigmas() -> None:
    base, sigmas = file(), []
    for seed in range(2000):
        error = frame_error(replace(base, seed=seed), base.carriers[0])
        sigmas.append(
            [*error.position_m, np.degrees(error.north_rad), error.speed_mps, *error.current_mps,
             error.clock_s, error.clock_drift_ppm]
        )  # fmt: skip
    ratio = np.std(sigmas, axis=0) / [200, 200, 1, 0.3, 0.4, 0.4, 0.1, 20]
    assert np.all(np.abs(ratio - 1) < 5 / np.sqrt(2 * 2000))


def test_a_current_carries_the_carrier_off_by_its_integral() -> None:
    base = file(NO_ERRORS | {"current_east_mps": 0.5}, sigma_north_drift_deg_per_sqrt_h=0.0)
    drift = voyage(base).position_error_m
    t = np.arange(STEPS + 1) * 2.0
    assert np.allclose(drift, np.outer(t, [-0.5, 0.0]), atol=1e-6)


def test_a_wrong_north_turns_the_reckoned_way() -> None:
    base = file(NO_ERRORS | {"north_deg": 2.0}, sigma_north_drift_deg_per_sqrt_h=0.0)
    turned = voyage(base)
    straight = voyage(file(NO_ERRORS, sigma_north_drift_deg_per_sqrt_h=0.0))
    n = np.radians(2.0)
    # a way of bearing b is believed to have bearing b - n
    anticlockwise = np.array([[np.cos(n), -np.sin(n)], [np.sin(n), np.cos(n)]])
    assert np.allclose(turned.way_m, straight.way_m @ anticlockwise.T, atol=1e-6)
    assert np.allclose(turned.position_error_m, turned.way_m - straight.way_m, atol=1e-6)


def test_a_wrong_log_shows_in_the_way_and_in_the_error() -> None:
    given = NO_ERRORS | {"speed_mps": 0.6}
    fast = voyage(file(given, sigma_north_drift_deg_per_sqrt_h=0.0))
    assert np.allclose(fast.log_mps, 12.6)
    step = np.linalg.norm(np.diff(fast.way_m, axis=0), axis=1)
    assert np.allclose(step, 25.2, atol=0.05)  # a chord of the arc in the corners
    assert np.allclose(fast.position_error_m, fast.way_m * 0.6 / 12.6, atol=1e-6)


def test_the_reckoned_way_is_the_true_one_without_errors() -> None:
    calm = voyage(file(NO_ERRORS, sigma_north_drift_deg_per_sqrt_h=0.0))
    true = calm.truth.position_m[:, :2] - calm.truth.position_m[0, :2]
    # reckoned by the trapezoidal rule and along local east and north, not the origin's
    assert np.abs(calm.way_m - true).max() < 5.0
    alongside = calm.way_m @ np.array([1.0, 1.0]) - true @ np.array([1.0, 1.0])
    assert np.abs(alongside).max() < 5.0


def test_headings_count_from_the_north_of_the_place() -> None:
    far = carrier(
        motion={"kind": "constant_velocity", "east_m": 2e5, "north_m": 1e5, "course_deg": 70.0,
                "speed_mps": 5.0},
        navigation={},
    )  # fmt: skip
    given = scenario([far]).file
    origin = origin_of(given)
    sailed = sail(given, given.carriers[0], origin, 3)
    here = site_at(origin, sailed.truth.position_m[0])
    convergence = yaw_rad(target_from_source(origin, here))
    assert abs(convergence) > np.radians(1)
    assert sailed.heading_rad[0] == pytest.approx(np.radians(70) - convergence, abs=1e-9)


def test_a_still_carrier_heads_where_it_is_told() -> None:
    still = carrier(
        motion={"kind": "constant_velocity", "east_m": 0, "north_m": 0, "course_deg": 120.0}
    )
    given = scenario([still]).file
    sailed = sail(given, given.carriers[0], origin_of(given), 5)
    assert np.allclose(sailed.heading_rad, np.radians(120))
    assert np.allclose(sailed.way_m, 0)


def test_clocks_drift_steadily() -> None:
    sailed = voyage(file({"clock_s": 0.1, "clock_drift_ppm": 50.0}))
    t = np.arange(STEPS + 1) * 2.0
    assert np.allclose(sailed.clock_offset_s, 0.1 + 50e-6 * t, atol=1e-12)


def test_north_wanders_as_the_root_of_time() -> None:
    base, ends = file(NO_ERRORS), []
    for seed in range(400):
        given = replace(base, seed=seed)
        ends.append(np.degrees(voyage(given).north_error_rad[-1]))
    expected = np.sqrt(MINUTES / 60)
    assert np.std(ends) / expected == pytest.approx(1, abs=5 / np.sqrt(2 * 400))


def test_a_fix_replaces_what_has_drifted() -> None:
    fix = {"period_s": 60.0, "sigma_m": 10.0}
    sailed = voyage(file(fix=fix))
    fixed = np.flatnonzero(sailed.fixed)
    assert np.array_equal(fixed, np.arange(0, STEPS + 1, 30))
    errors = np.concatenate(
        [voyage(replace(file(fix=fix), seed=s)).position_error_m[fixed] for s in range(30)]
    )
    assert np.std(errors) / 10 == pytest.approx(1, abs=5 / np.sqrt(2 * errors.size))
    just_before = sailed.position_error_m[fixed[1:] - 1]
    reckoned = sailed.position_error_m[fixed[:-1]]
    assert np.all(np.linalg.norm(just_before - reckoned, axis=1) < 60 * 5 * 0.7)


@pytest.mark.parametrize("fix", [None, {"period_s": 250.0, "sigma_m": 20.0}], ids=["none", "fix"])
@pytest.mark.parametrize("noise", [{}, READINGS], ids=["steady", "noisy"])
def test_the_declared_covariance_is_honest(fix: Tree | None, noise: Tree) -> None:
    base = file(**({"fix": fix} if fix else {}), **noise)
    runs, checked = 400, [0, 1, 124, 300, STEPS]
    squares = np.zeros((runs, len(checked)))
    for seed in range(runs):
        given = replace(base, seed=seed)
        sailed = voyage(given)
        error = np.column_stack([sailed.position_error_m, sailed.north_error_rad])[checked]
        covariance = declared_covariances(given.carriers[0].navigation, sailed, 2.0)[checked]
        solved = np.linalg.solve(covariance, error[..., None])[..., 0]
        squares[seed] = (error * solved).sum(axis=1)
    nees = squares.mean(axis=0) / 3
    assert np.all(np.abs(nees - 1) < 5 * np.sqrt(2 / (3 * runs))), nees


def test_noise_of_readings_alone_is_claimed_from_the_first_step_on() -> None:
    """Both ends of a way count half: that shows in its first steps only, and alone."""
    alone = dict.fromkeys(ALL_SIGMAS, 0.0) | {"sigma_log_noise_mps": 2.0}
    runs, checked = 1500, [1, 2, 30]
    squares = np.zeros((runs, len(checked)))
    for seed in range(runs):
        given = replace(file(NO_ERRORS, **alone), seed=seed)
        sailed = sail(given, given.carriers[0], origin_of(given), 30)
        claimed = declared_covariances(given.carriers[0].navigation, sailed, 2.0)[checked, :2, :2]
        error = sailed.position_error_m[checked]
        squares[seed] = (error**2).sum(axis=1) / np.trace(claimed, axis1=1, axis2=2)
    assert squares.mean(axis=0) == pytest.approx(1.0, abs=5 * np.sqrt(2 / runs))


def test_log_and_compass_are_read_with_their_noise() -> None:
    quiet, noisy = voyage(file(NO_ERRORS)), voyage(file(NO_ERRORS, **READINGS))
    log, compass = noisy.log_mps - quiet.log_mps, wrap_pi(noisy.compass_rad - quiet.compass_rad)
    for noise, sigma in ((log, 2.0), (compass, np.radians(10.0))):
        assert np.std(noise) == pytest.approx(sigma, abs=4 * sigma / np.sqrt(2 * STEPS))


def test_a_longer_run_begins_as_a_shorter_one() -> None:
    given = file(fix={"period_s": 60.0, "sigma_m": 10.0}, **READINGS)
    short, long = (sail(given, given.carriers[0], origin_of(given), n) for n in (50, 80))
    for a, b in zip((*short.truth, *short[1:]), (*long.truth, *long[1:]), strict=True):
        assert np.array_equal(a, b[:51])


def test_no_carrier_moves_the_errors_of_another() -> None:
    alone = scenario([carrier("own", navigation=ALL_SIGMAS)])
    both = scenario([carrier("new"), carrier("own", navigation=ALL_SIGMAS)])
    seen = [
        sail(s.file, s.file.carriers[-1], origin_of(s.file), 60).position_error_m
        for s in (alone, both, with_overrides(alone, {"targets": []}))
    ]
    assert np.array_equal(seen[0], seen[1])
    assert np.array_equal(seen[0], seen[2])
