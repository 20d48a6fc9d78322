"""What a source's ranges are to be corrected by, and what a frame found without it hangs on.

b + s r is added to a range r: a bias [m] and a scale, constant over a run. Both are known to a
covariance at most, and whatever uses them considers the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, transposed
from estimation.frames import rotation_clockwise
from estimation.relative_frame.logs import OwnAxesFrame

_LEAST_M = 1.0  # from the sensor: nearer, the direction means nothing


class RangeErrors(NamedTuple):
    """What is to be added to the ranges of a source.

    Attributes:
        mean: (2,) b [m] and s; covariance: (2, 2).
    """

    mean: Array
    covariance: Array

    @property
    def none(self) -> bool:
        """Whether the ranges are right as they are."""
        return not (self.mean.any() or self.covariance.any())

    def added(self, places_m: Array) -> Array:
        """(n, 2) what moves places (n, 2), east and north of the source, to where they are."""
        return np.asarray(along(places_m) @ self.mean)

    def spread(self, places_m: Array) -> Array:
        """Covariances (n, 2, 2) of that, each by itself."""
        by = along(places_m)
        return np.asarray(by @ self.covariance @ transposed(by))


NO_RANGE_ERRORS = RangeErrors(np.zeros(2), np.zeros((2, 2)))


def declared(sigma_bias_m: float, sigma_scale: float) -> RangeErrors:
    """What is known beforehand: nothing but sigmas."""
    return RangeErrors(np.zeros(2), np.diag(np.square([sigma_bias_m, sigma_scale])))


def along(places_m: Array) -> Array:
    """(n, 2, 2) by what b and s move places (n, 2) east and north of the source."""
    far = np.maximum(np.hypot(*places_m.T), _LEAST_M)
    return np.stack([places_m / far[:, None], places_m], axis=-1)


class Seen(NamedTuple):
    """L targets as one carrier sees them.

    Attributes:
        places_m: (L, 2) relative to it, what is known of range errors added.
        covariance: (L, 2, 2) with what is open of them as if it were noise, `RangeErrors.spread`.
        ranges: what is known of them.
    """

    places_m: Array
    covariance: Array
    ranges: RangeErrors


def considered(frame: OwnAxesFrame, own: Seen, other: Seen) -> tuple[OwnAxesFrame, Array]:
    """A frame from pairs in which range errors passed for noise: what it really hangs on.

    Such a frame has the wrong covariance: the errors of all pairs are two numbers a carrier.

    Args:
        frame: from the pairs of these places with these covariances.

    Returns:
        The frame with the covariance it would have if the range errors were known, and its
        derivative (3, 4) by (b, s) of the own carrier and of the other.
    """
    turn = rotation_clockwise(frame.D_rad)
    gain = gains(frame, own.covariance, other.places_m, other.covariance)
    ranges = own.ranges.spread(own.places_m)
    ranges = ranges + turn @ other.ranges.spread(other.places_m) @ turn.T
    left = frame.covariance - (gain @ ranges @ transposed(gain)).sum(axis=0)
    by_own = (gain @ along(own.places_m)).sum(axis=0)
    by_other = -(gain @ turn @ along(other.places_m)).sum(axis=0)
    return frame._replace(covariance=(left + left.T) / 2), np.hstack([by_own, by_other])


def gains(frame: OwnAxesFrame, own: Array, seen_m: Array, seen: Array) -> Array:
    """(L, 3, 2) by what a frame moves with each own place of the pairs that it is from.

    Args:
        own: (L, 2, 2) covariances of the own places.
        seen_m, seen: (L, 2), (L, 2, 2) places relative to the other carrier, and covariances.
    """
    turn = rotation_clockwise(frame.D_rad)
    away = seen_m @ turn.T
    by_frame = np.zeros((len(away), 2, 3))
    by_frame[:, 0, 0] = by_frame[:, 1, 1] = 1.0
    by_frame[:, 0, 2], by_frame[:, 1, 2] = away[:, 1], -away[:, 0]
    spread = own + turn @ seen @ turn.T
    return np.asarray(frame.covariance @ transposed(by_frame) @ np.linalg.inv(spread))
