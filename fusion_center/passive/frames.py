"""Frames of carriers that report bearings only, from the bearings of targets they share over time.

Two bearings of one instant fix a target and leave nothing for the frames. Over time they do not:
targets move steadily and a carrier turns. The bearings of targets are kept as their carriers took
them (`rays`). Every so often the other carrier's place and north (q, D) are found of the newest of
them (`common_targets`), those without names being paired before (`pairing`). Nothing else is
carried over from one solution to the next.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace

from estimation.relative_frame import in_fixed_axes
from schemas.messages import SourceReport

from ..relative_frames import corrections, monitor
from ..relative_frames.links import obstacle, sees_bearings_only
from ..relative_frames.monitor import MAX_REASON
from ..state import Estimate, Link, Rays, State
from ..timeline import Instant
from . import pairing
from .common_targets import found_frame, has_manoeuvred
from .naming import with_nameless
from .rays import by_target, with_report
from .windows import Sides, scene_of

NO_MANOEUVRE = (
    "neither carrier has manoeuvred in the last {:g} s (passive.frames_memory_s): bearings from "
    "two uniform ways fit at many ranges, and location and orientation stay open"
)
NOTHING_COMMON = "no target of both has been found among the nameless ones yet"
NO_MOTION = "no common target moves so steadily that its bearings agree"


def with_bearings(state: State, instant: Instant) -> State:
    """The state after the bearings of one instant, with every frame that is due tried anew."""
    reports = [m for m in instant.messages if isinstance(m, SourceReport) and m.bearing_rad]
    if not reports or not state.settings.passive.enabled:
        return state
    for report in reports:
        state = with_nameless(state, report)
    others = [name for name in sorted(state.links) if sees_bearings_only(state, name)]
    if not others:
        return state
    for report in reports:
        if report.carrier in (state.own, *others):
            state = with_report(state, report)
    for name in others:
        if _is_due(state, name, instant.t_ns):
            state = _tried(state, name, instant.t_ns)
    return state


def _is_due(state: State, name: str, t_ns: int) -> bool:
    """Whether the last attempt is long enough ago, and both have seen enough since it."""
    tried, settings = state.links[name].bearings_t_ns, state.settings.passive
    if tried >= 0 and t_ns - tried < round(settings.frames_every_s * 1e9):
        return False
    return any(
        min(_newest(side) for side in targets) > tried
        for targets in (_common(state, name, t_ns), pairing.candidates(state, name, t_ns))
    )


def _newest(targets: Mapping[str, Rays]) -> int:
    """When the last of their bearings was taken."""
    return max((int(rays.t_ns[-1]) for rays in targets.values()), default=-1)


def _common(state: State, name: str, t_ns: int) -> Sides:
    """Targets of which both carriers have enough bearings of the window, the most seen first."""
    settings = state.settings.passive
    oldest = t_ns - round(settings.frames_memory_s * 1e9)
    own, other = by_target(state, state.own), by_target(state, name)
    seen = {
        target: min(int((side[target].t_ns >= oldest).sum()) for side in (own, other))
        for target in own
        if target in other
    }
    enough = [target for target in seen if seen[target] >= settings.least_bearings]
    enough.sort(key=lambda target: (-seen[target], target))
    most = enough[: settings.frames_most_targets]
    return Sides({t: own[t] for t in most}, {t: other[t] for t in most})


def _tried(state: State, name: str, t_ns: int) -> State:
    """The state after one attempt at a carrier's frame, which counts as a report event."""
    link: Link = replace(state.links[name], bearings_t_ns=t_ns)
    state = replace(state, links={**state.links, name: link})
    reason = obstacle(state, name, t_ns)
    if reason is not None:
        kept = link.estimate if reason[0] == "suspended" else None
        link = Link(bearings_t_ns=t_ns, estimate=kept)
    else:
        state = pairing.with_pairs(state, name, t_ns)
        found, why_none = _estimated(state, name, t_ns)
        judged, adopted = monitor.after_registration(
            link.monitor, found, state.settings.monitor, why_none
        )
        estimate = found if adopted else link.estimate
        link = replace(link, events=link.events + 1, monitor=judged, estimate=estimate)
    return replace(state, links={**state.links, name: link})


def _estimated(state: State, name: str, t_ns: int) -> tuple[Estimate | None, str]:
    """What the bearings say of a frame; None with the reason where they say nothing."""
    try:
        with np.errstate(all="ignore"):  # numbers from the wire may be anything in bounds
            common = _common(state, name, t_ns)
            targets = common or pairing.candidates(state, name, t_ns)
            if not targets:
                return None, NOTHING_COMMON
            memory_s = state.settings.passive.frames_memory_s
            scene = scene_of(state, name, t_ns, targets, memory_s)
            if not has_manoeuvred(scene):
                return None, NO_MANOEUVRE.format(memory_s)
            if not common:
                return None, NOTHING_COMMON
            found = found_frame(scene)
            if found is None:
                return None, NO_MOTION
            frame, misclosure = found
            fixed = in_fixed_axes(frame, scene.prior)
            estimate = corrections.estimated(
                frame, fixed, scene.prior, scene.between, misclosure, "bearings"
            )
            return corrections.within_bounds(replace(estimate, since_t_ns=_since(state, name))), ""
    except (np.linalg.LinAlgError, ValueError) as error:
        return None, f"no frame comes out of these bearings: {error}"[:MAX_REASON]


def _since(state: State, name: str) -> int:
    """The instant at which the frame was first found of bearings."""
    link = state.links[name]
    before = link.estimate.since_t_ns if link.estimate else 0
    return before or link.bearings_t_ns
