"""One instant of the group: who joins, ways, fixes, ranges, target logs, and what follows of them.

ways of members since the instant before
  -> position fixes
  -> ranges between members and to beacons
  -> target logs that other members have of the same targets
  -> frames in own axes, how far each correction has come; what is observable
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec.structs import replace

from schemas.messages import Input, Navigation, Ranging, SourceReport

from .. import timeline
from ..quality import Tally
from ..relative_frames.corrections import Misclosure
from ..state import State
from . import frames
from .joining import with_member
from .published import with_diagnosis
from .ranging import error_of, finite, moved, with_fix, with_ranges
from .sightings import left_out, with_report


def is_wanted(state: State) -> bool:
    """Whether there is anything to align in this run."""
    scenario = state.scenario
    ranging = any(carrier.ranging for carrier in scenario.carriers)
    return state.settings.alignment.enabled and (bool(scenario.beacons) or ranging)


def with_messages(
    state: State, instant: timeline.Instant, tally_of: Callable[[Input], Tally]
) -> State:
    """The state after what carriers said at one instant of their way, of ranges and of targets.

    Args:
        tally_of: where a message is counted.
    """
    if not is_wanted(state):
        return state
    said = [m for m in instant.messages if _is_of_this_life(state, m)]
    if not said:
        return state
    with np.errstate(all="ignore"):  # numbers from the wire may be anything in bounds
        try:
            after = _with_messages(state, instant.t_ns, said)
        except (np.linalg.LinAlgError, ValueError):
            return replace(state, group=None)
    if after.group is None or not finite(after.group):
        return replace(after, group=None)
    members = after.group.members
    for report in (m for m in said if isinstance(m, SourceReport) and m.carrier in members):
        if why := left_out(report):
            tally_of(report).ungrouped(report, why)
    for ranging in (m for m in said if isinstance(m, Ranging)):
        if error := error_of(after.group, ranging):
            tally_of(ranging).wrong_link(ranging, *error)
    return after


def _is_of_this_life(state: State, message: Input) -> bool:
    carrier = state.carriers.get(message.carrier)
    boot = timeline.ordinal(state.timeline, message.carrier, message.boot)
    return carrier is not None and carrier.boot == boot and bool(carrier.navigation)


def _with_messages(state: State, t_ns: int, said: Sequence[Input]) -> State:
    """Everything of one instant, kind by kind."""
    for name in _founder_first(state, said):
        state = with_member(state, name, t_ns)
    state = _with_ways(state, t_ns, [m for m in said if isinstance(m, Navigation)])
    ranges = [m for m in said if isinstance(m, Ranging)]
    told: dict[str, Misclosure] = {}
    if ranges and state.group is not None:
        state, chi2 = with_ranges(state, state.group, t_ns, ranges)
        told |= chi2
    for report in said:
        group = state.group
        if isinstance(report, SourceReport) and group and report.carrier in group.members:
            group, closes = with_report(state, group, report)
            state = replace(state, group=group)
            told |= {name: _both(told.get(name), c) for name, c in closes.items()}
    for name, misclosure in told.items():
        state = frames.judged(state, name, t_ns, misclosure)
    return with_diagnosis(state, t_ns, sorted({m.carrier for m in ranges}))


def _founder_first(state: State, said: Sequence[Input]) -> list[str]:
    """Who speaks, the own carrier first: of several that found a group it gives the gauge."""
    return sorted({m.carrier for m in said}, key=lambda name: (name != state.own, name))


def _both(one: Misclosure | None, other: Misclosure) -> Misclosure:
    if one is None:
        return other
    return Misclosure(one.pairs + other.pairs, one.chi2 + other.chi2, one.dof + other.dof)


def _with_ways(state: State, t_ns: int, said: Sequence[Navigation]) -> State:
    """The state with members moved to where they now say they have come, and with their fixes."""
    group = state.group
    if group is None:
        return state
    mine = [m for m in said if m.carrier in group.members]
    group = moved(state, group, [m.carrier for m in mine], t_ns)
    for message in mine:
        group = with_fix(state, group, message)
    return replace(state, group=group)
