"""Frames of carriers that report bearings only, from the bearings of targets they share over time.

Two bearings of one instant fix a target and leave nothing for the frames. Over time they do not:
targets move steadily and a carrier turns. The bearings of named targets are kept as their carriers
took them. Every so often the newest of them are solved together: each target by the plainest
motion that agrees with its bearings, and the other carrier's place and north (q, D) with all of
them. Nothing is carried over from one solution to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_ACCELERATION,
    CONSTANT_JERK,
    CONSTANT_VELOCITY,
    Bearings,
    FramePrior,
    JointSolution,
    bearings,
    jointly,
)
from estimation.frames import Site, rotation_clockwise, target_from_source, yaw_rad
from estimation.relative_frame import (
    OwnAxesFrame,
    RelativeFramePrior,
    in_fixed_axes,
    prior_in_own_axes,
)
from schemas.messages import SourceReport

from ..navigation import NS, pose_at, site, way_m
from ..relative_frames import corrections, monitor
from ..relative_frames.corrections import Misclosure, Poses
from ..relative_frames.links import navigated, obstacle, sees_bearings_only
from ..relative_frames.monitor import MAX_REASON
from ..settings import PassiveSettings
from ..sources.coordinates import column, instants_ns
from ..state import Estimate, Link, Rays, State
from ..timeline import Instant

MOTIONS = (CONSTANT_VELOCITY, CONSTANT_ACCELERATION, CONSTANT_JERK)
NO_RAYS = Rays(t_ns=np.zeros(0, dtype=np.int64), seen=np.zeros((0, 4)))
BETTER = 9.21
"""What two parameters more must take from chi2 to be believed: 99 % of chance takes less."""
UNFIT = 1e-3
"""Probability of its chi2 below which no motion of a target is believed, and it is left out."""
MOTION_DOUBT = 2.0
"""How much less bearings tell of a frame than if targets moved as the polynomials that pass for
their motions: without it the covariance was half as large as the errors' (NEES 4.6 of 3)."""
MANOEUVRE_SIGMAS = 3.0
"""Of a bearing, across the distance of the carriers: how far a manoeuvre leaves a uniform way."""
NO_MANOEUVRE = (
    "neither carrier has manoeuvred: bearings from two uniform ways fit at many ranges, "
    "and location and orientation stay open"
)
NO_MOTION = "no common target moves so steadily that its bearings agree"


class Seen(NamedTuple):
    """Common targets as one carrier has them over the window, along the own plane of now.

    Attributes:
        t_s: (N,) before now, negative.
        way_m: (N, 2) from where it is now.
        bearing_rad, sigma_rad: (T, N); a bearing that there is not is nan.
    """

    t_s: Array
    way_m: Array
    bearing_rad: Array
    sigma_rad: Array


class Scene(NamedTuple):
    """What both carriers have of their common targets, and what navigation says of the frame."""

    own: Seen
    other: Seen
    between: Poses
    prior: RelativeFramePrior

    @property
    def pivot_m(self) -> Array:
        """(2,) middle of the other's way: about it, its place and its north are nearly apart."""
        middle: Array = self.other.way_m.mean(axis=0)
        return middle


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
            state = _with_report(state, report)
    for name in others:
        if _is_due(state, name, instant.t_ns):
            state = _tried(state, name, instant.t_ns)
    return state


def _with_report(state: State, report: SourceReport) -> State:
    """The bearing of every target with an identity, clockwise from the origin's north."""
    carrier, settings = state.carriers[report.carrier], state.settings.passive
    if not carrier.navigation or not report.identity:
        return state
    origin, n = state.scenario.origin, len(report)
    there = Site(origin.latitude_rad, origin.longitude_rad, origin.altitude_m)
    properties = state.sources(report.carrier).get(report.stream)
    default = properties.sigma_bearing_rad if properties else None
    stated = column(report.sigma_bearing_rad, n)
    at_ns = instants_ns(report)
    with np.errstate(all="ignore"):  # numbers from the wire may be anything in bounds
        here = site(pose_at(carrier.navigation, report.t_ns))
        bearing = column(report.bearing_rad, n) + yaw_rad(target_from_source(there, here))
        sigma = np.where(np.isnan(stated), default or np.nan, stated)
        rows = np.column_stack([way_m(carrier.navigation, at_ns), bearing, sigma])
    rays = dict(state.rays)
    kinds = report.identity_kind or [""] * n
    for i, name in enumerate(report.identity):
        if name and np.isfinite(rows[i]).all() and sigma[i] > 0:
            key = f"{report.carrier}/{kinds[i]}/{name}"
            rays[key] = _longer(rays.get(key) or NO_RAYS, int(at_ns[i]), rows[i], settings)
    return replace(state, rays=_bounded(rays, settings.most_targets))


def _longer(rays: Rays, t_ns: int, row: Array, settings: PassiveSettings) -> Rays:
    """One bearing more, without those that are too old; one of an instant is enough."""
    if len(rays.t_ns) and t_ns <= rays.t_ns[-1]:
        return rays
    kept = rays.t_ns >= t_ns - round(settings.frames_memory_s * 1e9)
    most = settings.most_bearings
    return Rays(
        t_ns=np.append(rays.t_ns[kept], np.int64(t_ns))[-most:],
        seen=np.vstack([rays.seen[kept], row])[-most:],
    )


def _bounded(rays: dict[str, Rays], most: int) -> dict[str, Rays]:
    """At most so many targets, those that were seen last."""
    if len(rays) <= most:
        return rays
    newest = sorted(rays, key=lambda key: (-int(rays[key].t_ns[-1]), key))[:most]
    return {key: rays[key] for key in sorted(newest)}


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


def has_manoeuvred(scene: Scene) -> bool:
    """Whether a carrier's way leaves the uniform one by more than bearings err."""
    apart_m = float(np.hypot(*scene.prior.offset_m))
    for seen in (scene.own, scene.other):
        sigma = float(np.median(seen.sigma_rad[np.isfinite(seen.bearing_rad)]))
        uniform = np.column_stack([np.ones_like(seen.t_s), seen.t_s])
        left = seen.way_m - uniform @ np.linalg.lstsq(uniform, seen.way_m, rcond=None)[0]
        if np.hypot(*left.T).max() > MANOEUVRE_SIGMAS * sigma * apart_m:
            return True
    return False


def found_frame(scene: Scene) -> tuple[OwnAxesFrame, Misclosure] | None:
    """The frame that bearings and navigation together make likeliest; None if no target agrees.

    The targets of each kind of motion are solved together. What each kind says of the frame is
    summed as information, with navigation's prior, which has correlations, in place of the one of
    the solutions. A first pass finds how the other carrier's way is turned.
    """
    turned_rad, prior = 0.0, _about_pivot(scene)
    wide = FramePrior(float(np.sqrt(prior[0, 0])), float(np.sqrt(np.trace(prior[1:, 1:]))))
    motions = _motions(scene, wide)
    if not any(motions):
        return None
    for _ in range(2):
        solved = [
            jointly(_carriers(scene, turned_rad, np.array(some)), [wide], motion)
            for motion, some in zip(MOTIONS, motions, strict=True)
            if some
        ]
        if not all(s.converged for s in solved):
            return None
        mean, covariance, chi2 = _summed(solved, wide, prior)
        turned_rad = float(mean[0])
    pairs = sum(map(len, motions))
    told = Misclosure(pairs, chi2, sum(s.dof for s in solved))
    return _now(scene, mean, covariance), told


def _about_pivot(scene: Scene) -> Array:
    """Covariance (3, 3) of yaw, east, north of the frame at the middle of the other's way."""
    known, (east, north) = prior_in_own_axes(scene.prior).covariance, scene.pivot_m
    by_frame = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, north], [0.0, 1.0, -east]])
    covariance: Array = by_frame @ known @ by_frame.T
    return covariance


def _carriers(scene: Scene, turned_rad: float, which: Array) -> tuple[Bearings, Bearings]:
    """Some of the targets, the other's way turned about its middle."""
    own, other, pivot = scene.own, scene.other, scene.pivot_m
    way = pivot + (other.way_m - pivot) @ rotation_clockwise(turned_rad).T
    places = own.way_m, scene.prior.offset_m + way
    one, two = (
        bearings(seen.t_s, place, seen.bearing_rad[which], seen.sigma_rad[which])
        for seen, place in zip((own, other), places, strict=True)
    )
    return one, two


def _motions(scene: Scene, prior: FramePrior) -> list[list[int]]:
    """The targets of each kind of motion: the plainest that a richer one does not much better."""
    groups: list[list[int]] = [[] for _ in MOTIONS]
    for target in range(len(scene.own.bearing_rad)):
        carriers = _carriers(scene, 0.0, np.array([target]))
        kind = _motion(carriers, prior)
        if kind is not None:
            groups[kind].append(target)
    return groups


def _motion(carriers: Sequence[Bearings], prior: FramePrior) -> int | None:
    """Which kind of motion a target has, as far as its bearings go; None if it has none of them."""
    from scipy.special import chdtrc  # 0.1 s, kept out of the start

    best: tuple[int, JointSolution] | None = None
    for kind, motion in enumerate(MOTIONS):
        found = jointly(carriers, [prior], motion)
        if not found.converged or found.dof < 1:
            continue
        if best is not None and best[1].chi2 - found.chi2 < BETTER * (kind - best[0]):
            break
        best = kind, found
    if best is None or chdtrc(best[1].dof, best[1].chi2) < UNFIT:
        return None
    return best[0]


def _summed(
    solved: Sequence[JointSolution], wide: FramePrior, prior: Array
) -> tuple[Array, Array, float]:
    """Mean (3,) and covariance (3, 3) of yaw, east, north, and chi2, of all solutions together."""
    assumed = np.diag([wide.sigma_yaw_rad, *2 * (wide.sigma_offset_m,)]) ** -2.0
    assumed[~np.eye(3, dtype=bool)] = 0.0
    known = np.linalg.inv(prior)
    each = [np.linalg.inv(s.covariance) for s in solved]
    means = [np.append(s.yaw_rad[1], s.offset_m[1]) for s in solved]
    gained = (sum(each) - len(each) * assumed) / MOTION_DOUBT
    covariance = np.linalg.inv(known + gained)
    told = np.sum([e @ m for e, m in zip(each, means, strict=True)], axis=0) / MOTION_DOUBT
    mean = covariance @ told
    chi2 = float(mean @ known @ mean)
    for s, e, m in zip(solved, each, means, strict=True):
        chi2 += float(s.chi2 + (mean - m) @ e @ (mean - m) - mean @ assumed @ mean)
    if not (np.diag(covariance) > 0).all():
        raise ValueError("the covariance is not positive")
    return mean, (covariance + covariance.T) / 2, chi2


def _now(scene: Scene, mean: Array, covariance: Array) -> OwnAxesFrame:
    """The frame where the other carrier is now, from that at the middle of its way."""
    turn = rotation_clockwise(mean[0])
    gone = turn @ scene.pivot_m
    q = scene.prior.offset_m + scene.pivot_m + mean[1:] - gone
    by_frame = np.array([[-gone[1], 1.0, 0.0], [gone[0], 0.0, 1.0], [1.0, 0.0, 0.0]])
    return OwnAxesFrame(q, np.array(mean[0]), by_frame @ covariance @ by_frame.T)
