"""Laws of motion: what is said to be a derivative is one, and paths go where they are told."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.frames import Site, geodetic_from_enu
from sim_world.motion import Kinematics, Paths, path_of
from sim_world.scenario.motions import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    PathMotion,
    Waypoints,
)

ORIGIN = Site(math.radians(41), math.radians(29))
START: dict[str, Any] = {"east_m": 3000.0, "north_m": -2000.0, "course_deg": 30.0}
SQUARE = [(0.0, 0.0), (0.0, 4000.0), (4000.0, 4000.0), (4000.0, 0.0)]
MOTIONS: dict[str, PathMotion] = {
    "still": ConstantVelocity(east_m=1.0, north_m=2.0),
    "straight": ConstantVelocity(**START, speed_mps=10, altitude_m=300),
    "speeding": ConstantAcceleration(
        **START, speed_mps=2, acceleration_mps2=0.5, speed_limit_mps=18
    ),
    "stopping": ConstantAcceleration(**START, speed_mps=9, acceleration_mps2=-0.3),
    "circle": CoordinatedTurn(**START, speed_mps=20, turn_rate_deg_s=-3),
    "turn": CoordinatedTurn(**START, speed_mps=15, turn_rate_deg_s=2, from_s=20, until_s=50),
    "line": Waypoints(points_m=SQUARE, speed_mps=40, turn_radius_m=500),
    "loop": Waypoints(points_m=SQUARE, speed_mps=90, turn_radius_m=900, closed=True),
}


def at(motion: PathMotion, times: Any) -> tuple[Kinematics, np.ndarray]:
    times = np.atleast_1d(np.asarray(times, dtype=float))
    return Paths(ORIGIN, [path_of(motion)]).at(times, np.zeros(len(times), dtype=int))


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
@given(t=st.floats(0.1, 400))
def test_velocity_and_acceleration_are_the_derivatives(motion: PathMotion, t: float) -> None:
    h = 1e-3
    (position, velocity, acceleration), _ = at(motion, [t - h, t, t + h])
    if np.ptp(np.linalg.norm(acceleration, axis=1)) > 1e-6:
        return  # a piece ends here: acceleration jumps, position and velocity don't (below)
    difference = (position[2] - position[0]) / (2 * h)
    assert np.allclose(difference, velocity[1], atol=2e-5 * (1 + np.abs(velocity[1]).max()))
    bend = (velocity[2] - velocity[0]) / (2 * h)
    assert np.allclose(bend, acceleration[1], atol=1e-5)


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_nothing_jumps(motion: PathMotion) -> None:
    times = np.arange(0, 500, 0.05)
    (position, velocity, acceleration), _ = at(motion, times)
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert step.max() <= 0.05 * np.linalg.norm(velocity, axis=1).max() * 1.001 + 1e-9
    turn = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    assert turn.max() <= 0.05 * np.linalg.norm(acceleration, axis=1).max() * 1.001 + 1e-9


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_altitude_stays_above_the_ellipsoid(motion: PathMotion) -> None:
    (position, _, _), _ = at(motion, np.arange(0, 3600, 60))
    _, _, altitude = geodetic_from_enu(ORIGIN, position)
    assert np.allclose(altitude, motion.altitude_m, atol=1e-3)


def test_many_paths_at_once_are_each_alone() -> None:
    together, courses = Paths(ORIGIN, [path_of(m) for m in MOTIONS.values()]).at(77.7)
    for n, motion in enumerate(MOTIONS.values()):
        alone, course = at(motion, 77.7)
        for a, b in zip(together, alone, strict=True):
            assert np.array_equal(a[n], b[0])
        assert courses[n] == course[0]


def test_speeds_end_at_their_limit() -> None:
    for name, expected in (("speeding", 18.0), ("stopping", 0.0)):
        kinematics, _ = at(MOTIONS[name], 200)
        assert np.linalg.norm(kinematics.velocity_mps[0, :2]) == pytest.approx(expected, abs=1e-9)
    stopped, _ = at(MOTIONS["stopping"], [30, 3000])
    assert np.allclose(stopped.position_m[0], stopped.position_m[1])


def test_a_turn_changes_the_course_by_rate_times_time() -> None:
    (_, velocity, _), _ = at(MOTIONS["turn"], [10, 50, 90])
    courses = np.degrees(np.arctan2(velocity[:, 0], velocity[:, 1]))
    assert np.allclose(courses, [30, 90, 90])


def test_a_circle_closes() -> None:
    (position, _, _), _ = at(MOTIONS["circle"], [0, 120])
    assert np.allclose(position[0], position[1], atol=1e-6)


def test_a_line_passes_its_corners_as_near_as_its_radius_lets_it() -> None:
    (position, velocity, _), _ = at(MOTIONS["line"], np.arange(0, 300, 0.02))
    level, speed = position[:, :2], np.linalg.norm(velocity[:, :2], axis=1)
    nearest = np.linalg.norm(level - np.array(SQUARE[1]), axis=1).min()
    assert nearest == pytest.approx(500 * (math.sqrt(2) - 1), abs=0.5)
    assert np.allclose(speed, 40)
    on_last_leg = np.linalg.norm(level - np.array([4000.0, -200.0]), axis=1).min()
    assert on_last_leg < 1  # and on past the last point


def test_a_loop_repeats_and_starts_where_it_is_told() -> None:
    loop = MOTIONS["loop"]
    assert isinstance(loop, Waypoints)
    way_m = 4 * (4000 - 2 * 900) + 2 * math.pi * 900
    (position, _, _), _ = at(loop, [12.3, 12.3 + way_m / 90])
    assert np.allclose(position[0], position[1], atol=1e-6)
    later = Waypoints(
        points_m=SQUARE, speed_mps=90, turn_radius_m=900, closed=True, start_along_m=5000
    )
    (shifted, _, _), _ = at(later, 0)
    (expected, _, _), _ = at(loop, 5000 / 90)
    assert np.allclose(shifted, expected, atol=1e-6)


def test_short_legs_get_tighter_corners() -> None:
    tight = Waypoints(points_m=[(0, 0), (0, 100), (5000, 100)], speed_mps=5, turn_radius_m=2000)
    (position, _, acceleration), _ = at(tight, np.arange(0, 60, 0.01))
    assert np.abs(position[:, 0].min()) < 1e-6
    radius = 25 / np.linalg.norm(acceleration[:, :2], axis=1).max()
    assert radius == pytest.approx(50, rel=1e-6)  # tangent length of a right angle = radius


@given(dt=st.floats(-5, 5))
def test_extrapolation_is_exact_at_constant_acceleration(dt: float) -> None:
    now, _ = at(MOTIONS["speeding"], 10)
    then, _ = at(MOTIONS["speeding"], 10 + dt)
    extrapolated = now.after(dt)
    assert np.allclose(extrapolated.position_m[:, :2], then.position_m[:, :2], atol=1e-9)
    assert np.allclose(extrapolated.position_m, then.position_m, atol=1e-4)  # Earth as a sphere
    assert np.allclose(extrapolated.velocity_mps[:, :2], then.velocity_mps[:, :2], atol=1e-9)
