"""The constants of a system alignment: their order, their names, what is known before.

theta = (wind east, north; speed scale; heading bias; range scale; clock offset, drift;
x, y, z of each beacon; offset d of each beacon). A constant of no prior variance is known.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike

WIND, SPEED_SCALE, HEADING_BIAS, RANGE_SCALE = slice(0, 2), 2, 3, 4
CLOCK_OFFSET, CLOCK_DRIFT, FIRST_BEACON = 5, 6, 7

_COMMON = (
    "wind east",
    "wind north",
    "speed scale",
    "heading bias",
    "range scale",
    "clock offset",
    "clock drift",
)
_MOST_BEACONS = 1024
_INDICES = FIRST_BEACON + np.arange(3 * _MOST_BEACONS).reshape(-1, 3)
_UNITS = ("m/s", "m/s", "", "rad", "", "m", "m/s")


class Prior(NamedTuple):
    """What is known of theta before the first range.

    Attributes:
        mean: (7 + 4 J,).
        covariance: (7 + 4 J, 7 + 4 J); rows of zeros where a constant is known.
    """

    mean: Array
    covariance: Array

    @property
    def beacons(self) -> int:
        """J."""
        return _beacons(self.mean)

    @property
    def free(self) -> NDArray[np.intp]:
        """Indices of the constants that are not known."""
        return np.flatnonzero(np.diag(self.covariance) > 0)

    @property
    def names(self) -> list[str]:
        """Of all constants, beacons counted from 1."""
        places = [f"{c} of beacon {i + 1}" for i in range(self.beacons) for c in "xyz"]
        return [*_COMMON, *places, *(f"offset of beacon {i + 1}" for i in range(self.beacons))]

    @property
    def units(self) -> list[str]:
        """Of all constants."""
        return [*_UNITS, *(["m"] * (4 * self.beacons))]


def prior(  # noqa: PLR0913  (each constant with its sigma; all but the beacons default to known)
    beacons_m: ArrayLike,
    sigma_beacon_m: ArrayLike,
    *,
    wind_mps: ArrayLike = (0.0, 0.0),
    sigma_wind_mps: ArrayLike = 0.0,
    offset_m: ArrayLike = 0.0,
    sigma_offset_m: ArrayLike = 0.0,
    sigma_speed_scale: float = 0.0,
    sigma_heading_bias_rad: float = 0.0,
    sigma_range_scale: float = 0.0,
    sigma_clock_offset_m: float = 0.0,
    sigma_clock_drift_mps: float = 0.0,
) -> Prior:
    """A prior of independent constants.

    Args:
        beacons_m: (J, 3).
        sigma_beacon_m: scalar, (3,) or (J, 3); 0 for a surveyed coordinate.
        wind_mps: (2,) wind or current, with its sigma.
        offset_m: scalar or (J,) regular error of the ranges to each beacon, with its sigma. Of
            differences it is that of the pair; give the reference none.
    """
    places = np.asarray(beacons_m, dtype=float)
    count = len(places)
    mean = np.zeros(FIRST_BEACON + 4 * count)
    sigma = np.zeros_like(mean)
    mean[WIND], sigma[WIND] = wind_mps, sigma_wind_mps
    sigma[SPEED_SCALE : CLOCK_DRIFT + 1] = (
        sigma_speed_scale,
        sigma_heading_bias_rad,
        sigma_range_scale,
        sigma_clock_offset_m,
        sigma_clock_drift_mps,
    )
    mean[places_of(mean)] = places
    sigma[places_of(mean)] = sigma_beacon_m
    mean[offsets_of(mean)], sigma[offsets_of(mean)] = offset_m, sigma_offset_m
    return Prior(mean, np.diag(sigma**2))


def places_of(theta: Array) -> NDArray[np.intp]:
    """Indices (J, 3) of the beacons' places among constants (7 + 4 J,)."""
    return _INDICES[: _beacons(theta)]


def offsets_of(theta: Array) -> NDArray[np.intp]:
    """Indices (J,) of the beacons' offsets among constants (7 + 4 J,)."""
    return np.arange(len(theta) - _beacons(theta), len(theta))


def _beacons(theta: Array) -> int:
    return (len(theta) - FIRST_BEACON) // 4
