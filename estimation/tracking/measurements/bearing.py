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

    def probe(self, place_m: Array) -> Probe:
        """See `Measurement`."""
        offset = place_m - self.site_m[:, None]
        far = np.maximum(np.hypot(*offset), LEAST_M)
        plots = np.stack([np.sin(self.bearing_rad), np.cos(self.bearing_rad)], axis=-1)
        sigma = np.full(far.shape, most(self.sigma_bearing_rad))
        return Probe(plots, (offset / far).T, sigma, 1.0 / far)


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
