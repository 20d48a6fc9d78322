"""Where the logs of a report put their targets: east and north of the carrier, in its own axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.frames import Site, enu_from_geodetic, geodetic_from_enu, level_plane
from schemas.messages import SourceProperties, SourceReport

from ..navigation import NS

Flags = NDArray[np.bool_]


class Places(NamedTuple):
    """Level positions of the n logs of a report, nan where a log gives none.

    Attributes:
        east_north_m: (n, 2) from where the carrier was at the log, along its believed axes.
        covariance: (n, 2, 2) [m^2]; nan where neither the log nor its source states a sigma.
        altitude_m: (n,) of the target above the ellipsoid.
        defaulted: (n,) whether a log with a position left a sigma to its source.
    """

    east_north_m: Array
    covariance: Array
    altitude_m: Array
    defaulted: Flags

    @property
    def located(self) -> Flags:
        """(n,) whether a log has a position at all, with or without sigmas."""
        located: Flags = np.isfinite(self.east_north_m.sum(axis=1))
        return located

    @property
    def usable(self) -> Flags:
        """(n,) whether a log has a position and its covariance."""
        usable: Flags = self.located & np.isfinite(self.covariance.sum(axis=(1, 2)))
        return usable


class Observer(NamedTuple):
    """From where a report was made.

    Attributes:
        site: the carrier's reported position at the report's stamp.
        moved_m: (n, 2) its way east and north from there to each log.
    """

    site: Site
    moved_m: Array


@np.errstate(all="ignore")  # numbers from the wire may be anything within its bounds
def places(
    report: SourceReport, properties: SourceProperties, observer: Observer, altitude_m: float
) -> Places:
    """Positions of a report's logs, each from the first coordinates it has.

    Bearing and range come first, then cartesian, then geodetic. Geodetic logs are taken as what the
    carrier made of its own measurements, with its own pose: every source of a carrier shares its
    frame, and a feed that knows absolute positions is a carrier of its own.

    Args:
        properties: default sigmas of the source.
        altitude_m: of targets whose logs say nothing of it.
    """
    readings = [
        read(report, properties, observer, altitude_m)
        for column, read in _READERS
        if getattr(report, column) is not None
    ]
    return _first_located(readings, len(report), altitude_m)


def _first_located(readings: list[Places], n: int, altitude_m: float) -> Places:
    """Log by log the first reading that has a position."""
    if not readings:
        nowhere, height = np.full((n, 2), np.nan), np.full(n, altitude_m)
        return Places(nowhere, nowhere[..., None] * [1, 1], height, np.zeros(n, dtype=bool))
    best = readings[0]
    for reading in readings[1:]:
        known = best.located
        best = Places(
            np.where(known[:, None], best.east_north_m, reading.east_north_m),
            np.where(known[:, None, None], best.covariance, reading.covariance),
            np.where(known, best.altitude_m, reading.altitude_m),
            np.where(known, best.defaulted, reading.defaulted),
        )
    return best


def _polar(
    report: SourceReport, properties: SourceProperties, observer: Observer, altitude_m: float
) -> Places:
    """Logs with bearing and range, and with elevation or at the given altitude."""
    n = len(report)
    bearing, slant = column(report.bearing_rad, n), column(report.range_m, n)
    elevation = column(report.elevation_rad, n)
    elevated = np.isfinite(elevation)
    level = np.where(elevated, slant * np.cos(elevation), np.nan)
    plain = np.isfinite(bearing + slant) & ~elevated
    if plain.any():
        flat = level_plane(observer.site, observer.site, bearing[plain], slant[plain], altitude_m)
        level[plain] = np.hypot(flat[:, 0], flat[:, 1])
    east_north = level[:, None] * _direction(bearing)
    altitude = _altitudes(observer.site, east_north, slant * np.sin(elevation), altitude_m)

    polar, defaulted = _polar_covariance(report, properties, elevated)
    reach = np.maximum(level, _underfoot(slant, polar))
    by_polar = _by_polar(bearing, slant, elevation, reach)
    covariance = by_polar @ polar @ transposed(by_polar)
    return Places(east_north, covariance, altitude, defaulted & np.isfinite(level))


def _direction(bearing: Array) -> Array:
    """East and north (n, 2) of unit vectors along bearings."""
    direction = np.empty((len(bearing), 2))
    np.sin(bearing, out=direction[:, 0])
    np.cos(bearing, out=direction[:, 1])
    return direction


def _underfoot(slant: Array, polar: Array) -> Array:
    """How far aside (n,) a log may be [m] that says straight above or below.

    level^2 = slant^2 - up^2 errs by 2 slant sigma: below the root of half of that a level range,
    and with it the direction, is noise, and what it grows by with slant range has no limit. An
    elevation leaves slant sigma.
    """
    by_range = np.sqrt(slant * np.sqrt(polar[:, 1, 1]))
    return np.where(polar[:, 2, 2] > 0, slant * np.sqrt(polar[:, 2, 2]), by_range)


def _by_polar(bearing: Array, slant: Array, elevation: Array, level: Array) -> Array:
    """Derivatives (n, 2, 3) of east and north by bearing, slant range and elevation.

    Without elevation the altitude is what is known, level^2 = slant^2 - up^2, and level grows by
    slant / level for each metre of slant range.
    """
    elevated = np.isfinite(elevation)
    with np.errstate(divide="ignore", invalid="ignore"):
        level_by_slant = np.where(elevated, np.cos(elevation), slant / level)
    level_by_elevation = np.where(elevated, -slant * np.sin(elevation), 0.0)
    along = _direction(bearing)
    by_polar = np.empty((len(bearing), 2, 3))
    by_polar[:, 0, 0], by_polar[:, 1, 0] = level * along[:, 1], -level * along[:, 0]
    by_polar[:, :, 1] = level_by_slant[:, None] * along
    by_polar[:, :, 2] = level_by_elevation[:, None] * along
    return by_polar


def _polar_covariance(
    report: SourceReport, properties: SourceProperties, elevated: Flags
) -> tuple[Array, Flags]:
    """Covariance (n, 3, 3) of bearing, range and elevation; (n,) where the source's sigmas served.

    A 2 x 2 covariance beside an elevation leaves the third sigma to its own column.
    """
    n = len(report)
    columns = (report.sigma_bearing_rad, report.sigma_range_m, report.sigma_elevation_rad)
    stated = np.array([column(sigmas, n) for sigmas in columns]).T
    stated[~elevated, 2] = 0.0
    whole = _matrices(report.covariance_polar, n, 3)
    has_whole, has_third = np.isfinite(whole[:, 0, 0]), np.isfinite(whole[:, 2, 2])
    absent = np.isnan(stated) & ~np.array([has_whole, has_whole, has_third]).T
    default = _numbers(
        properties.sigma_bearing_rad, properties.sigma_range_m, properties.sigma_elevation_rad
    )
    covariance = np.zeros((n, 3, 3))
    covariance[:, (0, 1, 2), (0, 1, 2)] = np.where(np.isnan(stated), default, stated) ** 2
    covariance[has_whole, :2, :2] = whole[has_whole, :2, :2]
    covariance[has_third] = whole[has_third]
    return covariance, absent.any(axis=1)


def _cartesian(
    report: SourceReport, properties: SourceProperties, observer: Observer, altitude_m: float
) -> Places:
    """Logs with east and north of the carrier, and perhaps up."""
    n = len(report)
    east_north = np.array([column(report.east_m, n), column(report.north_m, n)]).T
    altitude = _altitudes(observer.site, east_north, column(report.up_m, n), altitude_m)
    covariance, defaulted = _position_covariance(report, properties)
    return Places(east_north, covariance, altitude, defaulted & np.isfinite(east_north[:, 0]))


def _geodetic(
    report: SourceReport, properties: SourceProperties, observer: Observer, altitude_m: float
) -> Places:
    """Logs with latitude and longitude, and perhaps altitude."""
    n = len(report)
    latitude, longitude = column(report.latitude_rad, n), column(report.longitude_rad, n)
    altitude = column(report.altitude_m, n)
    altitude[np.isnan(altitude)] = altitude_m
    given = np.isfinite(latitude + longitude)
    east_north = np.full((n, 2), np.nan)
    point = latitude[given], longitude[given], altitude[given]
    east_north[given] = enu_from_geodetic(observer.site, *point)[:, :2]
    covariance, defaulted = _position_covariance(report, properties)
    return Places(east_north - observer.moved_m, covariance, altitude, defaulted & given)


def _position_covariance(report: SourceReport, properties: SourceProperties) -> tuple[Array, Flags]:
    """Covariance (n, 2, 2) of east and north; (n,) where the source's sigma served."""
    n = len(report)
    whole = _matrices(report.covariance_position, n, 3)[:, :2, :2]
    stated = column(report.sigma_position_m, n)
    sigma = np.where(np.isnan(stated), _numbers(properties.sigma_position_m), stated)
    has_whole = np.isfinite(whole[:, 0, 0])
    round_ones = np.square(sigma)[:, None, None] * np.eye(2)
    return np.where(has_whole[:, None, None], whole, round_ones), np.isnan(stated) & ~has_whole


def _altitudes(carrier: Site, east_north: Array, up: Array, altitude_m: float) -> Array:
    """Altitude (n,) of points whose up is known, `altitude_m` of the others."""
    altitude = np.full(len(up), altitude_m)
    known = np.isfinite(up) & np.isfinite(east_north).all(axis=1)
    if known.any():
        enu = np.concatenate([east_north, up[:, None]], axis=1)[known]
        altitude[known] = geodetic_from_enu(carrier, enu)[2]
    return altitude


def column(values: Sequence[float | None] | None, n: int) -> Array:
    """A column of a report as an array (n,), nan where it or a cell of it is absent."""
    return np.full(n, np.nan) if values is None else np.array(values, dtype=float)


def instants_ns(report: SourceReport) -> NDArray[np.int64]:
    """When each log of a report was measured (n,)."""
    n = len(report)
    if report.time_offset_s is None:
        return np.full(n, report.t_ns, dtype=np.int64)
    offset_s: Array = np.nan_to_num(np.array(report.time_offset_s, dtype=np.float64))
    return report.t_ns + np.rint(offset_s / NS).astype(np.int64)


def _numbers(*values: float | None) -> Array:
    return np.array(values, dtype=float)


def _matrices(triangles: Sequence[list[float] | None] | None, n: int, order: int) -> Array:
    """Upper triangles as matrices (n, order, order), nan where they do not reach."""
    matrices = np.full((n, order, order), np.nan)
    for matrix, triangle in zip(matrices, triangles or (), strict=False):
        if triangle is not None:
            size = 2 if len(triangle) == 3 else 3
            rows, columns = np.triu_indices(size)
            matrix[rows, columns] = matrix[columns, rows] = triangle
    return matrices


_READERS: tuple[tuple[str, Callable[..., Places]], ...] = (
    ("bearing_rad", _polar),
    ("east_m", _cartesian),
    ("latitude_rad", _geodetic),
)
