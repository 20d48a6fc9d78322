"""Targets as a sensor sees them, and equations of what it measures of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, broadcast
from estimation.tracking.measurements.kinds import Row

LEAST_M = 1.0  # from the sensor: nearer, the direction means nothing


class Seen(NamedTuple):
    """Predicted targets from a sensor: unit vectors along and clockwise across, (2, 2, k)."""

    unit: Array
    across: Array
    range_m: Array
    bearing_rad: Array
    offset_s: Array


def seen_from(site_m: Array, mean: Array, offset_s: Array) -> Seen:
    """Targets of states (4, 2, k), each `offset_s` (k,) after its state, from `site_m` (2,)."""
    away = mean[:2] + mean[2:] * offset_s - site_m[:, None, None]
    far = np.maximum(np.hypot(away[0], away[1]), LEAST_M)
    unit = away / far
    across = np.stack([unit[1], -unit[0]])
    return Seen(unit, across, far, np.arctan2(away[0], away[1]), offset_s)


def place_row(seen: Seen, slope: Array, residual: Array, sigma: Array) -> Row:
    """A value of the place alone, its gradient by the place (2, 2, k)."""
    variance = np.broadcast_to(sigma**2, residual.shape)
    return Row(np.concatenate([slope, slope * seen.offset_s]), residual, variance)


def timed(row: Row, mean: Array, sigma_offset_s: Array) -> Row:
    """An instant known to a sigma displaces the target by its velocity times that."""
    if not sigma_offset_s.any():
        return row
    rate = (row.gradient[:2] * mean[2:]).sum(axis=0)
    return row._replace(variance=row.variance + (rate * sigma_offset_s) ** 2)


def columns(*values: Array | float) -> tuple[Array, ...]:
    """The values as columns of one length."""
    return tuple(np.atleast_1d(column) for column in broadcast(*values))


def most(values: Array) -> float:
    """The largest, 0 of none."""
    return float(values.max()) if values.size else 0.0


def longest_axis(covariance: Array) -> Array:
    """Largest eigenvalue (...) of matrices (2, 2, ...)."""
    middle = (covariance[0, 0] + covariance[1, 1]) / 2
    half = (covariance[0, 0] - covariance[1, 1]) / 2
    axis: Array = middle + np.hypot(half, covariance[0, 1])
    return axis
