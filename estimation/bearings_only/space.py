"""Bearings with elevations: a target of constant altitude, known or not, seen from any height.

Elevation adds little to the range. A known altitude (a ship seen from an aircraft, or the
reverse) gives it without any manoeuvre.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike
from estimation.bearings_only.criterion import Criterion, criterion
from estimation.bearings_only.estimate import Estimate
from estimation.bearings_only.levenberg_marquardt import minimised
from estimation.bearings_only.linear_algebra import inverted
from estimation.bearings_only.measurements import Bearings, padded, scene_of
from estimation.bearings_only.motions import CONSTANT_VELOCITY, Motion
from estimation.bearings_only.normal_equations import Normal, directions, products
from estimation.bearings_only.starts import lines_of, taubin


class Elevations(NamedTuple):
    """Elevations taken together with bearings.

    Attributes:
        elevation_rad: (..., N) above the horizon; not finite = not measured.
        sigma_rad: (..., N).
        observer_altitude_m: (..., N).
    """

    elevation_rad: Array
    sigma_rad: Array
    observer_altitude_m: Array


class SpatialEstimate(NamedTuple):
    """A motion in space: the horizontal part, and the altitude.

    Attributes:
        horizontal: places, velocities, ranges (horizontal) as without elevations, with what the
            elevations add.
        altitude_m, sigma_altitude_m: (B,).
    """

    horizontal: Estimate
    altitude_m: Array
    sigma_altitude_m: Array


class _SpatialProblem(NamedTuple):
    """The criterion with the homogeneous altitude z = s * altitude as the last parameter."""

    plane: Criterion
    elevation: Array  # (N, B)
    weight: Array  # (N, B)
    observer: Array  # (N, 1 or B) altitude, lengths
    known: Array  # (1 or B,) altitude, lengths
    known_weight: Array  # (1 or B,) 1 / sigma; 0 = not known

    def evaluate(self, p: Array) -> Normal:
        """Cost, half gradient and J'J of bearings, elevations and the known altitude."""
        flat = self.plane.evaluate(p[:-1])
        residual, rows = self._elevations(p)
        gradient, matrix = products(residual, rows)
        gradient[:-1] += flat.gradient
        matrix[:-1, :-1] += flat.matrix
        cost = flat.cost + np.einsum("nb,nb->b", residual, residual)
        return Normal(cost, gradient, matrix)

    def _elevations(self, p: Array) -> tuple[Array, Array]:
        """Residuals (N + 1, B), predicted less measured, the known altitude last; and J."""
        s_row, s = self.plane.motion.scale_row, p[self.plane.motion.scale_row]
        d, by = directions(self.plane.scene, self.plane.motion, p[:-1])
        far, up = np.abs(d) + 1e-300, p[-1] - s * self.observer
        squared = far**2 + up**2
        rows = np.empty((len(p), len(d) + 1, p.shape[1]))
        rows[:-1, :-1] = -(by * d.conj()).real * (up / far / squared)
        rows[s_row, :-1] -= self.observer * far / squared
        rows[-1, :-1] = far / squared
        rows[:, :-1] *= self.weight
        rows[:, -1] = 0
        rows[-1, -1], rows[s_row, -1] = self.known_weight / s, -self.known_weight * p[-1] / s**2
        elevations = (np.arctan2(up, far) - self.elevation) * self.weight
        altitude = np.where(
            self.known_weight > 0, (p[-1] / s - self.known) * self.known_weight, 0.0
        )
        return np.concatenate([elevations, altitude[None]]), rows

    def admissible(self, p: Array) -> Array:
        """The horizontal part of unit length."""
        length = np.sqrt(np.einsum("mb,mb->b", p[:-1], p[:-1])) + 1e-300
        scaled: Array = p / length
        return scaled

    def gauge(self, p: Array) -> Array:
        """All parameters are homogeneous."""
        return p

    def take(self, columns: NDArray[np.int_]) -> _SpatialProblem:
        """The same for some of the targets."""
        parts = (a if a.shape[-1] == 1 else a[..., columns] for a in self[3:])
        each = self.elevation[:, columns], self.weight[:, columns]
        return _SpatialProblem(self.plane.take(columns), *each, *parts)


def in_space(
    given: Bearings,
    elevations: Elevations,
    altitude_m: ArrayLike = np.nan,
    sigma_altitude_m: ArrayLike = np.inf,
    motion: Motion = CONSTANT_VELOCITY,
) -> SpatialEstimate:
    """The most likely motion at constant altitude.

    Args:
        given: bearings of one or many targets.
        elevations: with the same shapes.
        altitude_m, sigma_altitude_m: of the target when it is known; a number or (B,).
        motion: in the horizontal; a polynomial.
    """
    if given.bearing_rad.shape[-1] == 0:
        none = np.full((*given.batch, 1), np.nan)
        elevations = Elevations(none, none, none)
    given = padded(given)
    scene = scene_of(given)
    problem = _problem(criterion(scene, motion), given, elevations, altitude_m, sigma_altitude_m)
    with np.errstate(all="ignore"):
        flat = taubin(lines_of(scene, motion, np.zeros((0, 1, 1))))
        tries = [_lifted(problem, flat), *_at_known_altitude(problem, flat)]
        ends = [minimised(problem, start) for start in tries]
        best = np.argmin([np.nan_to_num(e.normal.cost, nan=np.inf) for e in ends], axis=0)
        columns = np.arange(scene.targets)
        p = np.stack([e.p for e in ends])[best, :, columns].T
        matrix = np.moveaxis(np.stack([e.normal.matrix for e in ends])[best, :, :, columns], 0, 2)
        cost = np.stack([e.normal.cost for e in ends])[best, columns]
        converged = np.stack([e.converged for e in ends])[best, columns]
        return _told(problem, p, matrix, cost, converged)


def _problem(
    plane: Criterion,
    given: Bearings,
    elevations: Elevations,
    altitude_m: ArrayLike,
    sigma_m: ArrayLike,
) -> _SpatialProblem:
    """Everything in the units of the scene."""
    shape = (plane.scene.targets, given.bearing_rad.shape[-1])
    elevation, sigma, height = (
        np.broadcast_to(np.asarray(part, dtype=float), (*given.batch, shape[1])).reshape(shape).T
        for part in elevations
    )
    seen = np.isfinite(elevation) & (sigma > 0) & np.isfinite(height)
    altitude, spread = np.atleast_1d(altitude_m).astype(float), np.atleast_1d(sigma_m).astype(float)
    known = np.isfinite(altitude) & (spread > 0)
    length = plane.scene.length_m
    return _SpatialProblem(
        plane,
        np.where(seen, elevation, 0.0),
        np.where(seen, 1 / np.where(seen, sigma, 1.0), 0.0),
        np.where(np.isfinite(height), height, 0.0) / length,
        np.where(known, altitude, 0.0) / length,
        np.where(known, 1 / np.where(known, spread, 1.0), 0.0) * length,
    )


def _lifted(problem: _SpatialProblem, flat: Array) -> Array:
    """A horizontal start with the altitude that the elevations give at its ranges."""
    d, _ = directions(problem.plane.scene, problem.plane.motion, flat)
    s = flat[problem.plane.motion.scale_row]
    weight = problem.weight + 1e-12
    up = (np.tan(problem.elevation) * np.abs(d) + s * problem.observer) * weight
    return np.concatenate([flat, up.sum(axis=0)[None] / weight.sum(axis=0)])


def _at_known_altitude(problem: _SpatialProblem, flat: Array) -> list[Array]:
    """The start moved along the bearings to where the mean elevation meets the known altitude."""
    if not (problem.known_weight > 0).any():
        return []
    scene, s_row = problem.plane.scene, problem.plane.motion.scale_row
    slope = (np.tan(problem.elevation) * problem.weight).sum(axis=0) / (
        problem.weight.sum(axis=0) + 1e-12
    )
    distance = (problem.known - problem.observer).mean(axis=0) / np.where(slope == 0, 1e-9, slope)
    distance = np.clip(np.abs(distance), 1e-3, 1e6)
    toward = scene.toward * scene.weight
    places = toward / (scene.weight + 1e-12) * distance + scene.observer
    f, _ = problem.plane.motion.basis(scene.time, np.zeros((0, 1)))
    fit = np.linalg.pinv(f.real[..., 0].T if f.shape[2] == 1 else f.real.mean(axis=2).T)
    c = fit @ places
    start = flat.copy()
    size = len(c)
    start[:size], start[size:s_row], start[s_row] = c.real, c.imag, 1.0
    return [np.concatenate([start, np.broadcast_to(problem.known, (1, start.shape[1]))])]


def _told(
    problem: _SpatialProblem,
    p: Array,
    matrix: Array,
    cost: Array,
    converged: NDArray[np.bool_],
) -> SpatialEstimate:
    """The altitude, and the horizontal motion with the altitude integrated out."""
    scene, s_row = problem.plane.scene, problem.plane.motion.scale_row
    corner = matrix[-1, -1] + 1e-290
    reduced = matrix[:-1, :-1] - matrix[:-1, -1:] * matrix[-1:, :-1] / corner
    gauge = np.einsum("iib->b", matrix) * p[:, None] * p[None]
    covariance = inverted(matrix + gauge)
    by = np.zeros_like(p)
    by[-1], by[s_row] = 1 / p[s_row], -p[-1] / p[s_row] ** 2
    sigma = np.sqrt(np.maximum(np.einsum("mb,mnb,nb->b", by, covariance, by), 0))
    return SpatialEstimate(
        Estimate(scene, problem.plane.motion, p[:-1], reduced, cost, converged),
        p[-1] / p[s_row] * scene.length_m,
        sigma * scene.length_m,
    )
