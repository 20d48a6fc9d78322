"""What a group knows of its carriers and beacons, in words, and as it is published."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import polar_from_east_north, rotation_clockwise
from estimation.joint_navigation.members import QUARTER_TURN
from estimation.joint_navigation.online import (
    CLOCK,
    CLOCK_DRIFT,
    CURRENT,
    HEADING,
    NORTH,
    PSEUDO_BIAS,
    RANGE_BIAS,
    RANGE_SCALE,
    SPEED_SCALE,
    STAMP,
    STAMP_DRIFT,
    Joint,
)
from estimation.relative_frame.observability import status
from estimation.system_alignment import Prior, dead_reckoning, prior, ranges
from estimation.system_alignment.model import Model
from estimation.system_alignment.observability import diagnosis
from estimation.system_alignment.parameters import places_of
from schemas.messages import AlignedBeacon, AlignedCarrier

from ..navigation import NS, triangle_of
from ..state import Group, Member, State
from .axes import BEACON, CARRIER, whereabouts
from .frames import terms
from .joining import beacon_m, beacons, joint_of, sigma_of

_TOUCHED = 0.3  # prior sigmas of a beacon's place, from which it takes part in a direction
_NOTHING = ranges([], [], [], [])


class _Constants(NamedTuple):
    """The constants of one member and its beacons as `estimation.system_alignment` orders them.

    Attributes:
        theta: (7 + 4 J,) current, speed scale, north, range scale, bias, clock drift, beacons.
        covariance: (7 + 4 J, 7 + 4 J).
    """

    theta: Array
    covariance: Array


class _Linear:
    """A linear function of the slots, row by row, about the mean of a joint state."""

    def __init__(self, joint: Joint, rows: int) -> None:
        self.joint = joint
        self.value = np.zeros(rows)
        self.by = np.zeros((rows, len(joint.mean)))

    def add(self, row: int, slot: int, factor: float = 1.0) -> None:
        """Add one slot times a factor."""
        self.value[row] += factor * self.joint.mean[slot]
        self.by[row, slot] += factor

    def add_turned(self, row: int, slot: int) -> None:
        """Add two slots, a vector of the turned axes, as one in those of the scenario."""
        turn = rotation_clockwise(self.joint.mean[NORTH])
        vector = turn @ self.joint.mean[slot : slot + 2]
        self.value[row : row + 2] += vector
        self.by[row : row + 2, slot : slot + 2] += turn
        self.by[row : row + 2, NORTH] += QUARTER_TURN @ vector

    @property
    def covariance(self) -> Array:
        """Of the rows."""
        used = np.flatnonzero(self.by.any(axis=0))
        whole: Array = self.by[:, used] @ self.joint.of(used) @ self.by[:, used].T
        return (whole + whole.T) / 2


def _place(group: Group, joint: Joint, first: int) -> tuple[Array, Array]:
    """(2,) and (2, 2) of a place along the axes of the scenario."""
    told = _Linear(joint, 2)
    told.add_turned(0, first)
    return told.value + group.pivot_m[:2], told.covariance


def _constants(state: State, group: Group, carrier: str) -> _Constants:
    """Everything of one member but its place, along the axes of the scenario."""
    member, joint = group.members[carrier], joint_of(group)
    first = joint.first(CARRIER + carrier)
    known = {beacon.name: beacon for beacon in beacons(state)}
    heard = [known[name] for name in member.heard if name in known]
    told = _Linear(joint, 7 + 4 * len(heard))
    told.add_turned(0, first + CURRENT.start)
    told.add(2, first + SPEED_SCALE)
    told.add(3, first + HEADING)
    told.add(3, NORTH)
    told.add(4, first + RANGE_SCALE)
    since_s = (member.t_ns - member.start_t_ns) * NS
    for slot, factor in ((RANGE_BIAS, 1.0), (PSEUDO_BIAS, 1.0), (CLOCK, 1.0)):
        told.add(5, first + slot, factor)
    told.add(5, first + CLOCK_DRIFT, -since_s)
    told.add(6, first + CLOCK_DRIFT)
    for i, beacon in enumerate(heard):
        row, name = 7 + 3 * i, BEACON + beacon.name
        if name in joint.names:
            told.add_turned(row, joint.first(name))
            told.add(row + 2, joint.first(name) + 2)
            told.value[row : row + 3] += group.pivot_m
        else:
            told.value[row : row + 3] = beacon_m(state, beacon)
    return _Constants(told.value, told.covariance)


def _prior(state: State, member: Member) -> Prior:
    """What was known of the constants before the first range."""
    known = {beacon.name: beacon for beacon in beacons(state)}
    heard = [known[name] for name in member.heard if name in known]
    sigma = member.sigma
    bias = np.sqrt(np.sum(sigma[[RANGE_BIAS, PSEUDO_BIAS, CLOCK]] ** 2))
    return prior(
        np.reshape([beacon_m(state, beacon) for beacon in heard], (-1, 3)),
        np.reshape([sigma_of(beacon) for beacon in heard], (-1, 3)),
        sigma_wind_mps=float(sigma[CURRENT][0]),
        sigma_speed_scale=float(sigma[SPEED_SCALE]),
        sigma_heading_bias_rad=float(sigma[HEADING]),
        sigma_range_scale=float(sigma[RANGE_SCALE]),
        sigma_clock_offset_m=float(bias),
        sigma_clock_drift_mps=float(sigma[CLOCK_DRIFT]),
    )


def with_diagnosis(state: State, t_ns: int, carriers: Sequence[str]) -> State:
    """The state with what is hidden of these members' constants, where it is time to look."""
    every_ns = round(state.settings.alignment.diagnose_every_s * 1e9)
    for name in carriers:
        group = state.group
        member = group.members.get(name) if group else None
        if group is None or member is None or not member.ranges:
            continue
        if member.diagnosed_t_ns < 0 or t_ns >= member.diagnosed_t_ns + every_ns:
            looked = replace(_diagnosed(state, group, name), diagnosed_t_ns=t_ns)
            state = replace(state, group=replace(group, members={**group.members, name: looked}))
    return state


def _diagnosed(state: State, group: Group, carrier: str) -> Member:
    """A member with what its ranges so far do not tell, in words.

    The covariance of the joint state is asked; the way so far, as one step, only gives motions
    names.
    """
    member, before = group.members[carrier], _prior(state, group.members[carrier])
    free = before.free
    if len(free) == 0:
        return replace(member, ratio=0.0, hidden=(), touched=())
    joint, (theta, covariance) = joint_of(group), _constants(state, group, carrier)
    place, _ = _place(group, joint, joint.first(CARRIER + carrier))
    passed_s = max((member.t_ns - member.start_t_ns) * NS, 1.0)
    bearing, length = polar_from_east_north(place - member.start_m)
    height_m = float(whereabouts(state, carrier, member.t_ns).place_m[2])
    way = dead_reckoning(
        [passed_s], length / passed_s, bearing, 0, 0, height_m=height_m, start_m=member.start_m
    )
    information: Array = np.linalg.inv(covariance[np.ix_(free, free)]).astype(float)
    found = diagnosis(Model(way, _NOTHING, before), theta[free], information)
    names, where = member.heard, places_of(theta)
    variance = np.diag(before.covariance)
    sigma = np.where(variance > 0, np.sqrt(variance), np.inf)
    shares = [
        np.abs(direction.motion / sigma)[where].max(axis=1) for direction in found.undetermined
    ]
    return replace(
        member,
        ratio=float(found.ratios[0]),
        hidden=tuple(_in_words(direction.name, names) for direction in found.undetermined),
        touched=tuple(
            tuple(name for name, part in zip(names, share, strict=True) if part > _TOUCHED)
            for share in shares
        ),
    )


def _in_words(name: str, names: Sequence[str]) -> str:
    """A direction with its beacons by name instead of by number, and the wind as a current."""
    for i in reversed(range(len(names))):
        name = name.replace(f"beacon {i + 1}", f"beacon {names[i]}")
    return name.replace("wind", "current")


def beacons_told(state: State) -> list[AlignedBeacon]:
    """Every beacon that is ranged to, as all members together find it."""
    return [] if state.group is None else list(_beacons(state, state.group))


def carriers_told(state: State) -> list[AlignedCarrier]:
    """The members that range, or are ranged to."""
    group = state.group
    members = sorted(group.members) if group else []
    return [_carrier(state, group, name) for name in members if group]


def _beacons(state: State, group: Group) -> Iterator[AlignedBeacon]:
    joint = joint_of(group)
    for beacon in beacons(state):
        by = [name for name, m in sorted(group.members.items()) if beacon.name in m.heard]
        if not by:
            continue
        place, covariance, name = beacon_m(state, beacon), np.zeros((3, 3)), BEACON + beacon.name
        if name in joint.names:
            told = _Linear(joint, 3)
            told.add_turned(0, joint.first(name))
            told.add(2, joint.first(name) + 2)
            place, covariance = told.value + group.pivot_m, told.covariance
        yield AlignedBeacon(
            beacon=beacon.name,
            position_m=place.tolist(),
            covariance=triangle_of(covariance),
            unobservable=_hidden_of(group, by, beacon.name),
            carrier=", ".join(by)[:1024],
        )


def _hidden_of(group: Group, members: Sequence[str], beacon: str) -> list[str]:
    """What is hidden of a beacon from everybody who ranges to it."""
    each = [
        [words for words, touched in zip(m.hidden, m.touched, strict=True) if beacon in touched]
        for m in (group.members[name] for name in members)
    ]
    return [words for words in each[0] if all(words in other for other in each)]


def _carrier(state: State, group: Group, name: str) -> AlignedCarrier:
    member, joint = group.members[name], joint_of(group)
    theta, covariance = _constants(state, group, name)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    place, unsure = _place(group, joint, joint.first(CARRIER + name))
    late = _Linear(joint, 2)
    for row, slot in enumerate((STAMP, STAMP_DRIFT)):
        late.add(row, joint.first(CARRIER + name) + slot)
        if state.own in group.members:
            late.add(row, joint.first(CARRIER + state.own) + slot, -1.0)
    late_sigma = np.sqrt(np.maximum(np.diag(late.covariance), 0.0))
    return AlignedCarrier(
        carrier=name,
        status=status(member.ratio),
        t_ns=member.t_ns,
        position_m=place.tolist(),
        covariance=triangle_of(unsure),
        current_mps=theta[:2].tolist(),
        current_covariance=triangle_of(covariance[:2, :2]),
        north_rad=float(theta[3]),
        sigma_north_rad=float(sigma[3]),
        speed_scale=float(theta[2]),
        sigma_speed_scale=float(sigma[2]),
        range_scale=float(theta[4]),
        sigma_range_scale=float(sigma[4]),
        range_bias_m=float(theta[5]),
        sigma_range_bias_m=float(sigma[5]),
        clock_drift_mps=float(theta[6]),
        sigma_clock_drift_mps=float(sigma[6]),
        ranges=member.ranges,
        unobservable=list(member.hidden),
        stamp_s=float(late.value[0]),
        sigma_stamp_s=float(late_sigma[0]),
        stamp_drift=float(late.value[1]),
        sigma_stamp_drift=float(late_sigma[1]),
        logs=member.logs,
        terms=list(terms(state, name)),
    )
