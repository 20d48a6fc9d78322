"""Targets as a sensor sees them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, broadcast

LEAST_M = 1.0  # from the sensor: nearer, the direction means nothing


class Seen(NamedTuple):
    """Predicted targets from a sensor: unit vectors along and clockwise across, (2, 2, k)."""

    unit: Array
    across: Array
    range_m: Array
    bearing_rad: Array


def seen_from(site_m: Array, mean: Array, offset_s: Array | float) -> Seen:
    """Targets of states (4, 2, k), each `offset_s` (k,) after its state, from `site_m` (2,)."""
    away = mean[:2] - site_m[:, None, None]
    if np.any(offset_s):
        away = away + mean[2:] * offset_s
    far = np.maximum(np.hypot(away[0], away[1]), LEAST_M)
    unit = away / far
    across = np.stack([unit[1], -unit[0]])
    return Seen(unit, across, far, np.arctan2(away[0], away[1]))


def by_state(slope: Array, offset_s: Array | float) -> Array:
    """The gradient (4, 2, k) by the state of what has the slope (2, 2, k) by the place."""
    return np.concatenate([slope, slope * offset_s])


def columns(*values: Array | float) -> tuple[Array, ...]:
    """The values as columns of one length."""
    return tuple(np.atleast_1d(column) for column in broadcast(*values))


def independent(*sigmas: Array) -> Array:
    """Covariance (rows, rows, m) of readings whose noise has the sigmas (m,)."""
    covariance = np.zeros((len(sigmas), len(sigmas), len(sigmas[0])))
    for row, sigma in enumerate(sigmas):
        covariance[row, row] = sigma**2
    return covariance
