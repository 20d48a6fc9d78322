"""Who is in the group: carriers that range or are ranged to and the own one, and the beacons."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import Site, enu_from_geodetic, rotation_clockwise
from estimation.joint_navigation.links import links_of
from estimation.joint_navigation.members import (
    CarrierStart,
    founded,
    with_beacon,
    with_carrier,
    with_source,
)
from estimation.joint_navigation.online import NORTH, Joint, without
from estimation.joint_navigation.waiting import waiting_for
from schemas.messages import DeclaredBeacon, DeclaredCarrier, SourceProperties

from ..navigation import NS, frame_covariance, pose_at
from ..state import Group, Member, State
from .axes import BEACON, CARRIER, SOURCE, is_heard, origin, whereabouts

_NORTH_KNOWN_RAD = 1e-6  # below, a stated sigma is but the floor that keeps a matrix invertible
_SLOW_MPS = 1.0
_MOST_SPEED_SCALE = 0.5


def joint_of(group: Group) -> Joint:
    """The joint state as the estimation has it."""
    return Joint(group.names, group.mean, group.covariance, group.free)


def with_joint(group: Group, joint: Joint) -> Group:
    """A group whose joint state is another one."""
    return replace(
        group,
        names=joint.names,
        mean=joint.mean,
        covariance=joint.covariance,
        free=joint.free.astype(np.int64),
    )


def place_of(group: Group, block: str) -> Array:
    """(2,) place of a carrier along the axes of the scenario."""
    joint = joint_of(group)
    first = joint.first(block)
    turned: Array = rotation_clockwise(joint.mean[NORTH]) @ joint.mean[first : first + 2]
    return turned + group.pivot_m[:2]


def takes_part(state: State, carrier: str) -> bool:
    """Whether a carrier belongs to a group: it ranges, is ranged to, or is the own one."""
    declared = state.scenario.carriers
    ranging = {c.name for c in declared if c.ranging}
    heard = {peer for c in declared for device in c.ranging for peer in device.to}
    return bool(ranging) and (carrier in ranging | heard or carrier == state.own)


def with_member(state: State, carrier: str, t_ns: int) -> State:
    """The state with a carrier in its group, if it takes part and says how sure its pose is."""
    known = state.group.members.get(carrier) if state.group else None
    boot = state.carriers[carrier].boot
    if known is not None and known.boot == boot:
        return state
    state = left(state, [carrier])
    if not takes_part(state, carrier) or not is_heard(state, carrier, t_ns):
        return state
    pivot = state.group.pivot_m if state.group else None
    there = whereabouts(state, carrier, t_ns)
    pivot = _pivot(state, there.place_m) if pivot is None else pivot
    start = _start(state, carrier, t_ns, there.place_m[:2] - pivot[:2])
    if start is None:
        return state
    name = CARRIER + carrier
    if state.group is None:
        group = with_joint(_nobody(pivot), founded(name, start))
    else:
        group = with_joint(state.group, with_carrier(joint_of(state.group), name, start))
    member = Member(
        boot=boot,
        start_t_ns=t_ns,
        t_ns=t_ns,
        start_m=there.place_m[:2],
        way_m=there.way_m,
        sigma=np.sqrt(np.diag(start.own_covariance)),
        fixed_t_ns=t_ns,
    )
    return replace(state, group=replace(group, members={**group.members, carrier: member}))


def left(state: State, carriers: Sequence[str]) -> State:
    """The state with a group that some carriers have left; nobody being left, there is none."""
    group = state.group
    if group is None or not set(carriers) & set(group.members):
        return state
    members = {name: m for name, m in group.members.items() if name not in carriers}
    if not members:
        return replace(state, group=None)
    gone = [CARRIER + name for name in carriers]
    sources = tuple(f"{SOURCE}{name}/" for name in carriers)
    gone += [name for name in group.names if name.startswith(sources)]
    joint = joint_of(group)
    for name in carriers:
        gone += [*waiting_for(joint, CARRIER + name), *links_of(joint, CARRIER + name)]
    after = with_joint(group, without(joint, gone))
    told = {source: t for source, t in group.told.items() if not source.startswith(sources)}
    return replace(state, group=replace(after, members=members, told=told))


def _nobody(pivot_m: Array) -> Group:
    nothing = np.zeros(0)
    return Group(
        pivot_m=pivot_m,
        names=(),
        mean=nothing,
        covariance=np.zeros((0, 0)),
        free=np.zeros(0, dtype=np.int64),
    )


def _pivot(state: State, place_m: Array) -> Array:
    """The beacon that is known best, or else where the founder is."""
    declared = state.scenario.beacons
    if not declared:
        return place_m
    return beacon_m(state, min(declared, key=lambda beacon: beacon.sigma_position_m))


def beacon_m(state: State, beacon: DeclaredBeacon) -> Array:
    """(3,) the declared place of a beacon."""
    angles = beacon.latitude_rad, beacon.longitude_rad, beacon.altitude_m
    return _enu_m(origin(state), *angles)


@lru_cache(maxsize=512)
def _enu_m(there: Site, latitude_rad: float, longitude_rad: float, altitude_m: float) -> Array:
    """The same; asked again and again."""
    return np.asarray(enu_from_geodetic(there, latitude_rad, longitude_rad, altitude_m))


def beacons(state: State) -> list[DeclaredBeacon]:
    """Those that are used."""
    return state.scenario.beacons[: state.settings.alignment.most_beacons]


def sigma_of(beacon: DeclaredBeacon) -> Array:
    """(3,) prior sigmas of a beacon's place."""
    return np.array([beacon.sigma_position_m, beacon.sigma_position_m, beacon.sigma_altitude_m])


def with_beacons(state: State, group: Group, heard: Sequence[str]) -> Group:
    """A group that knows these beacons, as far as they are not surveyed."""
    joint = joint_of(group)
    for beacon in beacons(state):
        name, sigma = BEACON + beacon.name, sigma_of(beacon)
        if beacon.name in heard and sigma.any() and name not in joint.names:
            joint = with_beacon(joint, name, beacon_m(state, beacon) - group.pivot_m, sigma)
    return with_joint(group, joint)


def with_source_of(group: Group, source: str, properties: SourceProperties) -> Group:
    """A group that knows a source of target logs."""
    if source in group.names:
        return group
    sigma = np.array(
        [
            properties.sigma_range_bias_m,
            properties.sigma_range_scale,
            properties.sigma_azimuth_bias_rad,
            properties.sigma_clock_s,
            0.0,  # it drifts as the clock of its carrier does
        ]
    )
    return with_joint(group, with_source(joint_of(group), source, sigma))


def _start(state: State, carrier: str, t_ns: int, place_m: Array) -> CarrierStart | None:
    """What is known of a carrier before its first range; None while nothing is said of it."""
    declared = state.declared(carrier)
    messages = state.carriers[carrier].navigation
    stated = frame_covariance(pose_at(messages, t_ns), declared)
    if stated is None or declared is None:
        return None
    stated = stated.copy()
    if stated[2, 2] < _NORTH_KNOWN_RAD**2:
        stated[2] = stated[:, 2] = 0.0
    two_way, pseudo = _biases(declared)
    clocks = [device for device in declared.ranging if device.kind == "pseudorange"]
    scale = declared.sigma_speed_mps / max(abs(messages[-1].speed_mps), _SLOW_MPS)
    return CarrierStart(
        place_m=place_m,
        covariance=stated,
        speed_scale=min(scale, _MOST_SPEED_SCALE),
        current_mps=declared.sigma_current_mps,
        range_scale=max((d.sigma_range_scale for d in declared.ranging), default=0.0),
        range_bias_m=two_way,
        pseudo_bias_m=pseudo,
        clock_m=max((device.sigma_clock_m for device in clocks), default=0.0),
        clock_drift_mps=max((device.sigma_clock_drift_mps for device in clocks), default=0.0),
        stamp_s=declared.sigma_clock_s,
        stamp_drift=declared.sigma_clock_drift,
        since_s=(t_ns - state.scenario.epoch_ns) * NS,
        turns=declared.sigma_north_drift_rad_per_sqrt_s > 0,
    )


def _biases(declared: DeclaredCarrier) -> tuple[float, float]:
    """Prior sigmas of the biases of two-way ranges and of pseudoranges."""
    kinds = ("two_way", "pseudorange")
    each = [
        max((d.sigma_range_bias_m for d in declared.ranging if d.kind == kind), default=0.0)
        for kind in kinds
    ]
    return each[0], each[1]
