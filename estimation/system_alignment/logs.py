"""What an object brings to a system alignment: its dead reckoning, and ranges to beacons."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike, Indices, broadcast, transposed
from estimation.frames import east_north_by_polar, east_north_from_polar

_FLOOR_M = 1e-3  # a step's place is never known better: keeps a hover solvable


class DeadReckoning(NamedTuple):
    """Steps of an object through its medium, from a known start to n epochs.

    Attributes:
        interval_s: (n,) duration of step k, which ends at epoch k.
        travel_m: (n, 2) displacement east, north by speed and heading as measured.
        covariance: (n, 2, 2) of the travel, independent from step to step.
        sigma_turn_rad: (n,) random walk of the heading's error in a step; 0 where each heading is
            measured anew (a compass), positive where turns are summed up (odometry, a gyro).
        height_m: (n,) known, over the start's.
        start_m: (2,) known.
    """

    interval_s: Array
    travel_m: Array
    covariance: Array
    sigma_turn_rad: Array
    height_m: Array
    start_m: Array

    @property
    def time_s(self) -> Array:
        """(n,) of the epochs since the start."""
        return np.cumsum(self.interval_s)

    @property
    def path_m(self) -> Array:
        """(n, 2) as dead-reckoned, nothing corrected."""
        return self.start_m + np.cumsum(self.travel_m, axis=0)

    @property
    def turns(self) -> bool:
        """Whether the heading's error walks, so that it is estimated at every epoch."""
        return bool(np.any(self.sigma_turn_rad > 0))

    def until(self, n: int) -> DeadReckoning:
        """The first n epochs."""
        interval, travel, covariance, turn, height, start = self
        return DeadReckoning(interval[:n], travel[:n], covariance[:n], turn[:n], height[:n], start)


class Ranges(NamedTuple):
    """Measured ranges, or differences of two ranges, to beacons, in any order.

    Attributes:
        epoch: (m,) of the dead reckoning, from 0.
        beacon: (m,) from 0.
        value_m: (m,).
        sigma_m: (m,).
        reference: (m,) the beacon whose range was taken away; -1: none was.
    """

    epoch: Indices
    beacon: Indices
    value_m: Array
    sigma_m: Array
    reference: Indices

    def of(self, which: Indices | NDArray[np.bool_] | slice) -> Ranges:
        """Some of them."""
        epoch, beacon, value, sigma, reference = self
        return Ranges(epoch[which], beacon[which], value[which], sigma[which], reference[which])

    def until(self, n: int) -> Ranges:
        """Those of the first n epochs."""
        return self.of(self.epoch < n)


def dead_reckoning(
    interval_s: ArrayLike,
    speed_mps: ArrayLike,
    heading_rad: ArrayLike,
    sigma_speed_mps: ArrayLike,
    sigma_heading_rad: ArrayLike,
    *,
    sigma_turn_rad: ArrayLike = 0.0,
    height_m: ArrayLike = 0.0,
    start_m: ArrayLike = (0.0, 0.0),
) -> DeadReckoning:
    """Dead reckoning of n steps at a speed and heading (mean of each step); arguments broadcast.

    Source: Grinyak et al., eqs 1 and 8: the errors of a step are dt [[sin K, V cos K], [cos K,
    -V sin K]] (dV, dK), and they add up to a random walk, which the paper hides in the noise q of
    each range.
    """
    dt, speed, heading, turn, height, *sigmas = np.atleast_1d(
        *broadcast(
            interval_s,
            speed_mps,
            heading_rad,
            sigma_turn_rad,
            height_m,
            sigma_speed_mps,
            sigma_heading_rad,
        )
    )
    by_heading_speed = east_north_by_polar(heading, speed)
    root = by_heading_speed * (np.stack(sigmas[::-1], axis=-1) * dt[:, None])[:, None, :]
    floor = _FLOOR_M**2 * np.eye(2)
    travel = dt[:, None] * east_north_from_polar(heading, speed)
    covariance = root @ transposed(root) + floor
    return DeadReckoning(dt, travel, covariance, turn, height, np.asarray(start_m, dtype=float))


def ranges(
    epoch: ArrayLike,
    beacon: ArrayLike,
    value_m: ArrayLike,
    sigma_m: ArrayLike,
    reference: ArrayLike = -1,
) -> Ranges:
    """Ranges from columns that broadcast; `reference` -1 for a plain range."""
    columns = [np.atleast_1d(c) for c in broadcast(epoch, beacon, value_m, sigma_m, reference)]
    which, to, value, sigma, less = columns
    whole = np.intp
    return Ranges(which.astype(whole), to.astype(whole), value, sigma, less.astype(whole))
