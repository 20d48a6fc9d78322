"""Ellipses, lines and turns as viewers want them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crossfix.export.foxglove_messages import (
    Color,
    LinePrimitive,
    Pose,
    Quaternion,
    SpherePrimitive,
    Vector3,
)
from crossfix.report.tracks import SIGMAS
from estimation.arrays import Array
from estimation.frames import RigidTransform

COLOURS = (
    (0.12, 0.47, 0.71), (0.84, 0.15, 0.16), (0.17, 0.63, 0.17),
    (0.58, 0.40, 0.74), (1.00, 0.50, 0.05), (0.09, 0.75, 0.81),
)  # fmt: skip
TRUTH = Color(0.35, 0.35, 0.35, 0.9)
LEAST_M, MOST_M = 5.0, 1e5
"""Full axes of an ellipse that can still be seen, and of one that still says something."""
LINE_STRIP, LINE_LIST = 0, 2


def colour(number: int, opacity: float = 1.0) -> Color:
    """The colour of the n-th carrier."""
    return Color(*COLOURS[number % len(COLOURS)], opacity)


def vector(point: Array) -> Vector3:
    """A point (2,) or (3,)."""
    x, y, *z = (round(float(value), 3) for value in point)
    return Vector3(x, y, z[0] if z else 0.0)


def ellipsoid(place_m: Array, covariance: Array, shade: Color) -> SpherePrimitive:
    """Two sigmas around a place (2,) or (3,), by the covariance (2, 2) of east and north, flat."""
    (drawn,) = ellipsoids(place_m[None], np.asarray(covariance)[None], shade)
    return drawn


def ellipsoids(places_m: Array, covariances: Array, shade: Color) -> list[SpherePrimitive]:
    """The same of n places (n, 2) or (n, 3) with their covariances (n, 2, 2)."""
    variances, directions = np.linalg.eigh(np.nan_to_num(covariances))
    axes = np.clip(2 * SIGMAS * np.sqrt(np.maximum(variances, 0.0)), LEAST_M, MOST_M)
    half = np.arctan2(directions[:, 1, 0], directions[:, 0, 0]) / 2
    points = np.zeros((len(places_m), 3))
    points[:, : places_m.shape[1]] = places_m
    return [
        SpherePrimitive(
            Pose(Vector3(*point), Quaternion(0.0, 0.0, sine, cosine)),
            Vector3(size[0], size[1], LEAST_M),
            shade,
        )
        for point, size, sine, cosine in zip(
            points.round(3).tolist(),
            axes.round(3).tolist(),
            np.sin(half).tolist(),
            np.cos(half).tolist(),
            strict=True,
        )
    ]


def dot(place_m: Array, size_m: float, shade: Color) -> SpherePrimitive:
    """A ball around a place."""
    return SpherePrimitive(Pose(vector(place_m)), Vector3(size_m, size_m, size_m), shade)


def rays(ends_m: Sequence[Array], shade: Color) -> LinePrimitive:
    """Lines from the origin of a frame to points."""
    points = [point for end in ends_m for point in (Vector3(), vector(end))]
    return LinePrimitive(LINE_LIST, Pose(), 1.0, True, points, shade)


def quaternion(rotation: Array) -> Quaternion:
    """A rotation (3, 3)."""
    largest = int(np.argmax([*np.diag(rotation), np.trace(rotation)]))
    if largest == 3:
        w = 1 + np.trace(rotation)
        xyz = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0],
               rotation[1, 0] - rotation[0, 1]]  # fmt: skip
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        xyz = [0.0, 0.0, 0.0]
        xyz[i] = 1 + rotation[i, i] - rotation[j, j] - rotation[k, k]
        xyz[j] = rotation[j, i] + rotation[i, j]
        xyz[k] = rotation[k, i] + rotation[i, k]
        w = rotation[k, j] - rotation[j, k]
    x, y, z, w = (float(v) for v in np.array([*xyz, w]) / np.linalg.norm([*xyz, w]))
    return Quaternion(x, y, z, w)


def pose_of(transform: RigidTransform) -> Pose:
    """Where the source frame of a transform lies in its target frame."""
    x, y, z = (float(value) for value in transform.translation_m)
    return Pose(Vector3(x, y, z), quaternion(transform.rotation))
