"""Points in the plane: cartesian logs, and geodetic ones brought there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.tracking.measurements.kinds import Found, Probe, Row
from estimation.tracking.measurements.line_of_sight import (
    longest_axis,
    most,
    timed,
)


class Places(NamedTuple):
    """Points in the plane of m plots (geodetic ones are brought there by `frames`), see `places`.

    Attributes:
        place_m: (2, m); covariance_m2: (2, 2, m).
    """

    place_m: Array
    covariance_m2: Array
    offset_s: Array
    sigma_offset_s: Array

    @property
    def size(self) -> int:
        """See `Measurement`."""
        return int(self.place_m.shape[-1])

    def rows(self, mean: Array, plot: Indices) -> list[Row]:
        """East, then what north says beyond its correlation with east."""
        east, both, north = self.covariance_m2[[0, 0, 1], [0, 1, 1]][:, plot]
        slope = both / east
        offset = self.offset_s[plot]
        miss = self.place_m[:, None, plot] - mean[:2] - mean[2:] * offset
        one, none = np.ones(miss.shape[1:]), np.zeros(miss.shape[1:])
        first = np.stack([one, none, offset * one, none])
        second = np.stack([-slope * one, one, -slope * offset * one, offset * one])
        late = self.sigma_offset_s[plot]
        beyond = miss[1] - slope * miss[0]
        return [
            timed(Row(first, miss[0], east * one), mean, late),
            timed(Row(second, beyond, (north - slope * both) * one), mean, late),
        ]

    def found(self) -> Found:
        """See `Measurement`."""
        return Found(self.place_m, self.covariance_m2, np.ones(self.size))

    def beside(self, mean: Array) -> list[Row]:
        """See `Measurement`."""
        return []

    def probes(self, place_m: Array, covariance_m2: Array) -> list[Probe]:
        """In the plane."""
        one = np.ones(place_m.shape[-1])
        spread = longest_axis(covariance_m2).max(axis=0) + most(longest_axis(self.covariance_m2))
        return [Probe(self.place_m.T, np.arange(self.size), place_m.T, spread, one, one)]


def places(
    place_m: Array,
    covariance_m2: Array,
    offset_s: Array | float = 0.0,
    sigma_offset_s: Array | float = 0.0,
) -> Places:
    """Points (m, 2) with covariances (m, 2, 2) or one for all."""
    point = np.asarray(place_m, dtype=float)
    spread = np.broadcast_to(np.asarray(covariance_m2, dtype=float), (len(point), 2, 2))
    late, jitter = (np.broadcast_to(value, len(point)) for value in (offset_s, sigma_offset_s))
    return Places(point.T, np.moveaxis(spread, 0, -1), late, jitter)
