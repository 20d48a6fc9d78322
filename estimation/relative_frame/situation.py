"""Why a registration is undetermined: geometries that hide something, each in a sentence.

`observability` measures *that* a direction is unknown; here is the reason an operator can act on.
"""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array
from estimation.frames import east_north_from_polar
from estimation.relative_frame.logs import PolarLogs

_CLUSTER = 3.0  # spread of the targets by the sigma of a place, below which they count as one
_CONVOY_MPS = 1.0  # spread of velocities below which a clock offset is a shift
_CIRCLE = 0.02  # of the radius: how near the danger circle is on it

NO_TARGET = "no common target: nothing is known beyond navigation"
ONE_TARGET = (
    "one common target: it fixes a place, but any turn about it fits as well; "
    "location and orientation stay tied together until a second target is shared"
)
TWO_BEARING_ONLY = (
    "two bearing-only carriers at one instant: two bearings fix the target and leave nothing "
    "for the frames; wait for motion, a range, or a third carrier"
)
TOO_FEW_BEARINGS = (
    "a bearing-only carrier with fewer than three common targets: each gives one condition, "
    "location and orientation need three"
)
CONVOY = "all targets move alike (a convoy): a clock offset looks like a shift of the place"
NO_VELOCITY = "targets come without velocities: a clock offset looks like a shift of the place"


def reasons(own: PolarLogs, other: PolarLogs) -> list[str]:
    """Why (q, D) of two carriers that measure range and bearing may be undetermined.

    Args:
        own: (L,) associated logs.
        other: (L,) of the same targets.

    Returns:
        Sentences; none when two targets stand well apart.
    """
    if own.count == 0:
        return [NO_TARGET]
    if own.count == 1:
        return [ONE_TARGET]
    places = east_north_from_polar(own.bearing_rad, own.range_m)
    spread = _spread_m(places)
    sigma = float(np.mean(_place_sigma_m(own) ** 2 + _place_sigma_m(other) ** 2)) ** 0.5
    if spread < _CLUSTER * sigma:
        return [
            f"all {own.count} targets lie within {2 * spread:.0f} m of each other, no more than "
            f"their errors of {sigma:.0f} m (a cluster): they count as one and hide the heading"
        ]
    return []


def bearing_only_reasons(targets_m: Array, carrier_m: Array, *, both: bool) -> list[str]:
    """Why a carrier that measures bearings only may be undetermined.

    Args:
        targets_m: (L, 2) places of the common targets in own axes.
        carrier_m: (2,) where the other carrier is thought to be.
        both: the own carrier measures no ranges either.
    """
    if both:
        return [TWO_BEARING_ONLY]
    if len(targets_m) < 3:
        return [TOO_FEW_BEARINGS]
    centre, radius = _circle(targets_m)
    off = np.abs(np.linalg.norm(np.vstack([targets_m, carrier_m]) - centre, axis=1) - radius)
    if off.max() < _CIRCLE * radius:
        return [
            f"the other carrier and all targets lie on one circle of {radius:.0f} m (the danger "
            "circle): bearings alone cannot place it there; one target off the circle would"
        ]
    return []


def clock_reasons(velocity_mps: Array | None) -> list[str]:
    """Why a clock offset may be hidden, from the targets' velocities (L, 2)."""
    if velocity_mps is None:
        return [NO_VELOCITY]
    return [CONVOY] if _spread_m(velocity_mps) < _CONVOY_MPS else []


def _spread_m(points: Array) -> float:
    """Largest distance from the mean of (L, 2) points."""
    return float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())


def _place_sigma_m(logs: PolarLogs) -> Array:
    """Root mean square error (L,) of each place."""
    across = logs.covariance[..., 0, 0] * logs.range_m**2
    root: Array = np.sqrt(across + logs.covariance[..., 1, 1])
    return root


def _circle(points: Array) -> tuple[Array, float]:
    """Centre and radius of the circle through (L, 2) points, by least squares."""
    mean = points.mean(axis=0)
    x = points - mean
    design = np.column_stack([2 * x, np.ones(len(x))])
    solution, *_ = np.linalg.lstsq(design, np.square(x).sum(axis=1), rcond=None)
    return mean + solution[:2], float(np.sqrt(max(solution[2] + solution[:2] @ solution[:2], 0)))
