"""One report of one source, ready for the picture: what was seen, where it can see, how well."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.frames import wrap_pi
from estimation.tracking.features import Said
from estimation.tracking.innovations import Common
from estimation.tracking.measurements import Measurement

_LEAST = 1e-9  # of what is divided by


class View(NamedTuple):
    """What a sensor can see: a ring sector about it.

    Attributes:
        site_m: (2,) east, north.
        range_min_m, range_max_m: limits.
        start_rad, width_rad: the sector, clockwise from north; a full turn by default.
    """

    site_m: Array
    range_min_m: float = 0.0
    range_max_m: float = math.inf
    start_rad: float = 0.0
    width_rad: float = 2 * math.pi

    @property
    def everywhere(self) -> bool:
        """Whether it has no limits."""
        limited = self.range_min_m > 0 or math.isfinite(self.range_max_m)
        return not limited and self.width_rad >= 2 * math.pi

    def holds(self, place_m: Array) -> NDArray[np.bool_]:
        """Which of the places (2, ...) are in view."""
        east, north = (axis - site for axis, site in zip(place_m, self.site_m, strict=True))
        far = np.hypot(east, north)
        inside: NDArray[np.bool_] = (far >= self.range_min_m) & (far <= self.range_max_m)
        if self.width_rad < 2 * math.pi:
            turned = (np.arctan2(east, north) - self.start_rad) % (2 * math.pi)
            inside &= turned <= self.width_rad
        return inside

    def chance(self, place_m: Array, covariance_m2: Array) -> Array:
        """Probability (n,) that targets at places (2, n) of covariances (2, 2, n) are in view.

        Range and bearing as if they were independent and normal. A target at the edge is neither
        surely seen nor surely missed: else its plots would begin one new track after another.
        """
        if self.everywhere:
            return np.ones(place_m.shape[-1])
        from scipy.special import ndtr  # noqa: PLC0415  (0.1 s, at the first use)

        off = place_m - np.asarray(self.site_m)[:, None]
        far = np.maximum(np.hypot(*off), _LEAST)
        along = off / far
        across = np.stack([along[1], -along[0]])
        sigma_range, sigma_across = (
            np.sqrt(np.maximum(np.einsum("in,ijn,jn->n", axis, covariance_m2, axis), _LEAST))
            for axis in (along, across)
        )
        inside = ndtr((self.range_max_m - far) / sigma_range)
        inside -= ndtr((self.range_min_m - far) / sigma_range) if self.range_min_m else 0.0
        if self.width_rad < 2 * math.pi:
            middle = self.start_rad + self.width_rad / 2
            aside = np.abs(wrap_pi(np.arctan2(*off) - middle))
            inside *= ndtr((self.width_rad / 2 - aside) * far / sigma_across)
        return np.asarray(np.maximum(inside, 0.0))


class Scan(NamedTuple):
    """The plots of one source at one instant, in the picture frame.

    Attributes:
        t_ns: the instant.
        plots: the m measurements.
        view: where they can come from.
        detection: probability that a target in view gives a plot.
        clutter: expected false plots [1/m^2] (bearings alone: [1/rad]).
        common: error that all of them share, if any.
        evidence: (classes, m) likelihood of each plot's features if its target is of a class, over
            that if it is false; None without classes.
        features: what the plots say beside that; None = nothing.
    """

    t_ns: int
    plots: Measurement
    view: View
    detection: float
    clutter: float
    common: Common | None = None
    evidence: Array | None = None
    features: Said | None = None
