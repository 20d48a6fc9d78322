"""Bearings alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.frames import wrap_pi
from estimation.tracking.measurements.kinds import Probe, Row
from estimation.tracking.measurements.line_of_sight import (
    LEAST_M,
    columns,
    longest_axis,
    most,
    place_row,
    seen_from,
    timed,
)


class Bearings(NamedTuple):
    """Bearings alone of m plots; all arrays (m,), see `bearings`. They begin no tracks."""

    site_m: Array
    bearing_rad: Array
    sigma_bearing_rad: Array
    offset_s: Array
    sigma_offset_s: Array

    @property
    def size(self) -> int:
        """See `Measurement`."""
        return len(self.bearing_rad)

    def rows(self, mean: Array, plot: Indices) -> list[Row]:
        """See `Measurement`."""
        seen = seen_from(self.site_m, mean, self.offset_s[plot])
        turned = wrap_pi(self.bearing_rad[plot] - seen.bearing_rad)
        across = place_row(seen, seen.across / seen.range_m, turned, self.sigma_bearing_rad[plot])
        return [timed(across, mean, self.sigma_offset_s[plot])]

    def found(self) -> None:
        """See `Measurement`."""
        return

    def beside(self, mean: Array) -> list[Row]:
        """See `Measurement`."""
        return []

    def probes(self, place_m: Array, covariance_m2: Array) -> list[Probe]:
        """On the unit circle about the sensor."""
        away = place_m - self.site_m[:, None]
        far = np.maximum(np.hypot(*away), LEAST_M)
        circle = np.stack([np.sin(self.bearing_rad), np.cos(self.bearing_rad)], axis=-1)
        spread = longest_axis(covariance_m2).max(axis=0) / far**2
        spread = spread + most(self.sigma_bearing_rad) ** 2
        every = np.arange(self.size)
        return [Probe(circle, every, (away / far).T, spread, 1.0 / far, far**2)]


def bearings(
    site_m: Array,
    bearing_rad: Array,
    sigma_bearing_rad: Array | float,
    offset_s: Array | float = 0.0,
    sigma_offset_s: Array | float = 0.0,
) -> Bearings:
    """Bearings of a passive sensor at `site_m` (2,); the rest as `polar`."""
    given = columns(bearing_rad, sigma_bearing_rad, offset_s, sigma_offset_s)
    return Bearings(np.asarray(site_m, dtype=float), *given)
