"""A frame followed over time: it drifts between instants, and each instant's pairs improve it.

The state is the frame in own axes, (q, D) with its covariance. Between instants the carriers move
by what each reckons in its own axes (a known motion, turned by D for the other), and gyros and
position wander: a random walk of q and of D. Ignoring the walk makes the covariance shrink for
ever while the error does not.

Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation,
section 10.5 (iterated extended Kalman filter), the update being an exact adjustment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike, transposed
from estimation.frames import rotation_clockwise
from estimation.relative_frame.adjustment import Update, updated
from estimation.relative_frame.logs import OwnAxesFrame, PolarLogs


class Drift(NamedTuple):
    """Random walk of a relative frame.

    Attributes:
        q_m_per_root_s: of each axis of the location [m/sqrt(s)].
        D_rad_per_root_s: of the orientation [rad/sqrt(s)].
    """

    q_m_per_root_s: float
    D_rad_per_root_s: float

    def covariance(self, elapsed_s: float) -> Array:
        """(3, 3) of (q, D), gathered in a time [s] of either sign."""
        location = self.q_m_per_root_s**2
        return np.diag([location, location, self.D_rad_per_root_s**2]) * abs(elapsed_s)


STEADY = Drift(0.0, 0.0)


class Travel(NamedTuple):
    """How far each carrier went by its own reckoning, in its own axes (..., 2) [m]."""

    own_m: ArrayLike
    other_m: ArrayLike


AT_REST = Travel((0.0, 0.0), (0.0, 0.0))


def predicted(
    frame: OwnAxesFrame, elapsed_s: float, drift: Drift, travel: Travel = AT_REST
) -> OwnAxesFrame:
    """The frame some time later (or earlier).

    q grows by the other's travel, turned into own axes by D, less the own carrier's.
    """
    other = np.asarray(travel.other_m, dtype=float)
    turned = (rotation_clockwise(frame.D_rad) @ other[..., None])[..., 0]
    forward = np.zeros_like(frame.covariance)
    forward[..., range(3), range(3)] = 1
    forward[..., 0, 2], forward[..., 1, 2] = turned[..., 1], -turned[..., 0]
    return OwnAxesFrame(
        frame.q_m + turned - np.asarray(travel.own_m, dtype=float),
        frame.D_rad,
        forward @ frame.covariance @ transposed(forward) + drift.covariance(elapsed_s),
    )


def advanced(
    frame: OwnAxesFrame,
    elapsed_s: float,
    drift: Drift,
    own: PolarLogs,
    other: PolarLogs,
    travel: Travel = AT_REST,
) -> Update:
    """One instant: predicted to it, then improved by its pairs.

    Raises:
        ValueError: own and other differ in length.
    """
    return updated(own, other, predicted(frame, elapsed_s, drift, travel))
