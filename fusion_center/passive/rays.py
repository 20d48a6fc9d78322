"""Bearings of named targets as their carriers took them, over time."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import Site, target_from_source, yaw_rad
from schemas.messages import SourceReport

from ..navigation import pose_at, site, way_m
from ..settings import PassiveSettings
from ..sources.coordinates import column, instants_ns
from ..state import Rays, State

NO_RAYS = Rays(t_ns=np.zeros(0, dtype=np.int64), seen=np.zeros((0, 4)))


def with_report(state: State, report: SourceReport) -> State:
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
