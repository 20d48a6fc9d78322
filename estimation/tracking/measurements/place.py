"""Points in the plane: cartesian logs, and geodetic ones brought there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.tracking.measurements.kinds import Expected, Found, Readings
from estimation.tracking.measurements.line_of_sight import by_state


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

    def readings(self) -> Readings:
        """See `Measurement`."""
        return Readings(
            self.place_m,
            self.covariance_m2,
            (False, False),
            (0.0, 0.0),
            self.offset_s,
            self.sigma_offset_s,
        )

    def expected(self, mean: Array, offset_s: Array | float) -> Expected:
        """See `Measurement`."""
        slope = np.zeros((2, 2, *mean.shape[1:]))
        slope[0, 0] = slope[1, 1] = 1.0
        east, north = (by_state(axis, offset_s) for axis in slope)
        return Expected(mean[:2] + mean[2:] * offset_s, np.stack([east, north]))

    def found(self) -> Found:
        """See `Measurement`."""
        return Found(self.place_m, self.covariance_m2, np.ones(self.size))


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
