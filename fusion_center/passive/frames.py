"""Frames of carriers that report bearings only, from the bearings of targets they share over time.

Two bearings of one instant fix a target and leave nothing for the frames. Over time they do not:
targets move steadily and a carrier turns. The bearings of named targets are kept as their carriers
took them (`rays`). Every so often the other carrier's place and north (q, D) are found of the
newest of them (`common_targets`). Nothing is carried over from one solution to the next.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import Site, rotation_clockwise, target_from_source, yaw_rad
from estimation.relative_frame import in_fixed_axes
from schemas.messages import SourceReport

from ..navigation import NS, site, way_m
from ..relative_frames import corrections, monitor
from ..relative_frames.links import navigated, obstacle, sees_bearings_only
from ..relative_frames.monitor import MAX_REASON
from ..state import Estimate, Link, State
from ..timeline import Instant
from .common_targets import Scene, Seen, found_frame, has_manoeuvred
from .rays import with_report

NO_MANOEUVRE = (
    "neither carrier has manoeuvred: bearings from two uniform ways fit at many ranges, "
    "and location and orientation stay open"
)
NO_MOTION = "no common target moves so steadily that its bearings agree"


def with_bearings(state: State, instant: Instant) -> State:
    """The state after the bearings of one instant, with every frame that is due tried anew."""
    reports = [m for m in instant.messages if isinstance(m, SourceReport) and m.bearing_rad]
    if not reports or not state.settings.passive.enabled:
        return state
    others = [name for name in sorted(state.links) if sees_bearings_only(state, name)]
    if not others:
        return state
    for report in reports:
        if report.carrier in (state.own, *others) and report.identity:
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
    common = _common(state, name, t_ns)
    newest = [
        max((int(state.rays[f"{carrier}/{target}"].t_ns[-1]) for target in common), default=-1)
        for carrier in (state.own, name)
    ]
    return min(newest) > tried


def _common(state: State, name: str, t_ns: int) -> list[str]:
    """Targets of which both carriers have enough bearings of the window, the most seen first."""
    settings = state.settings.passive
    oldest = t_ns - round(settings.frames_memory_s * 1e9)
    seen = {}
    for key, rays in state.rays.items():
        carrier, _, target = key.partition("/")
        theirs = state.rays.get(f"{name}/{target}")
        if carrier == state.own and theirs is not None:
            seen[target] = min(int((r.t_ns >= oldest).sum()) for r in (rays, theirs))
    enough = [target for target in seen if seen[target] >= settings.least_bearings]
    enough.sort(key=lambda target: (-seen[target], target))
    return enough[: settings.frames_most_targets]


def _tried(state: State, name: str, t_ns: int) -> State:
    """The state after one attempt at a carrier's frame, which counts as a report event."""
    link: Link = replace(state.links[name], bearings_t_ns=t_ns)
    state = replace(state, links={**state.links, name: link})
    reason = obstacle(state, name, t_ns)
    if reason is not None:
        kept = link.estimate if reason[0] == "suspended" else None
        link = Link(bearings_t_ns=t_ns, estimate=kept)
    else:
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
            scene = _scene(state, name, t_ns)
            if not has_manoeuvred(scene):
                return None, NO_MANOEUVRE
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


def _scene(state: State, name: str, t_ns: int) -> Scene:
    """Both carriers' bearings of their common targets, along the own plane of now."""
    targets = _common(state, name, t_ns)
    between, prior = navigated(state, name, t_ns)
    origin = state.scenario.origin
    there = Site(origin.latitude_rad, origin.longitude_rad, origin.altitude_m)
    plane = yaw_rad(target_from_source(there, site(between.own)))
    turns = {state.own: np.eye(2), name: rotation_clockwise(yaw_rad(between.own_from_other))}
    own, other = (
        _seen(state, carrier, targets, t_ns, plane, turn) for carrier, turn in turns.items()
    )
    return Scene(own, other, between, prior)


def _seen(
    state: State, carrier: str, targets: Sequence[str], t_ns: int, plane_rad: float, turn: Array
) -> Seen:
    """The targets as one carrier has them, all at the instants at which it saw any of them."""
    oldest = t_ns - round(state.settings.passive.frames_memory_s * 1e9)
    rays = [state.rays[f"{carrier}/{target}"] for target in targets]
    times, first = np.unique(np.concatenate([r.t_ns for r in rays]), return_index=True)
    way = np.concatenate([r.seen[:, :2] for r in rays])[first]
    bearing = np.full((len(rays), len(times)), np.nan)
    sigma = np.ones_like(bearing)
    for k, r in enumerate(rays):
        at = np.searchsorted(times, r.t_ns)
        bearing[k, at], sigma[k, at] = r.seen[:, 2] - plane_rad, r.seen[:, 3]
    kept = times >= oldest
    here = way_m(state.carriers[carrier].navigation, t_ns)
    t_s: Array = np.multiply(times[kept] - t_ns, NS)
    return Seen(t_s, (way[kept] - here) @ turn.T, bearing[:, kept], sigma[:, kept])
