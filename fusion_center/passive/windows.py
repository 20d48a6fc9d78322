"""The bearings of two carriers over a window, along the own plane of now."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import Site, rotation_clockwise, target_from_source, yaw_rad

from ..navigation import NS, site, way_m
from ..relative_frames.links import navigated
from ..state import Rays, State
from .common_targets import Scene, Seen


class Sides(NamedTuple):
    """Bearings of targets of the own carrier and of another, by what they are called."""

    own: dict[str, Rays]
    other: dict[str, Rays]

    def __bool__(self) -> bool:
        """Whether both have any."""
        return bool(self.own and self.other)


def scene_of(state: State, name: str, t_ns: int, targets: Sides, window_s: float) -> Scene:
    """What the own carrier and another have of targets, and what navigation says of the frame."""
    between, prior = navigated(state, name, t_ns)
    origin = state.scenario.origin
    there = Site(origin.latitude_rad, origin.longitude_rad, origin.altitude_m)
    plane = yaw_rad(target_from_source(there, site(between.own)))
    turns = {state.own: np.eye(2), name: rotation_clockwise(yaw_rad(between.own_from_other))}
    own, other = (
        _seen(state, carrier, list(some.values()), (t_ns, window_s), plane, turns[carrier])
        for carrier, some in zip((state.own, name), targets, strict=True)
    )
    return Scene(own, other, between, prior)


def _seen(
    state: State,
    carrier: str,
    rays: Sequence[Rays],
    window: tuple[int, float],
    plane_rad: float,
    turn: Array,
) -> Seen:
    """The targets as one carrier has them, all at the instants at which it saw any of them."""
    t_ns, window_s = window
    times, first = np.unique(np.concatenate([r.t_ns for r in rays]), return_index=True)
    way = np.concatenate([r.seen[:, :2] for r in rays])[first]
    bearing = np.full((len(rays), len(times)), np.nan)
    sigma = np.ones_like(bearing)
    for k, r in enumerate(rays):
        at = np.searchsorted(times, r.t_ns)
        bearing[k, at], sigma[k, at] = r.seen[:, 2] - plane_rad, r.seen[:, 3]
    kept = times >= t_ns - round(window_s * 1e9)
    here = way_m(state.carriers[carrier].navigation, t_ns)
    t_s: Array = np.multiply(times[kept] - t_ns, NS)
    return Seen(t_s, (way[kept] - here) @ turn.T, bearing[:, kept], sigma[:, kept])
