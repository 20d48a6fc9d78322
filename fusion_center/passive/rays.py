"""Bearings of targets as their carriers took them, over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import Site, target_from_source, yaw_rad
from schemas.messages import SourceReport

from ..navigation import pose_at, site, way_m
from ..settings import PassiveSettings
from ..sources.coordinates import instants_ns
from ..state import Rays, State
from .naming import bearings_of, names, target_of

NO_RAYS = Rays(t_ns=np.zeros(0, dtype=np.int64), seen=np.zeros((0, 4)))


def with_report(state: State, report: SourceReport) -> State:
    """The bearing of every target that is told apart, clockwise from the origin's north."""
    carrier, settings = state.carriers[report.carrier], state.settings.passive
    called = names(state, report)
    if not carrier.navigation or not any(called):
        return state
    origin = state.scenario.origin
    there = Site(origin.latitude_rad, origin.longitude_rad, origin.altitude_m)
    bearing, sigma = bearings_of(state, report)
    at_ns = instants_ns(report)
    with np.errstate(all="ignore"):  # numbers from the wire may be anything in bounds
        here = site(pose_at(carrier.navigation, report.t_ns))
        turned = bearing + yaw_rad(target_from_source(there, here))
        rows = np.column_stack([way_m(carrier.navigation, at_ns), turned, sigma])
    rays = dict(state.rays)
    for i, name in enumerate(called):
        if name and np.isfinite(rows[i]).all() and sigma[i] > 0:
            key = f"{report.carrier}/{name}"
            rays[key] = _longer(rays.get(key) or NO_RAYS, int(at_ns[i]), rows[i], settings)
    return replace(state, rays=_bounded(rays, settings.most_targets))


def by_target(state: State, carrier: str) -> dict[str, Rays]:
    """The bearings of a carrier, by what its targets are called in common.

    Nameless ones that were lost and found again are pieces of one.
    """
    pieces: dict[str, list[Rays]] = {}
    for key, rays in state.rays.items():
        whose, _, called = key.partition("/")
        if whose == carrier:
            pieces.setdefault(target_of(state, carrier, called), []).append(rays)
    return {target: _joined(some) for target, some in pieces.items()}


def _joined(pieces: Sequence[Rays]) -> Rays:
    """In order of time, one of an instant."""
    if len(pieces) == 1:
        return pieces[0]
    t_ns, first = np.unique(np.concatenate([r.t_ns for r in pieces]), return_index=True)
    return Rays(t_ns=t_ns, seen=np.concatenate([r.seen for r in pieces])[first])


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
