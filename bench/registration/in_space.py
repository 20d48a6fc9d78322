"""Frames in space: bearing, range and elevation, yaw, pitch and roll."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, between, told
from bench.registration.scenes import DEG, SIDE_M, SIGMA_BEARING_RAD, SIGMA_RANGE_M
from estimation.arrays import Array, transposed
from estimation.consistency import nees
from estimation.relative_frame.attitude import (
    AttitudePrior,
    SpatialFrame,
    SphericalLogs,
    rotation,
    rotation_vector,
    spatial_adjustment,
)
from estimation.relative_frame.matrices import times

LENGTHS = (3, 5, 10, 30)
CEILING_M = 10e3
SIGMA_ATTITUDE_RAD = 1 * DEG
SIGMAS = np.array([1500.0, 1500.0, 300.0, *[SIGMA_ATTITUDE_RAD] * 6])


class Scene(NamedTuple):
    """What both carriers measure, and the true frame in own axes."""

    own: SphericalLogs
    other: SphericalLogs
    prior: AttitudePrior
    q_m: Array
    own_from_other: Array


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The demand on attitude."""
    for pairs in LENGTHS:
        scene = drawn(np.random.default_rng([seed, pairs, 3]), max(runs // 10, 40), pairs)
        found = spatial_adjustment(scene.own, scene.other, scene.prior)
        honest = nees(error(found, scene), found.covariance).mean() / 6
        yield between(f"in space, L = {pairs}: NEES/6", float(honest), 0.93, 1.07)
        chi2 = float(found.chi2.mean()) / (3 * pairs)
        yield between(f"in space, L = {pairs}: chi2/(3L)", chi2, 0.97, 1.03)
        yield told(f"in space, L = {pairs}: share converged", float(found.converged.mean()))


def drawn(rng: np.random.Generator, runs: int, pairs: int) -> Scene:
    """Targets in a box above the square, carriers near the ground, errors by the prior."""
    box = np.array([SIDE_M / 2, SIDE_M / 2, CEILING_M])
    targets = rng.uniform([-1, -1, 0], 1, (runs, pairs, 3)) * box
    offset = rng.uniform([-1, -1, 0], 1, (runs, 3)) * [SIDE_M / 2, SIDE_M / 2, 200]
    theta = SIGMAS * rng.standard_normal((runs, 9))
    own_from_fixed, other_from_fixed = (
        transposed(rotation(theta[:, part])) for part in (slice(3, 6), slice(6, 9))
    )
    return Scene(
        _measured(rng, times(own_from_fixed[:, None], targets)),
        _measured(rng, times(other_from_fixed[:, None], targets - offset[:, None])),
        AttitudePrior(offset - theta[:, :3], np.diag(SIGMAS**2)),
        times(own_from_fixed, offset),
        own_from_fixed @ transposed(other_from_fixed),
    )


def _measured(rng: np.random.Generator, points: Array) -> SphericalLogs:
    level = np.hypot(points[..., 0], points[..., 1])
    exact = [
        np.arctan2(points[..., 0], points[..., 1]),
        np.linalg.norm(points, axis=-1),
        np.arctan2(points[..., 2], level),
    ]
    sigmas = np.array([SIGMA_BEARING_RAD, SIGMA_RANGE_M, SIGMA_BEARING_RAD])
    measured = np.stack(exact, axis=-1) + sigmas * rng.standard_normal(points.shape)
    covariance = np.broadcast_to(np.diag(sigmas**2), (*points.shape, 3))
    return SphericalLogs(measured, covariance)


def error(found: SpatialFrame, scene: Scene) -> Array:
    """Errors (N, 6) of q and of the rotation, in own axes."""
    turn = rotation_vector(found.own_from_other @ transposed(scene.own_from_other))
    return np.concatenate([found.q_m - scene.q_m, turn], axis=1)
