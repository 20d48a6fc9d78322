"""Whose word on a frame counts: the joint state's where it has one, else the relative frames'.

Both may have used the same target logs. They are never combined: what is published of a carrier,
and what puts its reports into the picture, is of the one or of the other.
"""

from __future__ import annotations

from estimation.relative_frame import OwnAxesFrame
from estimation.relative_frame.range_errors import RangeErrors

from ..navigation import NS
from ..relative_frames import frames as followed
from ..relative_frames.links import status as linked
from ..state import CarrierState, Estimate, Member, Monitor, State
from . import frames

_SPEAKS = ("candidate", "applied", "suspended")


def status(state: State, carrier: str, t_ns: int) -> tuple[Monitor, Estimate | None]:
    """What is to be published of a carrier at a closing."""
    member = holding(state, carrier)
    if member is None:
        return linked(state, carrier, t_ns)
    return _blocked(state, carrier, t_ns) or member.monitor, member.estimate


def holding(state: State, carrier: str) -> Member | None:
    """A carrier as the group has it, if the group's word counts.

    It does once its directions are determined, and before that where the relative frames have not
    found one either.
    """
    member = frames.member_of(state, carrier)
    if member is None or member.estimate is None or frames.member_of(state, state.own) is None:
        return None
    link = state.links.get(carrier)
    found = link is not None and link.followed
    return member if member.monitor.state in _SPEAKS or not found else None


def frame(state: State, carrier: str, t_ns: int) -> tuple[bool, OwnAxesFrame | None]:
    """Whether the group's word counts, and an applied frame by it at an instant."""
    member = holding(state, carrier)
    if member is None:
        return False, None
    usable = member.monitor.state == "applied" and _blocked(state, carrier, t_ns) is None
    return True, frames.frame(state, carrier, t_ns) if usable else None


def lateness(state: State, carrier: str, source: str) -> frames.Lateness:
    """By how much the logs of a source are stamped late, as far as the group's word counts."""
    if carrier != state.own and holding(state, carrier) is None:
        return frames.PUNCTUAL
    return frames.lateness(state, carrier, source)


def by_group(state: State, carrier: str) -> bool:
    """Whether the group's word counts of what a carrier's logs depend on."""
    if carrier == state.own:
        return frames.member_of(state, carrier) is not None
    return holding(state, carrier) is not None


def range_errors(state: State, carrier: str, source: str) -> RangeErrors:
    """What is to be added to the ranges of a source, by the group as far as its word counts."""
    told = frames.range_errors(state, carrier, source) if by_group(state, carrier) else None
    if told is not None:
        return told
    return followed.range_errors(state, state.frames, carrier, source)


def _blocked(state: State, carrier: str, t_ns: int) -> Monitor | None:
    """Why a member's correction is not to be used at an instant, whatever it is."""
    own = state.carriers.get(state.own, CarrierState())
    other = state.carriers.get(carrier, CarrierState())
    if own.lost:
        return _suspended(f"the own carrier {state.own} is lost: its frame is predicted on")
    if other.lost:
        return _suspended(f"{carrier} is lost")
    if carrier in state.orders.suspended:
        return _suspended("by order of the operator")
    for name, known in ((state.own, own), (carrier, other)):
        newest = known.navigation[-1]
        if newest.correction_id:
            return _suspended(f"the navigation of {name} already holds {newest.correction_id}")
        age_s = (t_ns - newest.t_ns) * NS
        if age_s > state.settings.navigation.max_age_s:
            return _suspended(f"the navigation of {name} is {age_s:.3g} s old")
    return None


def _suspended(reason: str) -> Monitor:
    return Monitor(state="suspended", reason=reason)
