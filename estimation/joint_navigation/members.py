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
    LOG_DRIFT,
    LOG_TIME,
    NOBODY,
    NORTH,
    PLACE,
    PSEUDO_BIAS,
    RANGE_BIAS,
    RANGE_SCALE,
    RATE,
    SIZES,
    SPEED_SCALE,
    STAMP,
    STAMP_DRIFT,
    TIME,
    Joint,
    joined,
)

QUARTER_TURN = rotation_clockwise(np.pi / 2)


class CarrierStart(NamedTuple):
    """A carrier as it joins; sigmas of 0: it has no such error.

    Attributes:
        place_m: (2,) reported, from the pivot along the axes of the scenario.
        covariance: (3, 3) of reported less true place, and of the bearing of its own north.
        current_mps: sigma per axis of what it moves in; clock_m, clock_drift_mps: of the clock
            behind its pseudoranges; stamp_s, stamp_drift: of the clock that stamps its messages,
            `since_s` ago [s, s/s].
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
    stamp_drift: float = 0.0
    since_s: float = 0.0
    turns: bool = False

    @property
    def own_covariance(self) -> Array:
        """(13, 13) of true place and north, and of the constants, before any data."""
        sigma = np.zeros(SIZES["carrier"])
        sigma[SPEED_SCALE], sigma[CURRENT] = self.speed_scale, self.current_mps
        sigma[RANGE_SCALE], sigma[RANGE_BIAS] = self.range_scale, self.range_bias_m
        sigma[PSEUDO_BIAS], sigma[STAMP] = self.pseudo_bias_m, self.stamp_s
        sigma[CLOCK], sigma[CLOCK_DRIFT] = self.clock_m, self.clock_drift_mps
        sigma[STAMP_DRIFT] = self.stamp_drift
        whole = np.diag(sigma**2)
        gained = self.since_s * self.stamp_drift**2
        whole[STAMP, STAMP] += self.since_s * gained
        whole[STAMP, STAMP_DRIFT] = whole[STAMP_DRIFT, STAMP] = gained
        whole[:3, :3] = self.covariance
        whole[:2, 2] = whole[2, :2] = -self.covariance[:2, 2]  # true less reported place
        return whole


def founded(carrier: str, start: CarrierStart) -> Joint:
    """A group of one carrier, whose north and clock are the gauge."""
    own = start.own_covariance
    gauge = np.array([own[HEADING, HEADING], start.stamp_s**2, start.stamp_drift**2])
    alone = joined(NOBODY, GAUGE, np.zeros(3), np.zeros((3, 0)), np.diag(gauge))
    by_gauge = np.zeros((SIZES["carrier"], 3))
    by_gauge[PLACE, NORTH] = -QUARTER_TURN @ start.place_m
    rest = own.copy()
    if gauge[NORTH] > 0:
        tied = own[:2, HEADING]
        by_gauge[PLACE, NORTH] += tied / gauge[NORTH]
        rest[:2, :2] -= np.outer(tied, tied) / gauge[NORTH]
    of_gauge = [HEADING, STAMP, STAMP_DRIFT]
    rest[of_gauge] = rest[:, of_gauge] = 0.0
    mean = np.zeros(SIZES["carrier"])
    mean[PLACE] = start.place_m
    return joined(alone, carrier, mean, by_gauge, rest, _wandering(start, clocks_part=False))


def with_carrier(joint: Joint, carrier: str, start: CarrierStart) -> Joint:
    """A group that one carrier more has joined, of which nothing but its own word is known."""
    north, time, rate = joint.mean[[NORTH, TIME, RATE]]
    back = rotation_clockwise(-north)
    mean = np.zeros(SIZES["carrier"])
    mean[PLACE], mean[HEADING] = back @ start.place_m, -north
    mean[STAMP], mean[STAMP_DRIFT] = -time - start.since_s * rate, -rate
    by_gauge = np.zeros((SIZES["carrier"], len(joint.mean)))
    by_gauge[PLACE, NORTH] = -QUARTER_TURN @ mean[PLACE]
    by_gauge[HEADING, NORTH] = by_gauge[STAMP, TIME] = by_gauge[STAMP_DRIFT, RATE] = -1.0
    by_gauge[STAMP, RATE] = -start.since_s
    own = start.own_covariance
    turned = np.eye(SIZES["carrier"])
    turned[:2, :2] = back
    parting = start.stamp_drift > 0 or joint.of([RATE])[0, 0] > 0
    wandering = _wandering(start, clocks_part=parting)
    return joined(joint, carrier, mean, by_gauge, turned @ own @ turned.T, wandering)


def _wandering(start: CarrierStart, *, clocks_part: bool) -> list[int]:
    """Slots that will be unsure: the walk of dead reckoning, of a north, of clocks that drift."""
    whether = {
        HEADING: start.turns,
        CLOCK: start.clock_drift_mps > 0,
        STAMP: clocks_part,
    }
    return [0, 1, *(slot for slot, wanders in whether.items() if wanders)]


def with_source(joint: Joint, source: str, sigma: Array) -> Joint:
    """A group with a source of target logs; sigmas (5,) of its systematic errors, in slot order."""
    nothing = np.zeros((5, len(joint.mean)))
    wandering = [LOG_TIME] if sigma[LOG_DRIFT] > 0 else []
    return joined(joint, source, np.zeros(5), nothing, np.diag(sigma**2), wandering)


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
