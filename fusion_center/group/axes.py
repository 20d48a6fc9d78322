"""How what a carrier says lies in the axes of the scenario: places, ways, heights, velocities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import RigidTransform, Site, polar_from_east_north, target_from_source
from estimation.joint_navigation.online import Step
from estimation.system_alignment import dead_reckoning
from schemas.messages import DeclaredCarrier

from ..navigation import NS, pose_at, site, velocity_mps, way_m
from ..state import Member, State

CARRIER, SOURCE, BEACON, TARGET = "carrier/", "source/", "beacon/", "target/"


class Whereabouts(NamedTuple):
    """A carrier at an instant by its own navigation.

    Attributes:
        axes: from its plane to the axes of the scenario.
        way_m: (2,) reckoned since its boot, along its own axes.
        velocity_mps: (2,) reckoned, along the axes of the scenario.
    """

    axes: RigidTransform
    way_m: Array
    velocity_mps: Array

    @property
    def place_m(self) -> Array:
        """(3,) as reported."""
        return self.axes.translation_m

    def height_m(self, place_m: Array) -> float:
        """Up coordinate of a place (2,) near by, at the reported altitude: the Earth is round."""
        up = self.axes.rotation[:, 2]
        fall: float = up[:2] @ (place_m - self.place_m[:2]) / up[2]
        return float(self.place_m[2] - fall)


def origin(state: State) -> Site:
    """Of the axes in which beacons are declared."""
    there = state.scenario.origin
    return Site(there.latitude_rad, there.longitude_rad, there.altitude_m)


def whereabouts(state: State, carrier: str, t_ns: int) -> Whereabouts:
    """Where a carrier believes to be; it must have navigation."""
    messages = state.carriers[carrier].navigation
    axes = target_from_source(origin(state), site(pose_at(messages, t_ns)))
    return Whereabouts(axes, way_m(messages, t_ns), axes.rotation[:2, :2] @ velocity_mps(messages))


def is_heard(state: State, carrier: str, t_ns: int) -> bool:
    """Whether a carrier can be placed at an instant: it takes part, and its navigation is young."""
    known = state.carriers.get(carrier)
    if known is None or known.lost or not known.navigation:
        return False
    newest = known.navigation[-1]
    if newest.correction_id:  # one that could not be taken out
        return False
    return abs(t_ns - newest.t_ns) * NS <= state.settings.navigation.max_age_s


def step_of(state: State, carrier: str, member: Member, now: Whereabouts, t_ns: int) -> Step:
    """What a member has reckoned since; readings, a step of the scenario apart, err alone."""
    seconds = (t_ns - member.t_ns) * NS
    travel = now.axes.rotation[:2, :2] @ (now.way_m - member.way_m)
    declared = state.declared(carrier) or DeclaredCarrier(
        name=carrier, sigma_position_m=0.0, sigma_north_rad=0.0
    )
    bearing, length = polar_from_east_north(travel)
    readings = np.sqrt(state.scenario.step_ns * NS / seconds)
    reckoned = dead_reckoning(
        [seconds],
        length / seconds,
        bearing,
        declared.sigma_log_noise_mps * readings,
        declared.sigma_compass_noise_rad * readings,
    )
    turned = declared.sigma_north_drift_rad_per_sqrt_s * float(np.sqrt(seconds))
    walk_m2 = state.settings.registration.drift_m_per_root_s**2 * seconds
    return Step(seconds, travel, reckoned.covariance[0] + walk_m2 * np.eye(2), turned)
