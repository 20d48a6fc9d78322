"""Bearings alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.tracking.measurements.kinds import Expected, Readings
from estimation.tracking.measurements.line_of_sight import (
    by_state,
    columns,
    independent,
    seen_from,
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

    def readings(self) -> Readings:
        """See `Measurement`."""
        return Readings(
            self.bearing_rad[None],
            independent(self.sigma_bearing_rad),
            (True,),
            (0.0,),
            self.offset_s,
            self.sigma_offset_s,
        )

    def expected(self, mean: Array, offset_s: Array | float) -> Expected:
        """See `Measurement`."""
        seen = seen_from(self.site_m, mean, offset_s)
        across = by_state(seen.across / seen.range_m, offset_s)
        return Expected(seen.bearing_rad[None], across[None])

    def found(self) -> None:
        """See `Measurement`."""
        return


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
