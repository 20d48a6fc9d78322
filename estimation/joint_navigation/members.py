"""Who is in a joint state: founders, carriers, sources, beacons, targets, each with its prior."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import rotation_clockwise
from estimation.joint_navigation.online import (
    CLOCK,
    CLOCK_DRIFT,
    CURRENT,
    GAUGE,
    HEADING,
    LOG_TIME,
    NOBODY,
    NORTH,
    PLACE,
    PSEUDO_BIAS,
    RANGE_BIAS,
    RANGE_SCALE,
    SIZES,
    SPEED_SCALE,
    STAMP,
    TIME,
    Joint,
    joined,
)

QUARTER_TURN = rotation_clockwise(np.pi / 2)
_NO_SLOTS = np.zeros((0, 0))


class CarrierStart(NamedTuple):
    """A carrier as it joins; sigmas of 0: it has no such error.

    Attributes:
        place_m: (2,) reported, from the pivot along the axes of the scenario.
        covariance: (3, 3) of reported less true place, and of the bearing of its own north.
        current_mps: sigma per axis of what it moves in; clock_m, clock_drift_mps: of the clock
            behind its pseudoranges; stamp_s: of the clock that stamps its messages.
        range_bias_m: of its two-way ranges, pseudo_bias_m: of its pseudoranges.
        turns: its north wanders.
    """

    place_m: Array
    covariance: Array
    speed_scale: float = 0.0
    current_mps: float = 0.0
    range_scale: float = 0.0
    range_bias_m: float = 0.0
    pseudo_bias_m: float = 0.0
    clock_m: float = 0.0
    clock_drift_mps: float = 0.0
    stamp_s: float = 0.0
    turns: bool = False

    @property
    def own_covariance(self) -> Array:
        """(12, 12) of true place and north, and of the constants, before any data."""
        sigma = np.zeros(SIZES["carrier"])
        sigma[SPEED_SCALE], sigma[CURRENT] = self.speed_scale, self.current_mps
        sigma[RANGE_SCALE], sigma[RANGE_BIAS] = self.range_scale, self.range_bias_m
        sigma[PSEUDO_BIAS], sigma[STAMP] = self.pseudo_bias_m, self.stamp_s
        sigma[CLOCK], sigma[CLOCK_DRIFT] = self.clock_m, self.clock_drift_mps
        whole = np.diag(sigma**2)
        whole[:3, :3] = self.covariance
        whole[:2, 2] = whole[2, :2] = -self.covariance[:2, 2]  # true less reported place
        return whole


def founded(carrier: str, start: CarrierStart) -> Joint:
    """A group of one carrier, whose north and clock are the gauge."""
    own = start.own_covariance
    gauge = np.diag(own)[[HEADING, STAMP]]
    alone = joined(NOBODY, GAUGE, np.zeros(2), np.zeros((2, 0)), np.diag(gauge))
    by_gauge = np.zeros((SIZES["carrier"], 2))
    by_gauge[PLACE, NORTH] = -QUARTER_TURN @ start.place_m
    rest = own.copy()
    if gauge[NORTH] > 0:
        tied = own[:2, HEADING]
        by_gauge[PLACE, NORTH] += tied / gauge[NORTH]
        rest[:2, :2] -= np.outer(tied, tied) / gauge[NORTH]
    rest[[HEADING, STAMP]] = rest[:, [HEADING, STAMP]] = 0.0
    mean = np.zeros(SIZES["carrier"])
    mean[PLACE] = start.place_m
    return joined(alone, carrier, mean, by_gauge, rest, _wandering(start))


def with_carrier(joint: Joint, carrier: str, start: CarrierStart) -> Joint:
    """A group that one carrier more has joined, of which nothing but its own word is known."""
    north, time = joint.mean[NORTH], joint.mean[TIME]
    back = rotation_clockwise(-north)
    mean = np.zeros(SIZES["carrier"])
    mean[PLACE], mean[HEADING], mean[STAMP] = back @ start.place_m, -north, -time
    by_gauge = np.zeros((SIZES["carrier"], len(joint.mean)))
    by_gauge[PLACE, NORTH] = -QUARTER_TURN @ mean[PLACE]
    by_gauge[HEADING, NORTH] = by_gauge[STAMP, TIME] = -1.0
    own = start.own_covariance
    turned = np.eye(SIZES["carrier"])
    turned[:2, :2] = back
    return joined(joint, carrier, mean, by_gauge, turned @ own @ turned.T, _wandering(start))


def _wandering(start: CarrierStart) -> list[int]:
    """Slots that will be unsure: the walk of dead reckoning, and of a north that wanders."""
    return [0, 1, HEADING] if start.turns else [0, 1]


def with_source(joint: Joint, source: str, sigma: Array) -> Joint:
    """A group with a source of target logs; sigmas (4,) of its systematic errors, in slot order."""
    nothing = np.zeros((4, len(joint.mean)))
    return joined(joint, source, np.zeros(4), nothing, np.diag(sigma**2))


def with_beacon(joint: Joint, beacon: str, place_m: Array, sigma_m: Array) -> Joint:
    """A group with a beacon that is not surveyed.

    Args:
        place_m: (3,) from the pivot along the axes of the scenario; sigma_m: (3,).
    """
    back = rotation_clockwise(-joint.mean[NORTH])
    mean = np.append(back @ place_m[:2], place_m[2])
    by_gauge = np.zeros((3, len(joint.mean)))
    by_gauge[:2, NORTH] = -QUARTER_TURN @ mean[:2]
    spread = np.diag(sigma_m**2)
    spread[:2, :2] = back @ spread[:2, :2] @ back.T
    return joined(joint, beacon, mean, by_gauge, spread)


class Sighting(NamedTuple):
    """One log of a target, as rows and priors need it.

    Attributes:
        target, carrier, source: blocks.
        seen_m: (2,) from the carrier along the axes of the scenario, by the carrier's own north.
        covariance: (2, 2) of it.
        after_s: the log's instant less that of the state, by the carrier's clock.
        carrier_mps: (2,) velocity of the carrier over ground.
    """

    target: str
    carrier: str
    source: str
    seen_m: Array
    covariance: Array
    after_s: float
    carrier_mps: Array


def with_target(joint: Joint, log: Sighting, sigma_mps: float) -> Joint:
    """A group with a target of which this is the first log; its velocity is not known.

    Until it is, how late the log was stamped moves the target by an unknown velocity times an
    unknown time: that product is put into the place's covariance.
    """
    own, source = joint.first(log.carrier), joint.first(log.source)
    turn = rotation_clockwise(joint.mean[own + HEADING])
    sight = turn @ log.seen_m
    own_late = joint.mean[source + LOG_TIME] - log.after_s
    place = joint.mean[own : own + 2] - log.carrier_mps * own_late + sight
    late, doubt_s2 = lateness(joint, log)
    by_known = np.zeros((4, len(joint.mean)))
    by_known[:2, own : own + 2] = np.eye(2)
    by_known[:2, own + HEADING] = QUARTER_TURN @ sight
    by_known[:2, source + LOG_TIME] = -log.carrier_mps
    doubt = sigma_mps**2 * np.eye(2)
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = turn @ log.covariance @ turn.T + (late**2 + doubt_s2) * doubt
    covariance[:2, 2:] = covariance[2:, :2] = late * doubt
    covariance[2:, 2:] = doubt
    return joined(joint, log.target, np.append(place, [0.0, 0.0]), by_known, covariance)


def lateness(joint: Joint, log: Sighting) -> tuple[float, float]:
    """By how much the state's instant, by the founder's clock, is after the log; the variance."""
    slots = [joint.first(log.carrier) + STAMP, joint.first(log.source) + LOG_TIME]
    return float(joint.mean[slots].sum()) - log.after_s, float(joint.of(slots).sum())
