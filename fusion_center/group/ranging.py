"""Ranges and position fixes of an instant, taken into the joint state."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from estimation.joint_navigation.links import errors, released, with_links
from estimation.joint_navigation.online import Improved, carried, improved, velocity_mps
from estimation.joint_navigation.online_rows import (
    LINK,
    Range,
    Surroundings,
    fix_rows,
    range_rows,
)
from estimation.joint_navigation.waiting import believed
from schemas.messages import Navigation, Ranging

from ..navigation import NS, frame_covariance
from ..relative_frames.corrections import Misclosure
from ..state import Group, State
from .axes import BEACON, CARRIER, Whereabouts, is_heard, step_of, whereabouts
from .joining import (
    beacon_m,
    beacons,
    joint_of,
    left,
    place_of,
    sigma_of,
    with_beacons,
    with_joint,
)

_LEAST_SIGMA_M = 1e-3
_MOST_M = 1e8
_LEARNING = 0.1
"""Weight of the newest range in the share of those that were out of line."""
_ASTRAY = 0.5
"""That share, from which the carrier is elsewhere than thought, and begins anew."""
_RENEWED = 0.9
"""Correlation times after which the error of a position fix is another one."""


def moved(state: State, group: Group, carriers: Iterable[str], t_ns: int) -> Group:
    """A group in which these members have come to an instant by their dead reckoning."""
    members, steps = dict(group.members), []
    for name in carriers:
        member = members[name]
        if t_ns <= member.t_ns:
            continue
        now = whereabouts(state, name, t_ns)
        steps.append((CARRIER + name, step_of(state, name, member, now, t_ns)))
        members[name] = replace(member, t_ns=t_ns, way_m=now.way_m)
    if not steps:
        return group
    return replace(with_joint(group, carried(joint_of(group), steps)), members=members)


def with_fix(state: State, group: Group, message: Navigation) -> Group:
    """A group with a position fix, if its error is another than that of the last one."""
    member = group.members[message.carrier]
    age_s = (message.t_ns - member.fixed_t_ns) * NS
    stated = frame_covariance(message.pose, state.declared(message.carrier))
    lasts_s = message.correlation_time_s  # 0: for ever, as the pose did with which it joined
    renewed = lasts_s > 0 and age_s >= _RENEWED * lasts_s
    if message.kind != "fix" or not renewed or stated is None:
        return group
    there = whereabouts(state, message.carrier, message.t_ns)
    place = there.place_m[:2] - group.pivot_m[:2]
    joint, name = joint_of(group), CARRIER + message.carrier
    after = improved(joint, fix_rows(joint, name, place, stated[:2, :2])).joint
    fixed = replace(member, fixed_t_ns=message.t_ns)
    return replace(with_joint(group, after), members={**group.members, message.carrier: fixed})


def with_ranges(
    state: State, group: Group, t_ns: int, heard: Sequence[Ranging]
) -> tuple[State, dict[str, Misclosure]]:
    """The state with the ranges of one instant in its group; how each member's misclose."""
    group, ranges = _between(state, group, t_ns, heard)
    if not ranges:
        return replace(state, group=group), {}
    named = {name for r in ranges for name in (r.carrier, r.peer, r.reference)}
    members = [name for name in group.members if CARRIER + name in named]
    group = moved(state, group, members, t_ns)
    joint = with_links(joint_of(group), ranges)
    there = {CARRIER + name: whereabouts(state, name, t_ns) for name in members}
    rows = range_rows(joint, ranges, _surroundings(state, group, there))
    after = believed(joint, t_ns, ranges, rows)
    told = {name: _misclosure(CARRIER + name, ranges, after.taken) for name in members}
    refused = after.taken.refused[: len(ranges)] & ~after.waits
    return _judged(
        replace(state, group=with_joint(group, released(after.joint))), ranges, refused
    ), told


def _misclosure(member: str, ranges: Sequence[Range], taken: Improved) -> Misclosure:
    """Of the ranges that a member takes part in."""
    which = [i for i, r in enumerate(ranges) if member in (r.carrier, r.peer, r.reference)]
    chi2, dof = taken.misclosure(which)
    return Misclosure(0, chi2, dof)


def _surroundings(state: State, group: Group, there: dict[str, Whereabouts]) -> Surroundings:
    joint = joint_of(group)
    known = {
        BEACON + beacon.name: beacon_m(state, beacon) - group.pivot_m
        for beacon in beacons(state)
        if not sigma_of(beacon).any()
    }
    return Surroundings(
        height_m={
            name: at.height_m(place_of(group, name)) - float(group.pivot_m[2])
            for name, at in there.items()
        },
        velocity_mps={
            name: velocity_mps(joint, name, at.velocity_mps) for name, at in there.items()
        },
        surveyed_m=known,
    )


def _between(
    state: State, group: Group, t_ns: int, heard: Sequence[Ranging]
) -> tuple[Group, list[Range]]:
    """Ranges whose ends are all known, and the group with the beacons among these."""
    nodes = {name: CARRIER + name for name in group.members if is_heard(state, name, t_ns)}
    marks = {beacon.name: BEACON + beacon.name for beacon in beacons(state)}
    ranges, used = [], dict(group.members)
    for message in heard:
        ends = [message.peer]
        if message.kind == "difference":
            ends.append(message.reference or "")
        own, to = nodes.get(message.carrier), [{**marks, **nodes}.get(end) for end in ends]
        clocked = message.kind != "pseudorange" or _has_clock(state, message.carrier)
        if own is None or None in to or own in to or not clocked or abs(message.value_m) > _MOST_M:
            continue
        sigma = max(message.sigma_m, _LEAST_SIGMA_M)
        reference = str(to[1]) if len(to) > 1 else ""
        ranges.append(Range(own, str(to[0]), message.kind, message.value_m, sigma, reference))
        member = used[message.carrier]
        more = tuple(e for e in ends if e in marks and e not in member.heard)
        used[message.carrier] = replace(member, heard=(*member.heard, *more))
    names = {end.partition("/")[2] for r in ranges for end in (r.peer, r.reference)}
    return with_beacons(state, replace(group, members=used), sorted(names & set(marks))), ranges


def _has_clock(state: State, carrier: str) -> bool:
    """Whether it is declared how wrong the clock behind a carrier's pseudoranges is."""
    declared = state.declared(carrier)
    return declared is not None and any(d.kind == "pseudorange" for d in declared.ranging)


def error_of(group: Group, message: Ranging) -> tuple[float, float] | None:
    """By how much the ranges of its link are too long, and the sigma [m]; None: taken for right."""
    said = (message.carrier, message.peer, message.reference or "", message.kind)
    for name, error in errors(joint_of(group)).items():
        *ends, kind = name.removeprefix(LINK).split("|")
        if said == (*(end.partition("/")[2] for end in ends), kind):
            return error
    return None


def _judged(state: State, ranges: Sequence[Range], refused: NDArray[np.bool_]) -> State:
    """The state with ranges counted; a carrier whose ranges contradict its place begins anew."""
    group = state.group
    assert group is not None  # noqa: S101
    members = dict(group.members)
    for number, log in enumerate(ranges):
        for end in (log.carrier, log.peer):
            kind, _, name = end.partition("/")
            if kind == CARRIER[:-1]:
                member = members[name]
                share = member.refused + _LEARNING * (float(refused[number]) - member.refused)
                count = member.ranges + (end == log.carrier)
                members[name] = replace(member, refused=share, ranges=count)
    worst = max(sorted(members), key=lambda name: members[name].refused)
    if members[worst].refused <= _ASTRAY:
        return replace(state, group=replace(group, members=members))
    calm = {name: replace(member, refused=0.0) for name, member in members.items()}
    return left(replace(state, group=replace(group, members=calm)), [worst])


def finite(group: Group | None) -> bool:
    """Whether all that a group holds are numbers."""
    if group is None:
        return True
    sane = np.isfinite(group.mean).all() and np.isfinite(group.covariance).all()
    return bool(sane and (np.diag(group.covariance) >= 0).all())
