"""A start for the alignment when nothing is known before: squared ranges are linear.

With D the travel by dead reckoning since the start, s measured from there, rho the range:

    (rho - d)^2 = |D + W t - s|^2
    rho^2 - |D|^2 = 2 t D.W + t^2 |W|^2 - 2 D.s - 2 t W.s + (|s|^2 - d^2) + 2 d rho

is linear in (W, |W|^2) and, beacon by beacon, (s, W.s, |s|^2 - d^2, d): least squares gives a place
within some hundred metres, which is near enough for `align`. A level path cannot tell above from
below: the beacon is put above.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.system_alignment.logs import DeadReckoning, Ranges
from estimation.system_alignment.parameters import WIND, Prior, offsets_of, places_of

_FLAT = 0.1  # of the median range: least height to start from, for at none the ranges do not pull


def closed_form_start(path: DeadReckoning, logs: Ranges, prior: Prior) -> Array:
    """Constants (7 + 4 J,) from ranges alone; what a prior is still needed for is which are known.

    Offsets are found where they have a prior sigma, else taken from the prior's mean. Scales,
    heading bias and clock stay as the prior has them, and so do beacons that were never heard;
    heights are those over a level path.

    Raises:
        ValueError: there are range differences, whose squares are not linear.
    """
    if np.any(logs.reference >= 0):
        raise ValueError("the closed form needs ranges: got range differences")
    theta, beacons = prior.mean.copy(), prior.beacons
    open_offsets = np.isin(offsets_of(theta), prior.free)
    solved = _solved(path, logs, theta, open_offsets)
    wind, each = solved[:2], solved[3:].reshape(beacons, 5)
    if np.isin(np.arange(2), prior.free).all():
        theta[WIND] = wind
    offset = np.where(open_offsets, each[:, 4], 0.0)
    level = each[:, :2]
    squared = each[:, 3] + offset**2 - np.sum(level**2, axis=1)
    heard = np.bincount(logs.beacon, minlength=beacons) > 0
    least = [
        _FLAT * np.median(logs.value_m[logs.beacon == i]) if heard[i] else 0.0
        for i in range(beacons)
    ]
    height = np.sqrt(np.maximum(squared, np.square(least)))
    found = np.column_stack([level + path.start_m, height])
    found[:, 2] += path.height_m[0]
    where = places_of(theta)
    free = np.isin(where, prior.free) & heard[:, None]
    theta[where[free]] = found[free]
    open_offsets &= heard
    theta[offsets_of(theta)[open_offsets]] = offset[open_offsets]
    return theta


def _solved(
    path: DeadReckoning, logs: Ranges, theta: Array, open_offsets: NDArray[np.bool_]
) -> Array:
    """(3 + 5 J,): W, |W|^2; of each beacon s east, north, W.s, |s|^2 - d^2, d."""
    beacons = len(open_offsets)
    travel = (path.path_m - path.start_m)[logs.epoch]
    t = path.time_s[logs.epoch]
    value = logs.value_m - np.where(open_offsets, 0.0, theta[offsets_of(theta)])[logs.beacon]
    rows = np.zeros((len(value), 3 + 5 * beacons))
    rows[:, :2], rows[:, 2] = 2 * t[:, None] * travel, t**2
    own = 3 + 5 * logs.beacon[:, None] + np.arange(5)
    parts = np.column_stack([-2 * travel, -2 * t, np.ones_like(t), 2 * value])
    parts[:, 4] *= open_offsets[logs.beacon]
    np.put_along_axis(rows, own, parts, axis=1)
    right = value**2 - np.sum(travel**2, axis=1)
    walked = np.cumsum(path.covariance[:, [0, 1], [0, 1]].sum(axis=1))[logs.epoch] / 2
    sigma = 2 * np.maximum(value, 1.0) * np.sqrt(logs.sigma_m**2 + walked)
    scaled = rows / sigma[:, None]
    size = np.maximum(np.linalg.norm(scaled, axis=0), 1e-12)
    found, *_ = np.linalg.lstsq(scaled / size, right / sigma, rcond=1e-10)
    solved: Array = found / size
    return solved
