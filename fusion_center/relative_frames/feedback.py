"""What a carrier is to add to its own so that its frame becomes that of the own carrier."""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array
from estimation.frames import (
    Site,
    on_surface,
    rotation_clockwise,
    site_at,
    target_from_source,
    wrap_pi,
    yaw_rad,
)
from schemas.messages import Feedback

from ..navigation import NS, site, triangle_of
from ..state import Estimate, State
from .corrections import frame_of

_MOST_M2_S = 1e12  # of the wire
_DRIFT_S = 10.0  # long enough for a drift to show in the last digits, short enough for a line


def of(estimate: Estimate, wander_m2_s: float = 0.0) -> Feedback | None:
    """What an estimate asks for; None unless it determines every direction, within all bounds."""
    if any(direction.status != "determined" for direction in estimate.directions):
        return None
    try:
        with np.errstate(all="ignore"):
            return _feedback(estimate, wander_m2_s)
    except (np.linalg.LinAlgError, ValueError):
        return None


def wander_m2_s(state: State, carrier: str) -> float:
    """Variance per axis and second that noise of log and compass gives the place of a carrier.

    Its place in own axes wanders by the noise of both ways, the own one and its own; a reading is
    one of every step. A carrier that declares nothing adds nothing.
    """
    whole = 0.0
    for name in (state.own, carrier):
        declared, known = state.declared(name), state.carriers.get(name)
        if declared and known and known.navigation:
            across_mps = known.navigation[-1].speed_mps * declared.sigma_compass_noise_rad
            whole += (declared.sigma_log_noise_mps**2 + across_mps**2) / 2
    return min(whole * state.scenario.step_ns * NS, _MOST_M2_S)


def _feedback(estimate: Estimate, wander_m2_s: float) -> Feedback:
    """The place whose plane lies in the own one as the estimate has it, less the reported place.

    Raises:
        LinAlgError, ValueError: the frame is not of this planet.
    """
    own, reported = site(estimate.own_pose), site(estimate.other_pose)
    frame, axes = frame_of(estimate), estimate.own_axes
    drift = np.array([axes.drift_east_mps, axes.drift_north_mps])
    place = _place(own, frame.q_m, reported.altitude_m)
    later = _place(own, frame.q_m + _DRIFT_S * drift, reported.altitude_m)
    known = yaw_rad(target_from_source(own, reported))
    convergence = yaw_rad(target_from_source(own, place))
    latitude, longitude = _less(place, reported)
    latitude_rate, longitude_rate = _less(later, place) / _DRIFT_S
    return Feedback(
        latitude_rad=float(latitude),
        longitude_rad=float(longitude),
        latitude_rad_s=float(latitude_rate),
        longitude_rad_s=float(longitude_rate),
        north_rad=float(wrap_pi(frame.D_rad + known - convergence)),
        covariance=triangle_of(_as_of_a_pose(frame.covariance, convergence)),
        wander_m2_s=wander_m2_s,
    )


def _place(own: Site, east_north_m: Array, altitude_m: float) -> Site:
    """The site at an altitude that is this far east and north of the own carrier."""
    east, north = east_north_m
    return site_at(own, on_surface(own, east, north, altitude_m))


def _less(there: Site, here: Site) -> Array:
    """Latitude and longitude (2,) of one site less those of another."""
    longitude = wrap_pi(there.longitude_rad - here.longitude_rad)
    return np.array([there.latitude_rad - here.latitude_rad, longitude])


def _as_of_a_pose(covariance: Array, convergence_rad: float) -> Array:
    """Covariance of (q, D) in own axes as that of (east, north, own north) of the other's pose.

    What D has too much, the north so corrected bears too little.
    """
    turn = np.zeros((3, 3))
    turn[:2, :2], turn[2, 2] = rotation_clockwise(-convergence_rad), -1.0
    turned: Array = turn @ covariance @ turn.T
    return (turned + turned.T) / 2
