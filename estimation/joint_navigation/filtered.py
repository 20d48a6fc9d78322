"""The online filter over a whole `Group`, epoch by epoch: what `solve` is compared with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from estimation.arrays import Array
from estimation.frames import east_north_by_polar
from estimation.joint_navigation.group import Group
from estimation.joint_navigation.members import (
    CarrierStart,
    Sighting,
    founded,
    with_beacon,
    with_carrier,
    with_source,
    with_target,
)
from estimation.joint_navigation.online import (
    LOG_DRIFT,
    LOG_TIME,
    Joint,
    Step,
    aged,
    carried,
    improved,
    moved_targets,
    velocity_mps,
)
from estimation.joint_navigation.online_rows import (
    Range,
    Surroundings,
    fix_rows,
    log_rows,
    range_rows,
)

_SIGMA_MPS = 300.0


def carrier_block(number: int) -> str:
    """Block of a carrier of a `Group`."""
    return f"carrier/{number}"


def source_block(number: int) -> str:
    """Block of its target logs."""
    return f"source/{number}/logs"


def beacon_block(number: int) -> str:
    """Block, or name where surveyed, of a beacon."""
    return f"beacon/{number}"


def pivot_of(group: Group) -> Array:
    """(3,) about which the axes of the filter are turned: the beacon that is known best."""
    if not len(group.beacons_m):
        return np.zeros(3)
    best: Array = group.beacons_m[np.argmin(group.sigma_beacons_m.sum(axis=1))]
    return best


def filtered(group: Group) -> Iterator[Joint]:
    """The joint state after every epoch; azimuths are left alone.

    The first carrier is the founder: `with_north_of(group, 0)` makes the turned axes the true ones.
    """
    pivot, joint = pivot_of(group), _begun(group)
    for epoch in range(len(group.interval_s)):
        joint, velocity = _moved(group, joint, epoch)
        ranges = _ranges(group, epoch)
        if ranges:
            there = _surroundings(group, joint, epoch, pivot, velocity)
            joint = improved(joint, range_rows(joint, ranges, there)).joint
        for i in np.flatnonzero(group.fixes.epoch == epoch):
            name = carrier_block(int(group.fixes.carrier[i]))
            place, sigma = group.fixes.place_m[i] - pivot[:2], group.fixes.sigma_m[i]
            joint = improved(joint, fix_rows(joint, name, place, sigma**2 * np.eye(2))).joint
        for carrier in range(group.carriers):
            joint = _with_logs(joint, _sightings(group, epoch, carrier, velocity))
        yield joint


def _begun(group: Group) -> Joint:
    joint: Joint | None = None
    for number, (path, prior) in enumerate(zip(group.paths, group.priors, strict=True)):
        sigmas = np.array([prior.start_m, prior.start_m, prior.heading_rad])
        start = CarrierStart(
            place_m=path.start_m - pivot_of(group)[:2],
            covariance=np.diag(sigmas**2),
            speed_scale=prior.speed_scale,
            current_mps=prior.current_mps,
            clock_m=prior.clock_m,
            clock_drift_mps=prior.clock_drift_mps,
        )
        name = carrier_block(number)
        joint = with_carrier(joint, name, start) if joint else founded(name, start)
        sigma = np.zeros(5)
        sigma[LOG_TIME], sigma[LOG_DRIFT] = prior.log_time_s, prior.log_drift
        joint = with_source(joint, source_block(number), sigma)
    if joint is None:
        raise ValueError("need a carrier")
    for number, sigma in enumerate(group.sigma_beacons_m):
        if sigma.any():
            place = group.beacons_m[number] - pivot_of(group)
            joint = with_beacon(joint, beacon_block(number), place, sigma)
    return joint


def _moved(group: Group, joint: Joint, epoch: int) -> tuple[Joint, dict[str, Array]]:
    """The state at an epoch, and the carriers' velocities then."""
    steps = [
        (
            carrier_block(number),
            Step(float(path.interval_s[epoch]), path.travel_m[epoch], path.covariance[epoch]),
        )
        for number, path in enumerate(group.paths)
    ]
    joint = carried(joint, steps)
    sources = [source_block(number) for number in range(group.carriers)]
    joint = aged(joint, sources, float(group.interval_s[epoch]))
    targets = [name for name in joint.names if name.startswith("target/")]
    passed = dict.fromkeys(targets, float(group.interval_s[epoch]))
    joint = moved_targets(joint, passed, group.agility**2) if passed else joint
    return joint, {
        name: velocity_mps(joint, name, step.travel_m / step.seconds) for name, step in steps
    }


def _surroundings(
    group: Group, joint: Joint, epoch: int, pivot: Array, velocity: dict[str, Array]
) -> Surroundings:
    heights = (float(path.height_m[epoch] - pivot[2]) for path in group.paths)
    known = {
        beacon_block(number): place - pivot
        for number, place in enumerate(group.beacons_m)
        if beacon_block(number) not in joint.names
    }
    return Surroundings(dict(zip(velocity, heights, strict=True)), velocity, known)


def _ranges(group: Group, epoch: int) -> list[Range]:
    logs = group.ranging
    return [
        Range(
            carrier=carrier_block(int(logs.carrier[i])),
            peer=_node(group, int(logs.peer[i])),
            kind="pseudorange" if logs.clocked[i] else "two_way",
            value_m=float(logs.value_m[i]),
            sigma_m=float(logs.sigma_m[i]),
            reference=_node(group, int(logs.reference[i])) if logs.reference[i] >= 0 else "",
        )
        for i in np.flatnonzero(logs.epoch == epoch)
    ]


def _node(group: Group, number: int) -> str:
    own = group.carriers
    return carrier_block(number) if number < own else beacon_block(number - own)


def _sightings(
    group: Group, epoch: int, carrier: int, velocity: dict[str, Array]
) -> list[Sighting]:
    """Logs of one carrier at an epoch."""
    logs, own = group.logs, carrier_block(carrier)
    told = []
    for i in np.flatnonzero((logs.epoch == epoch) & (logs.carrier == carrier)):
        bearing, distance = logs.bearing_rad[i], logs.range_m[i]
        root = east_north_by_polar(bearing, distance)
        root = root * np.array([logs.sigma_bearing_rad[i], logs.sigma_range_m[i]])
        level = distance * np.array([np.sin(bearing), np.cos(bearing)])
        target = f"target/{logs.target[i]}"
        told.append(
            Sighting(target, own, source_block(carrier), level, root @ root.T, 0.0, velocity[own])
        )
    return told


def _with_logs(joint: Joint, logs: Sequence[Sighting]) -> Joint:
    known = [log for log in logs if log.target in joint.names]
    joint = improved(joint, log_rows(joint, known)).joint if known else joint
    for log in logs:
        joint = joint if log.target in joint.names else with_target(joint, log, _SIGMA_MPS)
    return joint
