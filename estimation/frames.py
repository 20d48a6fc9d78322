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
from functools import lru_cache
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


class _Axes(NamedTuple):
    """East-north-up at a site.

    Attributes:
        enu_from_ecef: rotation (3, 3); centre_m: (3,) the site in ECEF.
        arm_m: from the centre of the Earth to the site, as east, north, up there.
        pole: direction of the Earth's axis, likewise.
    """

    enu_from_ecef: Array
    centre_m: Array
    arm_m: tuple[float, float, float]
    pole: tuple[float, float, float]


def enu_from_ecef(site: Site) -> Array:
    """Rotation (3, 3) that takes a vector's ECEF components to east, north, up at a site."""
    return _axes(site).enu_from_ecef


@lru_cache(maxsize=256)
def _axes(site: Site) -> _Axes:
    """The axes at a site: those of a carrier at an instant are asked for again and again."""
    sin_lat, cos_lat = math.sin(site.latitude_rad), math.cos(site.latitude_rad)
    sin_lon, cos_lon = math.sin(site.longitude_rad), math.cos(site.longitude_rad)
    rotation = np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )
    centre = np.array(pymap3d.geodetic2ecef(*site, deg=False))
    rotation.flags.writeable = centre.flags.writeable = False
    east, north, up = (rotation @ centre).tolist()
    return _Axes(rotation, centre, (east, north, up), (0.0, cos_lat, sin_lat))


def target_from_source(target: Site, source: Site) -> RigidTransform:
    """The transform from east-north-up at `source` to east-north-up at `target`."""
    there, here = _axes(target), _axes(source)
    baseline = here.centre_m - there.centre_m
    return RigidTransform(
        there.enu_from_ecef @ here.enu_from_ecef.T, there.enu_from_ecef @ baseline
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
    axes = _axes(origin)
    x, y, z = np.moveaxis(
        np.asarray(enu_m, dtype=float) @ axes.enu_from_ecef + axes.centre_m, -1, 0
    )
    latitude, longitude, altitude = pymap3d.ecef2geodetic(x, y, z, deg=False)
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

    The up coordinate falls by distance^2 / (2 * 6371 km), 31 m at 20 km. The vertical line meets
    the surface of that altitude where a quadratic in up is zero.
    """
    east, north = np.asarray(east_m, dtype=float), np.asarray(north_m, dtype=float)
    axes, (weight, polar) = _axes(origin), _weights(altitude_m)
    (arm_east, arm_north, arm_up), (_, z_by_north, z_by_up) = axes.arm_m, axes.pole
    radius2 = arm_east**2 + arm_north**2 + arm_up**2
    foot2 = radius2 + east * (east + 2 * arm_east) + north * (north + 2 * arm_north)
    z = axes.centre_m[2] + z_by_north * north
    excess = weight * foot2 + polar * z**2 - 1
    rise, square = weight * arm_up + polar * z_by_up * z, weight + polar * z_by_up**2
    up = -excess / (rise + np.sqrt(np.maximum(rise**2 - square * excess, 0.0)))
    enu = np.empty((*up.shape, 3))
    enu[..., 0], enu[..., 1], enu[..., 2] = east, north, up
    return enu


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
    bearing, slant = np.asarray(bearing_rad, dtype=float), np.asarray(range_m, dtype=float)
    sin, cos = np.sin(bearing), np.cos(bearing)
    up = _up_at_range(source, sin, cos, slant, altitude_m)
    level = np.sqrt(slant**2 - up**2)
    enu_source = np.empty((*up.shape, 3))
    enu_source[..., 0], enu_source[..., 1], enu_source[..., 2] = level * sin, level * cos, up
    return target_from_source(target, source).apply(enu_source)[..., :2]


def _up_at_range(
    source: Site, sin: Array, cos: Array, slant_m: Array, altitude_m: ArrayLike
) -> Array:
    """Up (...) [m] of points at a slant range and an altitude; sine and cosine of their bearing.

    Raising a point by what it lacks is Newton's step but for 0.3 % (the flattening) and
    (distance / Earth radius)^2 / 2, so an error shrinks to 0.3 % each pass.
    """
    axes, (weight, polar) = _axes(source), _weights(altitude_m)
    (arm_east, arm_north, arm_up), (_, z_by_north, z_by_up) = axes.arm_m, axes.pole
    outward, z_by_level = 2 * (arm_east * sin + arm_north * cos), z_by_north * cos
    sphere2 = arm_east**2 + arm_north**2 + arm_up**2 + slant_m**2
    up = np.asarray(altitude_m) - source.altitude_m - slant_m**2 / (2 * _EARTH_RADIUS_M)
    for _ in range(_PASSES):
        up = np.minimum(np.maximum(up, -slant_m), slant_m)
        level = np.sqrt(slant_m**2 - up**2)
        point2 = sphere2 + outward * level + 2 * arm_up * up  # from the centre of the Earth
        z = axes.centre_m[2] + z_by_level * level + z_by_up * up
        up = up - _EARTH_RADIUS_M / 2 * (weight * point2 + polar * z**2 - 1)
    return np.minimum(np.maximum(up, -slant_m), slant_m)


def _weights(altitude_m: ArrayLike) -> tuple[Array, Array]:
    """Weights w, p with w r^2 + p z^2 = 1 at an altitude, r from the centre of the Earth.

    The surface of that altitude is the ellipsoid of semi-axes a + h, b + h (to 1.5e-6 of h).
    """
    altitude = np.asarray(altitude_m, dtype=float)
    weight: Array = 1 / (_WGS84.semimajor_axis + altitude) ** 2
    return weight, 1 / (_WGS84.semiminor_axis + altitude) ** 2 - weight


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
