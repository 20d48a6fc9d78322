"""Carrier frames against pymap3d's own chains, round trips, and the figures of the design."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.arrays import Array
from estimation.frames import (
    RigidTransform,
    Site,
    east_north_covariance,
    east_north_from_polar,
    enu_from_ecef,
    enu_from_geodetic,
    geodetic_from_enu,
    level_plane,
    on_surface,
    polar_from_east_north,
    rotation_clockwise,
    site_at,
    target_from_source,
    wrap_pi,
    yaw_rad,
)

DEG = np.pi / 180
MILLIMETRE = 1e-3

angles = st.floats(-10.0, 10.0)
sites = st.builds(
    Site, st.floats(-80 * DEG, 80 * DEG), st.floats(-np.pi, np.pi), st.floats(-50.0, 12e3)
)
offsets = st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5), st.floats(-500.0, 1e4))


def scattered(origin: Site, radius_m: float, seed: int = 1, count: int = 200) -> Array:
    """Surface points (count, 3) east, north, up at origin, within a radius."""
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(0, 2 * np.pi, count)
    return on_surface(
        origin, *east_north_from_polar(bearing, radius_m * np.sqrt(rng.random(count))).T
    )


@given(sites)
def test_axes_agree_with_pymap3d_and_are_a_rotation(site: Site) -> None:
    rotation = enu_from_ecef(site)
    expected = pymap3d.ecef.ecef2enuv(*np.eye(3), site.latitude_rad, site.longitude_rad, deg=False)
    np.testing.assert_allclose(rotation, expected, atol=1e-15)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)


@given(sites, offsets, offsets)
def test_transform_agrees_with_pymap3d_through_geodetic(
    target: Site, offset: tuple[float, float, float], point: tuple[float, float, float]
) -> None:
    source = site_at(target, offset)
    moved = target_from_source(target, source).apply(point)
    geodetic = pymap3d.enu2geodetic(*point, *source, deg=False)
    expected = np.ravel(pymap3d.geodetic2enu(*geodetic, *target, deg=False))
    np.testing.assert_allclose(moved, expected, atol=1e-5)  # rounding of 6e6 m and of latitude


@given(sites, offsets, offsets)
def test_transforms_are_a_group(
    a: Site, offset: tuple[float, float, float], other_offset: tuple[float, float, float]
) -> None:
    b, c = site_at(a, offset), site_at(a, other_offset)
    a_from_b, b_from_c = target_from_source(a, b), target_from_source(b, c)
    point = np.array([3e4, -2e4, 100.0])
    moved = a_from_b.apply(point)
    c_point = b_from_c.inverse().apply(point)
    pairs = [
        ((a_from_b @ b_from_c).apply(c_point), moved),
        (target_from_source(a, c).apply(c_point), moved),
        (a_from_b.inverse().apply(moved), point),
        (target_from_source(b, a).apply(moved), point),
    ]
    for one, same in pairs:  # ECEF is rounded at 1e-9 m; tilts of 1e-16 on lever arms of 1e5 m
        np.testing.assert_allclose(one, same, atol=1e-6)


def test_apply_takes_any_leading_shape() -> None:
    turn = RigidTransform(np.eye(3)[[1, 0, 2]], np.array([1.0, 2.0, 3.0]))
    points = np.arange(24.0).reshape(2, 4, 3)
    np.testing.assert_array_equal(turn.apply(points)[1, 2], turn.apply(points[1, 2]))


@pytest.mark.parametrize("count", [0, 1, 5])
def test_geodetic_round_trip_keeps_shape(count: int) -> None:
    origin = Site(41 * DEG, 29 * DEG, 30.0)
    enu = np.random.default_rng(2).normal(0, 5e4, (count, 3))
    latitude, longitude, altitude = geodetic_from_enu(origin, enu)
    assert latitude.shape == longitude.shape == altitude.shape == (count,)
    back = enu_from_geodetic(origin, latitude, longitude, altitude)
    # pymap3d takes the latitude in closed form: 7 um off at 100 km up, 2 nm on the ground
    np.testing.assert_allclose(back, enu, atol=1e-5)


@pytest.mark.parametrize("latitude_deg", [-90.0, -89.9999, 0.0, 45.0, 90.0])
@pytest.mark.parametrize("altitude", [-11e3, 0.0, 12e3])
def test_geodetic_coordinates_anywhere_near_the_ground(
    latitude_deg: float, altitude: float
) -> None:
    site = Site(latitude_deg * DEG, 1.0, altitude)
    there = site_at(site, [0.0, 0.0, 0.0])
    assert there.latitude_rad == pytest.approx(site.latitude_rad, abs=1e-13)
    assert there.altitude_m == pytest.approx(altitude, abs=1e-8)


@given(sites, st.floats(0, 5e5), angles, st.floats(0.0, 1e4))
def test_on_surface_is_at_its_altitude(
    origin: Site, distance: float, bearing: float, altitude: float
) -> None:
    east, north = east_north_from_polar(bearing, distance)
    enu = on_surface(origin, east, north, altitude)
    np.testing.assert_array_equal(enu[:2], [east, north])
    reached = geodetic_from_enu(origin, enu)[2]
    assert reached == pytest.approx(altitude, abs=MILLIMETRE + 1.5e-6 * altitude)


@pytest.mark.parametrize("source_altitude", [15.0, 10e3])
@pytest.mark.parametrize("bearing_deg", [0.0, 50.0, 90.0, 230.0])
def test_level_plane_is_exact_for_surface_targets_at_100_km(
    source_altitude: float, bearing_deg: float
) -> None:
    own = Site(41 * DEG, 29 * DEG, 20.0)
    east, north = east_north_from_polar(bearing_deg * DEG, 1e5)
    source = site_at(own, on_surface(own, east, north, source_altitude))
    latitude, longitude, _ = geodetic_from_enu(source, scattered(source, 1e5))
    bearing, _, slant = pymap3d.geodetic2aer(latitude, longitude, 0.0, *source, deg=False)
    expected = enu_from_geodetic(own, latitude, longitude, 0.0)[:, :2]
    np.testing.assert_allclose(level_plane(own, source, bearing, slant), expected, atol=MILLIMETRE)


def test_a_flat_earth_would_not_do() -> None:
    """At 100 km adding offsets and norths in one plane misplaces a target by 100s of metres."""
    own = Site(41 * DEG, 29 * DEG)
    source = site_at(own, on_surface(own, 1e5, 0.0))
    offset = target_from_source(own, source).translation_m[:2]
    flat = offset + east_north_from_polar(0.0, 3e4)
    assert np.linalg.norm(level_plane(own, source, 0.0, 3e4) - flat) > 300


def test_altitude_of_the_target_counts() -> None:
    own = Site(41 * DEG, 29 * DEG, 20.0)
    enu = on_surface(own, 2e4, 1e4, altitude_m=8e3)
    bearing, slant = np.arctan2(2e4, 1e4), np.linalg.norm(enu)
    np.testing.assert_allclose(level_plane(own, own, bearing, slant, 8e3), [2e4, 1e4], atol=1e-2)
    wrong = level_plane(own, own, bearing, slant)
    assert np.linalg.norm(wrong - [2e4, 1e4]) > 1e3


def test_a_range_shorter_than_the_height_is_straight_below() -> None:
    aircraft = Site(41 * DEG, 29 * DEG, 5e3)
    np.testing.assert_allclose(level_plane(aircraft, aircraft, [1.0], [4.9e3]), [[0, 0]], atol=1e-6)


@pytest.mark.parametrize(("distance", "degrees"), [(2e4, 0.10), (1e5, 0.52)])
def test_norths_at_41_degrees_differ_as_the_design_says(distance: float, degrees: float) -> None:
    """The design's figures hold on a bearing of 41 deg; due east it is 1.5 times as much."""
    own = Site(41 * DEG, 29 * DEG)

    def turn_deg(bearing: float) -> float:
        source = site_at(own, on_surface(own, *east_north_from_polar(bearing * DEG, distance)))
        return yaw_rad(target_from_source(own, source)) / DEG

    assert turn_deg(41.0) == pytest.approx(-degrees, abs=0.005)  # a source in the east leans west
    assert turn_deg(90.0) == pytest.approx(-distance / 6388e3 * np.tan(41 * DEG) / DEG, rel=2e-3)
    assert turn_deg(0.0) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(0, 1e5), angles, st.floats(0, 2 * np.pi))
def test_yaw_is_what_a_bearing_gains(distance: float, direction: float, bearing: float) -> None:
    own = Site(41 * DEG, 29 * DEG)
    source = site_at(own, on_surface(own, *east_north_from_polar(direction, distance)))
    transform = target_from_source(own, source)
    along = transform.rotation @ [np.sin(bearing), np.cos(bearing), 0.0]
    gained = wrap_pi(np.arctan2(along[0], along[1]) - bearing - yaw_rad(transform))
    assert abs(gained) <= (distance / 6.3e6) ** 2 + 1e-14  # the tilt, to second order


@given(st.floats(0, 2 * np.pi, exclude_max=True), st.floats(1.0, 1e6))
def test_polar_round_trip(bearing: float, range_m: float) -> None:
    back_bearing, back_range = polar_from_east_north(east_north_from_polar(bearing, range_m))
    assert 0 <= back_bearing < 2 * np.pi
    assert abs(wrap_pi(back_bearing - bearing)) < 1e-14
    assert back_range == pytest.approx(range_m, rel=1e-14)


@given(angles, angles)
def test_rotation_clockwise_adds_to_the_bearing(bearing: float, angle: float) -> None:
    np.testing.assert_allclose(
        rotation_clockwise(angle) @ east_north_from_polar(bearing, 1.0),
        east_north_from_polar(bearing + angle, 1.0),
        atol=1e-14,
    )


@given(angles, st.floats(10, 1e5), angles)
def test_turning_a_log_turns_its_covariance(bearing: float, range_m: float, angle: float) -> None:
    turn = rotation_clockwise(angle)
    turned = turn @ east_north_covariance(bearing, range_m, 0.01, 100.0) @ turn.T
    np.testing.assert_allclose(
        east_north_covariance(bearing + angle, range_m, 0.01, 100.0), turned, rtol=0, atol=1e-6
    )


def test_covariance_is_that_of_a_sample() -> None:
    rng = np.random.default_rng(3)
    logs = rng.normal([0.7, 2e4], [0.01, 100.0], (200_000, 2))
    sampled = np.cov(east_north_from_polar(*logs.T).T)
    stated = east_north_covariance(0.7, 2e4, 0.01, 100.0)
    # 200 000 draws: variances to .3 %, so 1.5 % is five sigmas
    np.testing.assert_allclose(stated, sampled, rtol=0.015)


@given(st.floats(-1e3, 1e3))
def test_wrap_pi(angle: float) -> None:
    wrapped = float(wrap_pi(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-12)


def test_frames_do_not_import_scipy() -> None:
    """Carriers and the world turn coordinates and must not wait for scipy at their start."""
    code = "import sys, estimation.frames; sys.exit('scipy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
