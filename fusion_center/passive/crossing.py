"""Bearings of several carriers to one target, solved together once the frames may be used.

The bearings are kept as their carriers took them (`rays`), so that each solution has all of them
in the frames as they are known now. What these leave unsure is the same for all bearings of a
carrier and counts once (`FrameDoubt`). The frames are as known from the same bearings: given a
frame, a target is as its own bearings say, and averaged over the frames it is what frames and
targets estimated together would give.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only import FrameDoubt, Solution, bearings, solve_many
from estimation.bearings_only import State as Place
from estimation.frames import Site, rotation_clockwise, target_from_source, yaw_rad
from schemas.messages import BearingLine, SourceReport

from ..navigation import NS, velocity_mps, way_m
from ..picture.axes import Placed, placed
from ..relative_frames.links import sees_bearings_only
from ..settings import PassiveSettings
from ..state import Line, Rays, State
from ..timeline import Instant
from .rays import by_target
from .telling import described

NOT_CROSSED = Line(t_ns=np.zeros(0, dtype=np.int64), seen=np.zeros((0, 4)))


class Sight(NamedTuple):
    """A carrier in the picture at an instant.

    Attributes:
        turn_rad: what its rays are turned by; axes_turn_rad: and its axes.
        place_m, way_m: (2,) where it is, and how far it has come by its own reckoning.
        velocity_mps: (2,) in the picture.
    """

    axes: Placed
    turn_rad: float
    place_m: Array
    way_m: Array
    velocity_mps: Array


class Bundle(NamedTuple):
    """The bearings of one target by several carriers, in order of time, the own one's last.

    Attributes:
        carriers: names.
        who: (N,) index among them; t_ns: (N,).
        seen: (N, 4) east and north of the carrier, bearing and its sigma, in the picture.
    """

    carriers: tuple[str, ...]
    who: NDArray[np.intp]
    t_ns: NDArray[np.int64]
    seen: Array


def crossed(state: State, instant: Instant) -> State:
    """The state with every target solved anew that several carriers see and that has news."""
    settings, t_ns = state.settings.passive, instant.t_ns
    said = any(isinstance(m, SourceReport) and m.bearing_rad for m in instant.messages)
    if not said or not settings.enabled or not state.rays:
        return state
    sights = _sights(state, t_ns)
    bundles = _bundles(state, sights, t_ns) if len(sights) > 1 else {}
    known = {target: state.crossed.get(target, NOT_CROSSED) for target in sorted(bundles)}
    due = [
        target
        for target, before in known.items()
        if int(bundles[target].t_ns[-1]) > before.solved_t_ns
        and (before.tried_t_ns < 0 or t_ns - before.tried_t_ns >= _ns(settings.solve_every_s))
    ]
    found = _solutions([bundles[target] for target in due], sights) if due else []
    for target, solution in zip(due, found, strict=True):
        bundle = bundles[target]
        told = _told(target, bundle, solution, sights)
        newest = int(bundle.t_ns[-1])
        known[target] = Line(
            identity=target,
            t_ns=NOT_CROSSED.t_ns,
            seen=NOT_CROSSED.seen,
            told=told,
            solved_t_ns=newest,
            tried_t_ns=t_ns,
        )
    return state if known == state.crossed else replace(state, crossed=known)


def shown(state: State, t_ns: int) -> dict[str, BearingLine]:
    """What is told of targets that several carriers see, by name, while it is not too old."""
    oldest = t_ns - _ns(state.settings.passive.shown_s)
    told = ((target, line.told) for target, line in state.crossed.items())
    return {target: line for target, line in told if line is not None and line.t_ns >= oldest}


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def _sights(state: State, t_ns: int) -> dict[str, Sight]:
    """The own carrier and all that see bearings only whose frame may be used, the own first."""
    others = [name for name in sorted(state.links) if sees_bearings_only(state, name)]
    found = ((name, placed(state, name, t_ns)) for name in (state.own, *others))
    return {name: _sight(state, name, axes, t_ns) for name, axes in found if axes is not None}


def _sight(state: State, carrier: str, axes: Placed, t_ns: int) -> Sight:
    origin, navigation = state.scenario.origin, state.carriers[carrier].navigation
    there = Site(origin.latitude_rad, origin.longitude_rad, origin.altitude_m)
    turn = rotation_clockwise(axes.turn_rad)
    return Sight(
        axes,
        axes.turn_rad - float(yaw_rad(target_from_source(there, axes.site))),
        axes.place_m(),
        way_m(navigation, t_ns),
        turn @ velocity_mps(navigation),
    )


def _bundles(state: State, sights: dict[str, Sight], t_ns: int) -> dict[str, Bundle]:
    """The bearings of every target that two of these carriers have seen often enough."""
    settings = state.settings.passive
    of_all: dict[str, dict[str, Rays]] = {}
    for carrier in sights:
        for target, rays in sorted(by_target(state, carrier).items()):
            if _count(rays, settings, t_ns) >= settings.least_bearings:
                of_all.setdefault(target, {})[carrier] = rays
    return {
        target: _bundle(state, seen, sights, t_ns)
        for target, seen in of_all.items()
        if len(seen) > 1
    }


def _count(rays: Rays, settings: PassiveSettings, t_ns: int) -> int:
    return int((rays.t_ns >= t_ns - _ns(settings.frames_memory_s)).sum())


def _bundle(
    state: State, by_carrier: dict[str, Rays], sights: dict[str, Sight], t_ns: int
) -> Bundle:
    """The bearings of one target, where the carriers were when they took them."""
    oldest = t_ns - _ns(state.settings.passive.frames_memory_s)
    t, who, seen = [], [], []
    for k, (carrier, rays) in enumerate(by_carrier.items()):
        sight = sights[carrier]
        kept = rays.t_ns >= oldest
        back = (rays.seen[kept, :2] - sight.way_m) @ rotation_clockwise(sight.axes.turn_rad).T
        bearing = rays.seen[kept, 2] + sight.turn_rad
        seen.append(np.column_stack([sight.place_m + back, bearing, rays.seen[kept, 3]]))
        t.append(rays.t_ns[kept])
        who.append(np.full(len(t[-1]), k))
    at_ns, of = np.concatenate(t), np.concatenate(who)
    order = np.lexsort((-of, at_ns))
    return Bundle(tuple(by_carrier), of[order], at_ns[order], np.concatenate(seen)[order])


def _solutions(bundles: Sequence[Bundle], sights: dict[str, Sight]) -> list[Solution]:
    """Of all bundles in one batch, the shorter ones filled up in front by what was not seen."""
    others = [name for name, sight in sights.items() if sight.axes.common() is not None]
    most = max(len(b.t_ns) for b in bundles)
    rows = np.array([np.concatenate([b.seen[[0] * (most - len(b.seen))], b.seen]) for b in bundles])
    t_ns = np.array([np.pad(b.t_ns, (most - len(b.t_ns), 0), mode="edge") for b in bundles])
    carrier = np.zeros(rows.shape[:2], dtype=np.intp)
    for i, b in enumerate(bundles):
        empty = most - len(b.t_ns)
        rows[i, :empty, 2] = np.nan
        index = [others.index(name) + 1 if name in others else 0 for name in b.carriers]
        carrier[i, empty:] = np.array(index)[b.who]
    at_s: Array = np.multiply(t_ns - t_ns.max(), NS)
    common = [c for name in others if (c := sights[name].axes.common()) is not None]
    doubt = FrameDoubt(
        carrier, np.array([c.pivot_m for c in common]), np.array([c.covariance for c in common])
    )
    given = bearings(at_s, rows[..., :2], rows[..., 2], rows[..., 3])
    return solve_many(given, doubt=doubt)


def _told(
    target: str, bundle: Bundle, solution: Solution, sights: dict[str, Sight]
) -> BearingLine | None:
    """A solution as it is published; None where it gives no place."""
    last = bundle.carriers[int(bundle.who[-1])]
    state = solution.at(solution.last_s)
    if state is None or not np.isfinite(state.covariance).all():
        return None
    return described(
        _line(f"{'+'.join(bundle.carriers)}/{target}", bundle, state, sights[last].velocity_mps),
        solution,
        len(bundle.t_ns),
    )


def _line(name: str, bundle: Bundle, state: Place, own_mps: Array) -> BearingLine:
    """The line to a place from the carrier of the last bearing, which moves by itself."""
    here = bundle.seen[-1, :2]
    apart, rate = state.position_m - here, state.velocity_mps - own_mps
    far = float(np.hypot(*apart)) + 1e-9
    along = apart / far
    across = np.array([along[1], -along[0]])
    sideways = float(across @ state.covariance[:2, :2] @ across)
    return BearingLine(
        id=name,
        status="weak",
        t_ns=int(bundle.t_ns[-1]),
        observer_m=here.tolist(),
        bearing_rad=float(np.mod(np.arctan2(*apart), 2 * np.pi)),
        sigma_bearing_rad=float(np.sqrt(max(sideways, 0.0))) / far,
        bearing_rate_rad_s=float(rate @ across) / far,
        range_rate_by_range_hz=float(rate @ along) / far,
        carriers=list(bundle.carriers),
    )
