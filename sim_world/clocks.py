"""Clocks of carriers and sensors: what time they believe it is."""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array, ArrayLike


def clock_offset_s(t_s: ArrayLike, start_s: float, drift_ppm: float) -> Array:
    """Clock less true time at times `t_s` of the scenario: an offset that grows steadily."""
    return start_s + drift_ppm * 1e-6 * np.asarray(t_s, dtype=float)


def stamp_ns(true_ns: int, *offsets_s: float) -> int:
    """What a clock with these offsets shows at a true time; the sum in whole nanoseconds."""
    return max(true_ns + round(sum(offsets_s) * 1e9), 0)
