"""Frames of members in own axes, by the joint state, and how far their corrections have come."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace as with_fields
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.joint_navigation.members import QUARTER_TURN
from estimation.joint_navigation.online import (
    CURRENT,
    GAUGE,
    HEADING,
    LOG_BIAS,
    LOG_SCALE,
    LOG_TIME,
    NORTH,
    STAMP,
    Joint,
    carried,
    part,
    velocity_mps,
)
from estimation.relative_frame import OwnAxesFrame, RelativeFramePrior, in_fixed_axes
from estimation.relative_frame.range_errors import RangeErrors
from schemas.messages import SourceTerm

from ..relative_frames import corrections, monitor
from ..relative_frames.corrections import Misclosure
from ..relative_frames.links import navigated
from ..state import Estimate, Group, Member, State
from .axes import CARRIER, SOURCE, Whereabouts, is_heard, step_of, whereabouts
from .joining import joint_of

LEAST_SIGMA_M, LEAST_SIGMA_RAD = 1e-3, 1e-7
_KNOWN_RAD, _PLAIN_RAD = 1e-6, 1e-3
"""A north that is known to begin with is judged as if it had not been: it is determined."""
_MOST_VALID_S = 1e6


class Pair(NamedTuple):
    """The own carrier and another at an instant, alone.

    Attributes:
        joint: the gauge and both.
        own, other: first slots; own_at, other_at: by their navigation.
    """

    joint: Joint
    own: int
    other: int
    own_at: Whereabouts
    other_at: Whereabouts


def member_of(state: State, carrier: str) -> Member | None:
    """A carrier as a member of the group in the life it is in; None if it is none."""
    member = state.group.members.get(carrier) if state.group else None
    known = state.carriers.get(carrier)
    return member if member and known and known.boot == member.boot else None


def frame(state: State, carrier: str, t_ns: int) -> OwnAxesFrame | None:
    """Where a member lies in own axes at an instant; None where the group cannot say."""
    pair = _pair(state, carrier, t_ns)
    return None if pair is None or state.group is None else _frame(pair, state.group)


def _pair(state: State, carrier: str, t_ns: int) -> Pair | None:
    group, names = state.group, (state.own, carrier)
    members = [member_of(state, name) for name in names]
    if group is None or not all(is_heard(state, name, t_ns) for name in names):
        return None
    blocks = [CARRIER + name for name in names]
    there = [whereabouts(state, name, t_ns) for name in names]
    steps = []
    for name, member, at in zip(names, members, there, strict=True):
        if member is None:
            return None
        if t_ns > member.t_ns:
            steps.append((CARRIER + name, step_of(state, name, member, at, t_ns)))
    joint = part(joint_of(group), [GAUGE, *blocks])
    joint = carried(joint, steps) if steps else joint
    return Pair(joint, joint.first(blocks[0]), joint.first(blocks[1]), *there)


def _frame(pair: Pair, group: Group) -> OwnAxesFrame:
    """Place and orientation of the other one in own sensor axes."""
    joint, own, other = pair.joint, pair.own, pair.other
    mean = joint.mean
    turn, pivot = rotation_clockwise(mean[NORTH]), group.pivot_m[:2]
    mine, theirs = (turn @ mean[at : at + 2] + pivot for at in (own, other))
    up = pair.other_at.height_m(theirs) - pair.own_at.height_m(mine)
    apart = np.append(theirs - mine, up)
    own_from_origin = pair.own_at.axes.rotation.T
    back = rotation_clockwise(-mean[NORTH] - mean[own + HEADING])
    q = back @ (own_from_origin @ apart)[:2]
    by_place = back @ own_from_origin[:2, :2] @ turn
    by = np.zeros((3, 6))
    by[:2, :2], by[:2, 3:5] = -by_place, by_place
    by[:2, 2] = -QUARTER_TURN @ q
    by[2, 2], by[2, 5] = -1.0, 1.0
    slots = [*range(own, own + 3), *range(other, other + 3)]
    least = np.diag([LEAST_SIGMA_M, LEAST_SIGMA_M, LEAST_SIGMA_RAD]) ** 2
    rotation = wrap_pi(mean[other + HEADING] - mean[own + HEADING])
    return OwnAxesFrame(q, np.asarray(rotation), by @ joint.of(slots) @ by.T + least)


def judged(state: State, carrier: str, t_ns: int, misclosure: Misclosure) -> State:
    """The state after an instant had something to say of a member: its estimate, its monitor."""
    member, estimate = member_of(state, carrier), None
    if member is None or carrier == state.own or state.group is None:
        return state
    with suppress(np.linalg.LinAlgError, ValueError):
        estimate = _estimate(state, carrier, t_ns, misclosure)
    after, replaces = monitor.after_registration(
        member.monitor, estimate, state.settings.monitor, "its frame cannot be told"
    )
    kept = estimate if replaces and estimate else member.estimate
    member = replace(member, monitor=after, estimate=kept)
    group = replace(state.group, members={**state.group.members, carrier: member})
    return replace(state, group=group)


def _estimate(state: State, carrier: str, t_ns: int, misclosure: Misclosure) -> Estimate | None:
    """A member's frame as it is published."""
    pair = _pair(state, carrier, t_ns)
    if pair is None or state.group is None:
        return None
    found = _frame(pair, state.group)
    misclosure = misclosure._replace(pairs=len(state.group.targets))
    between, prior = navigated(state, carrier, t_ns)
    prior = _plain(prior)
    made = corrections.estimated(
        found, in_fixed_axes(found, prior), prior, between, misclosure, "group"
    )
    drift, unsure_mps, spreads_m2_s = _drift(pair)
    axes = replace(made.own_axes, drift_east_mps=float(drift[0]), drift_north_mps=float(drift[1]))
    unsure_m = float(np.sqrt(np.trace(found.covariance[:2, :2])))
    member = state.group.members[carrier]
    return corrections.within_bounds(
        replace(
            made,
            own_axes=axes,
            since_t_ns=member.start_t_ns,
            spreads_m2_s=spreads_m2_s,
            valid_for_s=min(unsure_m / unsure_mps, _MOST_VALID_S) if unsure_mps else 0.0,
            terms=terms(state, carrier),
        )
    )


def _plain(prior: RelativeFramePrior) -> RelativeFramePrior:
    """The prior, norths that are known taken for known to a milliradian, see `_PLAIN_RAD`."""
    if float(np.maximum(prior.sigma_c1_rad, prior.sigma_c2_rad)) >= _KNOWN_RAD:
        return prior
    return with_fields(prior, sigma_c1_rad=_PLAIN_RAD, sigma_c2_rad=_PLAIN_RAD)


def _drift(pair: Pair) -> tuple[Array, float, float]:
    """How fast the other one moves beyond what both reckon, in own axes, and the sigma of that.

    The third is how fast the variance of its place grows at first, per axis, since errors of place
    and drift go together. Over ground they move along the turned axes, of which own axes are turned
    by the own north; what both reckon moves their reported places as it is.
    """
    joint, turn = pair.joint, rotation_clockwise(-pair.joint.mean[pair.own + HEADING])
    over_ground, reckoned = np.zeros(2), np.zeros(2)
    sides = ((pair.own, pair.own_at, -1.0), (pair.other, pair.other_at, 1.0))
    for name, (_, at, sign) in zip(joint.names[1:], sides, strict=True):
        over_ground += sign * velocity_mps(joint, name, at.velocity_mps)
        reckoned += sign * at.velocity_mps
    currents = [range(f + CURRENT.start, f + CURRENT.stop) for f, *_ in sides]
    unsure = sum(np.trace(joint.of(slots)) for slots in currents)
    apart = np.hstack([-np.eye(2), np.eye(2)])
    places = [f + i for f, *_ in sides for i in range(2)]
    tied = apart @ joint.between(places, [*currents[0], *currents[1]]) @ apart.T
    return turn @ over_ground - reckoned, float(np.sqrt(unsure)), float(np.trace(tied))


class Lateness(NamedTuple):
    """By how much the logs of a source are stamped late.

    Attributes:
        seconds: against the own clock; sigma_s: of that.
        of_source_s: against the navigation of its own carrier.
    """

    seconds: float = 0.0
    sigma_s: float = 0.0
    of_source_s: float = 0.0


PUNCTUAL = Lateness()


def lateness(state: State, carrier: str, source: str) -> Lateness:
    """By how much the logs of a source are stamped late, as the group has it."""
    group, own = state.group, member_of(state, state.own)
    if group is None or own is None or member_of(state, carrier) is None:
        return PUNCTUAL
    joint = joint_of(group)
    slots = [joint.first(CARRIER + carrier) + STAMP, joint.first(CARRIER + state.own) + STAMP]
    signs, block = [1.0, -1.0], f"{SOURCE}{carrier}/{source}"
    late = 0.0
    if block in joint.names:
        slots.append(joint.first(block) + LOG_TIME)
        signs.append(1.0)
        late = float(joint.mean[slots[2]])
    by = np.array(signs)
    variance = float(by @ joint.of(slots) @ by)
    return Lateness(float(by @ joint.mean[slots]), float(np.sqrt(max(variance, 0.0))), late)


def range_errors(state: State, carrier: str, source: str) -> RangeErrors | None:
    """What is to be added to the ranges of a member's source; None where the group has no word."""
    group, block = state.group, f"{SOURCE}{carrier}/{source}"
    if group is None or block not in (joint := joint_of(group)).names:
        return None
    first = joint.first(block)
    slots = [first + LOG_BIAS, first + LOG_SCALE]
    return RangeErrors(-joint.mean[slots], joint.of(slots))


def terms(state: State, carrier: str) -> tuple[SourceTerm, ...]:
    """Systematic errors of a member's sources that the group estimates."""
    group = state.group
    if group is None:
        return ()
    joint, prefix = joint_of(group), f"{SOURCE}{carrier}/"
    names = ("range_bias_m", "range_scale", "azimuth_bias_rad")
    told = []
    for block in joint.names:
        if block.startswith(prefix):
            source, first = block[len(prefix) :], joint.first(block)
            sigma = np.sqrt(np.diag(joint.of(range(first, first + 3))))
            for i in np.flatnonzero(sigma > 0).tolist():
                value = float(joint.mean[first + i])
                told.append(
                    SourceTerm(source=source, name=names[i], value=value, sigma=float(sigma[i]))  # type: ignore[arg-type]
                )
            late = lateness(state, carrier, source)
            if late.sigma_s > 0:
                time = SourceTerm(
                    source=source, name="time_s", value=late.seconds, sigma=late.sigma_s
                )
                told.append(time)
    return tuple(told)
