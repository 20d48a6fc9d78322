"""Which plots may be of which tracks: a search in boxes, before any algebra of pairs.

No plot within the ellipse of the gate is outside the upright box about it, and that box is known
from the variance of each reading alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimation.arrays import Array, Indices
from estimation.frames import wrap_pi
from estimation.tracking.innovations import Foretold
from estimation.tracking.measurements import PLACE_ROWS, Readings
from estimation.tracking.strips import inside

_TURN = 2 * math.pi


def near(told: Sequence[Foretold], readings: Readings, gate: float) -> tuple[Indices, Indices]:
    """Pairs (state, plot), by state, that hold every pair within the ellipse of `gate`.

    Args:
        told: of the states at the earliest and the latest instant of a plot; one if all are one.
        readings: of the scan.
        gate: Mahalanobis distance squared, under either model.
    """
    angles = readings.angle[:PLACE_ROWS]
    plot = np.flatnonzero(np.isfinite(readings.value[:PLACE_ROWS]).all(axis=0))
    points = np.zeros((PLACE_ROWS, len(plot)))
    low, high = np.zeros((2, PLACE_ROWS, told[0].value.shape[-1]))
    for row, angle in enumerate(angles):
        points[row] = readings.value[row, plot]
        low[row], high[row] = _sides(told, readings, row, gate)
        if angle:
            points[row] = wrap_pi(points[row])
            round_about = high[row] - low[row] >= _TURN
            low[row, round_about], high[row, round_about] = -np.pi, np.pi
            ends = float(low[row].min(initial=0.0)), float(high[row].max(initial=0.0))
            whose, points = _unrolled(points, row, *ends)
            plot = plot[whose]
    state, found = inside(low, high, points)
    return state, plot[found]


def _sides(
    told: Sequence[Foretold], readings: Readings, row: int, gate: float
) -> tuple[Array, Array]:
    """Least and largest reading (n,) that is within the gate of a state under any model."""
    noise = float(readings.covariance[row, row].max(initial=0.0))
    jitter = float(readings.sigma_offset_s.max(initial=0.0))
    centre = told[0].value[row, 0]
    lows, highs = [], []
    for each in told:
        half = np.sqrt(gate * (each.spread[row, row] + noise + (each.rate[row] * jitter) ** 2))
        away = each.value[row] - centre
        if readings.angle[row]:
            away = wrap_pi(away)
        lows.append((away - half).min(axis=0))
        highs.append((away + half).max(axis=0))
    return centre + np.min(lows, axis=0), centre + np.max(highs, axis=0)


def _unrolled(points: Array, row: int, low: float, high: float) -> tuple[Indices, Array]:
    """Points and, from `low` to `high`, their copies a turn away; and whose they are."""
    angle = points[row]
    after, before = (np.flatnonzero(mask) for mask in (angle + _TURN <= high, angle - _TURN >= low))
    whose = np.concatenate([np.arange(len(angle)), after, before])
    turned = points[:, whose]
    turned[row, len(angle) : len(angle) + len(after)] += _TURN
    turned[row, len(angle) + len(after) :] -= _TURN
    return whose, turned
