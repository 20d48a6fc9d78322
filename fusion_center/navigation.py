"""Where a carrier believes it is at any instant, and how far it believes it has come.

Between and after its messages a carrier is carried on with its dead-reckoned way, in a straight
line. A position fix makes the reported place jump; the way never does, so that logs taken before
and after a fix still lie together.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.frames import Site, site_at
from schemas.messages import DeclaredCarrier, Navigation, Pose

NS = 1e-9


def with_message(navigation: tuple[Navigation, ...], news: Navigation) -> tuple[Navigation, ...]:
    """The last two messages, oldest first; of two with one stamp the later sent stays."""
    earlier = tuple(message for message in navigation if message.t_ns < news.t_ns)
    later = tuple(message for message in navigation if message.t_ns > news.t_ns)
    return (*earlier, news, *later)[-2:]


def velocity_mps(navigation: Sequence[Navigation]) -> Array:
    """East and north velocity (2,), from the way between two messages or else from the speed."""
    newest = navigation[-1]
    if len(navigation) == 2:
        passed_s = (newest.t_ns - navigation[0].t_ns) * NS
        return (_reckoned_m(newest) - _reckoned_m(navigation[0])) / passed_s
    heading = newest.pose.heading_rad
    return newest.speed_mps * np.array([np.sin(heading), np.cos(heading)])


def way_m(navigation: Sequence[Navigation], t_ns: int | NDArray[np.int64]) -> Array:
    """Dead-reckoned way (..., 2) east and north since the boot, at instants (...)."""
    newest = navigation[-1]
    passed_s = np.multiply(np.asarray(t_ns, dtype=np.int64) - newest.t_ns, NS)
    way: Array = _reckoned_m(newest) + velocity_mps(navigation) * passed_s[..., None]
    return way


def pose_at(navigation: Sequence[Navigation], t_ns: int) -> Pose:
    """The reported pose, carried on from the newest message to an instant."""
    newest = navigation[-1]
    if t_ns == newest.t_ns:
        return newest.pose
    east, north = (way_m(navigation, t_ns) - _reckoned_m(newest)).tolist()
    there = _moved(site(newest.pose), east, north)
    return replace(newest.pose, latitude_rad=there.latitude_rad, longitude_rad=there.longitude_rad)


@lru_cache(maxsize=64)
def _moved(start: Site, east_m: float, north_m: float) -> Site:
    """A place this far east and north; asked again and again for the reports of one instant."""
    return site_at(start, [east_m, north_m, 0.0])


def carried_sigma_m(navigation: Sequence[Navigation], t_ns: int, sigma_speed_mps: float) -> float:
    """Sigma per axis of the way since the newest message, its speed and heading being wrong alike.

    Args:
        sigma_speed_mps: where the carrier states none.
    """
    newest = navigation[-1]
    along = newest.sigma_speed_mps or sigma_speed_mps
    across = float(np.hypot(*velocity_mps(navigation))) * (newest.sigma_heading_rad or 0.0)
    return float(np.hypot(along, across)) * abs(t_ns - newest.t_ns) * NS


def site(pose: Pose) -> Site:
    """The place of a pose."""
    return Site(pose.latitude_rad, pose.longitude_rad, pose.altitude_m)


def frame_covariance(pose: Pose, declared: DeclaredCarrier | None) -> Array | None:
    """Covariance (3, 3) of the error of a carrier's frame: east, north [m], north direction [rad].

    What the carrier states with its pose comes before what the scenario declares; None if neither
    says anything.
    """
    if pose.covariance is not None:
        order = 3 if len(pose.covariance) == 6 else 6
        full = symmetric(pose.covariance, order)
        return full if order == 3 else full[np.ix_((0, 1, 3), (0, 1, 3))]
    if declared is None:
        return None
    sigmas = [declared.sigma_position_m] * 2 + [declared.sigma_north_rad]
    return np.diag(np.square(sigmas))


def symmetric(triangle: Sequence[float], order: int) -> Array:
    """The matrix of an upper triangle as it travels, row by row."""
    matrix = np.zeros((order, order))
    rows, columns = upper_triangle(order)
    matrix[rows, columns] = matrix[columns, rows] = triangle
    return matrix


def triangle_of(matrix: Array) -> list[float]:
    """The upper triangle of a matrix, row by row, as it travels."""
    triangle: list[float] = matrix[upper_triangle(len(matrix))].tolist()
    return triangle


@cache
def upper_triangle(order: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row and column indices of an upper triangle, row by row."""
    rows, columns = np.triu_indices(order)
    return rows, columns


def _reckoned_m(message: Navigation) -> Array:
    return np.array([message.reckoned_east_m, message.reckoned_north_m])
