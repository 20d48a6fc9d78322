"""Motions as paths of pieces, evaluated for all targets at once at any time.

Every motion is cut into pieces of constant turn rate or constant acceleration along the course;
a piece has a closed form, so nothing accumulates and any instant costs the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import atan2, cos, hypot, inf, radians, sin, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike
from estimation.frames import Site, on_surface, wrap_pi

from .scenario.motions import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    PathMotion,
    Waypoints,
)

Rows = NDArray[np.intp]
_EARTH_RADIUS_M = 6_371_000.0


class Kinematics(NamedTuple):
    """Where things are and how they move, each (N, 3), east-north-up at the origin."""

    position_m: Array
    velocity_mps: Array
    acceleration_mps2: Array

    def take(self, rows: Rows) -> Kinematics:
        """The same of some rows."""
        return Kinematics(*(values[rows] for values in self))

    def after(self, dt_s: ArrayLike) -> Kinematics:
        """Extrapolated by `dt_s`, one number or (N,), at constant acceleration."""
        dt = np.asarray(dt_s, dtype=float)[..., None]
        velocity = self.velocity_mps + dt * self.acceleration_mps2
        way = dt * (self.velocity_mps + dt / 2 * self.acceleration_mps2)
        return Kinematics(self.position_m + way, velocity, self.acceleration_mps2)


class Piece(NamedTuple):
    """A stretch of a path from its own start on; turn rate or acceleration is zero."""

    start_s: float
    east_m: float
    north_m: float
    course_rad: float
    speed_mps: float
    acceleration_mps2: float = 0.0
    turn_rate_rad_s: float = 0.0

    def after(self, dt_s: float) -> Piece:
        """The straight piece at constant speed that begins where this one is after `dt_s`."""
        length = dt_s * (self.speed_mps + self.acceleration_mps2 * dt_s / 2)
        chord = length * _sinc(self.turn_rate_rad_s * dt_s / 2)
        along = self.course_rad + self.turn_rate_rad_s * dt_s / 2
        return Piece(
            start_s=self.start_s + dt_s,
            east_m=self.east_m + chord * sin(along),
            north_m=self.north_m + chord * cos(along),
            course_rad=self.course_rad + self.turn_rate_rad_s * dt_s,
            speed_mps=self.speed_mps + self.acceleration_mps2 * dt_s,
        )


class Path(NamedTuple):
    """Pieces in order of their starts; after `period_s` it begins anew."""

    pieces: list[Piece]
    altitude_m: float = 0.0
    period_s: float = inf
    offset_s: float = 0.0


class Paths:
    """Many paths as arrays, one row each."""

    def __init__(self, origin: Site, paths: Sequence[Path]) -> None:
        self.origin = origin
        longest = max((len(p.pieces) for p in paths), default=0)
        blank = Piece(inf, 0.0, 0.0, 0.0, 0.0)
        rows = [p.pieces + [blank] * (longest - len(p.pieces)) for p in paths]
        self._pieces = np.array(rows, dtype=float).reshape(len(paths), longest, len(blank))
        self._altitude_m = np.array([p.altitude_m for p in paths])
        self._period_s = np.array([p.period_s for p in paths])
        self._offset_s = np.array([p.offset_s for p in paths])

    def __len__(self) -> int:
        return len(self._pieces)

    def at(self, t_s: ArrayLike, rows: ArrayLike | None = None) -> tuple[Kinematics, Array]:
        """Kinematics and courses [rad] of `rows` (M,), default all, at `t_s`, one or (M,)."""
        chosen: Rows = np.arange(len(self)) if rows is None else np.asarray(rows, dtype=np.intp)
        t = np.broadcast_to(np.asarray(t_s, dtype=float), chosen.shape) + self._offset_s[chosen]
        period = self._period_s[chosen]
        t = np.where(np.isfinite(period), np.mod(t, period), t)
        piece = self._pieces[chosen, self._current(t, chosen)]
        return _along(self.origin, piece, t, self._altitude_m[chosen])

    def _current(self, t: Array, rows: Rows) -> Rows:
        begun: Rows = (self._pieces[rows, :, 0] <= t[:, None]).sum(axis=1)
        return np.maximum(begun - 1, 0)


def _along(origin: Site, piece: Array, t: Array, altitude_m: Array) -> tuple[Kinematics, Array]:
    """Evaluate pieces (M, 7) at t (M,); up follows the curvature of the Earth."""
    start, east, north, course, speed, acceleration, turn_rate = piece.T
    dt = t - start
    half = turn_rate * dt / 2
    chord = dt * (speed + acceleration * dt / 2) * np.sinc(half / np.pi)
    east, north = east + chord * np.sin(course + half), north + chord * np.cos(course + half)
    position = on_surface(origin, east, north, altitude_m)
    course, speed = course + 2 * half, speed + acceleration * dt
    ahead = np.column_stack([np.sin(course), np.cos(course)])
    right = np.column_stack([np.cos(course), -np.sin(course)])
    velocity = speed[:, None] * ahead
    level = acceleration[:, None] * ahead + (speed * turn_rate)[:, None] * right
    return curved(position, velocity, level), course


def curved(position_m: Array, velocity_mps: Array, acceleration_mps2: Array) -> Kinematics:
    """Kinematics from positions (M, 3) and level motion (M, 2): at an altitude, up falls off."""
    level = position_m[:, :2]
    sinking = -(level * velocity_mps).sum(axis=1) / _EARTH_RADIUS_M
    falling = -((velocity_mps**2).sum(axis=1) + (level * acceleration_mps2).sum(axis=1))
    return Kinematics(
        position_m,
        np.column_stack([velocity_mps, sinking]),
        np.column_stack([acceleration_mps2, falling / _EARTH_RADIUS_M]),
    )


def path_of(motion: PathMotion) -> Path:
    """The path of a motion as a scenario file describes it."""
    match motion:
        case Waypoints():
            return _line(motion)
        case ConstantVelocity():
            pieces = [_start(motion)]
        case ConstantAcceleration():
            pieces = _accelerated(motion)
        case CoordinatedTurn():
            pieces = _turned(motion)
    return Path(pieces, motion.altitude_m)


def _start(motion: ConstantVelocity | ConstantAcceleration | CoordinatedTurn) -> Piece:
    return Piece(0.0, motion.east_m, motion.north_m, radians(motion.course_deg), motion.speed_mps)


def _accelerated(motion: ConstantAcceleration) -> list[Piece]:
    """Until the limit is reached; slowing down ends at 0, never in going backwards."""
    a = motion.acceleration_mps2
    first = _start(motion)._replace(acceleration_mps2=a)
    limit = motion.speed_limit_mps
    limit = 0.0 if limit is None and a < 0 else limit
    if a == 0 or limit is None:
        return [first._replace(acceleration_mps2=a)]
    until = (limit - motion.speed_mps) / a
    return [first, first.after(until)] if until > 0 else [_start(motion)]


def _turned(motion: CoordinatedTurn) -> list[Piece]:
    before = _start(motion)
    rate = radians(motion.turn_rate_deg_s)
    turn = before.after(motion.from_s)._replace(turn_rate_rad_s=rate)
    pieces = [before, turn] if motion.from_s > 0 else [turn]
    if motion.until_s < inf:
        pieces.append(turn.after(max(motion.until_s - motion.from_s, 0.0)))
    return pieces


def _line(motion: Waypoints) -> Path:
    """Legs joined by arcs; a closed line begins where the arc at its first point ends."""
    points = motion.points_m + (motion.points_m[:2] if motion.closed else [])
    legs = [_leg(*a, *b) for a, b in pairwise(points)]
    corners = [_corner(a, b, motion.turn_radius_m) for a, b in pairwise(legs)]
    trimmed = corners[-1].tangent_m if motion.closed else 0.0
    here = Piece(0.0, *points[0], legs[0].course_rad, motion.speed_mps)
    here = here.after(trimmed / motion.speed_mps)._replace(start_s=0.0)
    pieces = []
    for leg, corner in zip(legs, corners, strict=False):
        arc = here.after((leg.length_m - trimmed - corner.tangent_m) / motion.speed_mps)
        arc = arc._replace(turn_rate_rad_s=motion.speed_mps * corner.curvature_per_m)
        pieces += [here, arc]
        here = arc.after(corner.arc_m / motion.speed_mps)
        trimmed = corner.tangent_m
    period_s = here.start_s if motion.closed else inf
    pieces += [] if motion.closed else [here]
    return Path(pieces, motion.altitude_m, period_s, motion.start_along_m / motion.speed_mps)


class _Leg(NamedTuple):
    course_rad: float
    length_m: float


class _Corner(NamedTuple):
    """An arc that touches both legs, `tangent_m` before and after their common point."""

    tangent_m: float
    arc_m: float
    curvature_per_m: float


def _leg(east_m: float, north_m: float, to_east_m: float, to_north_m: float) -> _Leg:
    east, north = to_east_m - east_m, to_north_m - north_m
    return _Leg(atan2(east, north), hypot(east, north))


def _corner(into: _Leg, out: _Leg, radius_m: float) -> _Corner:
    """Of the wanted radius, or as wide as half the shorter leg allows."""
    turn = float(wrap_pi(out.course_rad - into.course_rad))
    if abs(turn) < 1e-6:
        return _Corner(0.0, 0.0, 0.0)
    steepness = tan(abs(turn) / 2)
    tangent = min(radius_m * steepness, min(into.length_m, out.length_m) / 2)
    radius = tangent / steepness
    return _Corner(tangent, radius * abs(turn), (1 if turn > 0 else -1) / radius)


def _sinc(x: float) -> float:
    return sin(x) / x if x else 1.0
