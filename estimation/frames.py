"""Carrier frames: local east-north-up on WGS84, joined through ECEF.

A carrier measures bearing, clockwise from its north, and *slant* range. A target log without
elevation is one equation short of a point in space; what closes it is that the target lies at a
known altitude above the ellipsoid (0 for ships), see `level_plane`. Nothing is flattened: the
curvature of the Earth (785 m of drop, hence 3 m of ground range at 100 km), the altitude of
the carrier and the meridians' convergence are all in the transform, and the result is exact to a
millimetre as far as 500 km. What is *not* modelled: the geoid (30 m of undulation is 0.3 m of
ground range at 100 km, the same for all carriers) and refraction (it bends the ray but hardly
lengthens it).

Pure numpy and pymap3d: processes that must not import scipy import this module.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pymap3d

from estimation.arrays import Array, ArrayLike, broadcast, transposed

_WGS84 = pymap3d.Ellipsoid.from_name("wgs84")
_EARTH_RADIUS_M = 6_371_000.0  # for first guesses and step lengths only
_PASSES = 3


class Site(NamedTuple):
    """A point by geodetic coordinates on WGS84; the origin of a local east-north-up frame."""

    latitude_rad: float
    longitude_rad: float
    altitude_m: float = 0.0


class RigidTransform(NamedTuple):
    """target = rotation @ source + translation; named `target_from_source` where it is kept."""

    rotation: Array
    translation_m: Array

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) [m] of the source frame, in the target frame."""
        return np.asarray(points, dtype=float) @ self.rotation.T + self.translation_m

    def inverse(self) -> RigidTransform:
        """`source_from_target`."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation_m)

    def __matmul__(self, inner: RigidTransform) -> RigidTransform:
        """`c_from_b @ b_from_a` is `c_from_a`."""
        return RigidTransform(self.rotation @ inner.rotation, self.apply(inner.translation_m))


def enu_from_ecef(site: Site) -> Array:
    """Rotation (3, 3) that takes a vector's ECEF components to east, north, up at a site."""
    sin_lat, cos_lat = math.sin(site.latitude_rad), math.cos(site.latitude_rad)
    sin_lon, cos_lon = math.sin(site.longitude_rad), math.cos(site.longitude_rad)
    return np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )


def target_from_source(target: Site, source: Site) -> RigidTransform:
    """The transform from east-north-up at `source` to east-north-up at `target`."""
    enu_from_ecef_target = enu_from_ecef(target)
    baseline = _ecef(source) - _ecef(target)
    return RigidTransform(
        enu_from_ecef_target @ enu_from_ecef(source).T, enu_from_ecef_target @ baseline
    )


def yaw_rad(target_from_source: RigidTransform) -> float:
    """Bearing [rad] of the source's north in target axes: add it to a bearing from the source.

    It is the convergence of the meridians, about -east * tan(latitude) / Earth radius. A
    covariance in east-north is carried over by `rotation_clockwise` of it; the tilt that this
    leaves out shortens a sigma by 1e-4 at 100 km.
    """
    east, north, _ = target_from_source.rotation[:, 1]
    return float(np.arctan2(east, north))


def geodetic_from_enu(origin: Site, enu_m: ArrayLike) -> tuple[Array, Array, Array]:
    """Latitude [rad], longitude [rad], altitude [m], each (...), of points (..., 3) [m]."""
    east, north, up = np.moveaxis(np.asarray(enu_m, dtype=float), -1, 0)
    latitude, longitude, altitude = pymap3d.enu2geodetic(east, north, up, *origin, deg=False)
    return np.reshape(latitude, np.shape(longitude)), longitude, altitude  # pymap3d squeezes it


def enu_from_geodetic(
    origin: Site, latitude_rad: ArrayLike, longitude_rad: ArrayLike, altitude_m: ArrayLike
) -> Array:
    """East, north, up (..., 3) [m] at `origin` of points given by arrays that broadcast."""
    point = broadcast(latitude_rad, longitude_rad, altitude_m)
    return np.stack(pymap3d.geodetic2enu(*point, *origin, deg=False), axis=-1)


def site_at(origin: Site, enu_m: ArrayLike) -> Site:
    """The site of one point (3,) [m] of the frame at `origin`."""
    latitude, longitude, altitude = geodetic_from_enu(origin, enu_m)
    return Site(float(latitude), float(longitude), float(altitude))


def on_surface(
    origin: Site, east_m: ArrayLike, north_m: ArrayLike, altitude_m: ArrayLike = 0.0
) -> Array:
    """Points (..., 3) [m] at `origin` over (east, north), at an altitude above the ellipsoid.

    The up coordinate falls by distance^2 / (2 * 6371 km), 31 m at 20 km; good to 500 km.
    """
    east, north, altitude = broadcast(east_m, north_m, altitude_m)
    guess = altitude - origin.altitude_m - (east**2 + north**2) / (2 * _EARTH_RADIUS_M)
    return _at_altitude(origin, altitude, guess, lambda up: np.stack([east, north, up], axis=-1))


def level_plane(
    target: Site,
    source: Site,
    bearing_rad: ArrayLike,
    range_m: ArrayLike,
    altitude_m: ArrayLike = 0.0,
) -> Array:
    """East and north in target's axes of what a carrier at `source` logs without elevation.

    The point at that bearing and slant range from `source` which lies at `altitude_m` above the
    ellipsoid, taken to east-north-up at `target`, its up dropped. Own logs go the same way, with
    target = source: then only the slant range is made level. A range shorter than the difference
    of altitudes (noise, straight above) gives the point straight below.

    Args:
        bearing_rad: (L,) clockwise from the source's north.
        range_m: (L,) slant ranges.
        altitude_m: of the logged targets, scalar or (L,).

    Returns:
        (L, 2) [m]; error below a millimetre at 100 km when the altitude is right.
    """
    bearing, slant, altitude = broadcast(bearing_rad, range_m, altitude_m)

    def at_range(up: Array) -> Array:
        up = np.clip(up, -slant, slant)
        level = east_north_from_polar(bearing, np.sqrt(slant**2 - up**2))
        return np.concatenate([level, up[..., None]], axis=-1)

    guess = altitude - source.altitude_m - slant**2 / (2 * _EARTH_RADIUS_M)
    enu_source = _at_altitude(source, altitude, guess, at_range)
    return target_from_source(target, source).apply(enu_source)[..., :2]


def _at_altitude(
    origin: Site, altitude_m: Array, up_m: Array, point: Callable[[Array], Array]
) -> Array:
    """`point(up)` (..., 3), with the up [m] that puts it at an altitude, sought from `up_m`.

    The surface of that altitude is the ellipsoid of semi-axes a + h, b + h (to 1.5e-6 of h).
    Raising a point by what it lacks is Newton's step but for 0.3 % (the flattening) and
    (distance / Earth radius)^2 / 2, so an error shrinks to 0.3 % each pass.
    """
    a, b = _WGS84.semimajor_axis + altitude_m, _WGS84.semiminor_axis + altitude_m
    semi_axes = np.stack([a, a, b], axis=-1)
    ecef_from_enu, centre = enu_from_ecef(origin).T, _ecef(origin)
    for _ in range(_PASSES):
        ecef = point(up_m) @ ecef_from_enu.T + centre
        up_m = up_m - _EARTH_RADIUS_M / 2 * (((ecef / semi_axes) ** 2).sum(axis=-1) - 1)
    return point(up_m)


def east_north_from_polar(bearing_rad: ArrayLike, range_m: ArrayLike) -> Array:
    """East and north (..., 2) [m] of bearings [rad] and level ranges [m] that broadcast."""
    bearing, level = broadcast(bearing_rad, range_m)
    return np.stack([level * np.sin(bearing), level * np.cos(bearing)], axis=-1)


def polar_from_east_north(east_north_m: ArrayLike) -> tuple[Array, Array]:
    """Bearings in [0, 2 pi) [rad] and ranges [m], each (...), of points (..., 2) [m]."""
    east, north = np.moveaxis(np.asarray(east_north_m, dtype=float), -1, 0)
    bearing = np.arctan2(east, north) % (2 * np.pi)
    return np.where(bearing < 2 * np.pi, bearing, 0.0), np.hypot(east, north)


def east_north_by_polar(bearing_rad: ArrayLike, range_m: ArrayLike) -> Array:
    """Derivatives (..., 2, 2) of east and north (rows) by bearing [m/rad] and range [m/m]."""
    bearing, level = broadcast(bearing_rad, range_m)
    sin, cos = np.sin(bearing), np.cos(bearing)
    return np.stack([level * cos, sin, -level * sin, cos], axis=-1).reshape(*bearing.shape, 2, 2)


def east_north_covariance(
    bearing_rad: ArrayLike,
    range_m: ArrayLike,
    sigma_bearing_rad: ArrayLike,
    sigma_range_m: ArrayLike,
) -> Array:
    """Covariances (..., 2, 2) [m^2] of east and north, to first order; arguments broadcast."""
    sigmas = np.stack(broadcast(sigma_bearing_rad, sigma_range_m), axis=-1)
    root: Array = east_north_by_polar(bearing_rad, range_m) * sigmas[..., None, :]
    return root @ transposed(root)


def rotation_clockwise(angle_rad: ArrayLike) -> Array:
    """Rotations (..., 2, 2) of east-north vectors by which a bearing grows by `angle_rad`."""
    angle = np.asarray(angle_rad, dtype=float)
    turn = np.empty((*angle.shape, 2, 2))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
    turn[..., 0, 1] = np.sin(angle)
    turn[..., 1, 0] = -turn[..., 0, 1]
    return turn


def wrap_pi(angle_rad: ArrayLike) -> Array:
    """Angles [rad] in [-pi, pi)."""
    wrapped: Array = (np.asarray(angle_rad, dtype=float) + np.pi) % (2 * np.pi) - np.pi
    return wrapped


def _ecef(site: Site) -> Array:
    """Position (3,) [m] of a site in ECEF."""
    return np.array(pymap3d.geodetic2ecef(*site, deg=False))
