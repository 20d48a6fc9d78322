"""Relative frames in space: bearing, range and elevation; yaw, pitch and roll of both carriers.

As in the plane, the adjustment works in own (biased) sensor axes: q is where the other carrier
stands in them, and own_from_other turns its axes into them; six numbers that three targets not
on one line determine. The own attitude is the weakly known gauge. A small turn is a rotation
vector about east, north and up: pitch and roll of a carrier are its level parts, yaw (clockwise)
is minus its up part.

Source of the rotations' derivatives: Barfoot, State Estimation for Robotics, section 7.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.relative_frame.gauge import root_of
from estimation.relative_frame.matrices import inverse, times

_STEPS, _STILL = 30, 1e-6


@dataclass(frozen=True, eq=False, slots=True)
class SphericalLogs:
    """Target logs of one carrier with elevation, the i-th of the same target as the other's.

    Attributes:
        measured: (..., L, 3) bearing [rad], slant range [m], elevation [rad] in carrier axes.
        covariance: (..., L, 3, 3) of them.
    """

    measured: Array
    covariance: Array


class AttitudePrior(NamedTuple):
    """What navigation says before any target is compared.

    Attributes:
        offset_m: (..., 3) reported position of the other carrier, east, north, up.
        covariance: (9, 9) of its error, of the own and of the other's attitude error [m, rad].
    """

    offset_m: Array
    covariance: Array


class SpatialFrame(NamedTuple):
    """The other carrier's frame in own sensor axes.

    Attributes:
        q_m: (..., 3) its position.
        own_from_other: (..., 3, 3) rotation of its axes into own ones.
        covariance: (..., 6, 6) of q and of the rotation vector, in own axes.
        chi2: (...) chi-squared of 3 L.
        converged: (...) False: not to be used.
    """

    q_m: Array
    own_from_other: Array
    covariance: Array
    chi2: Array
    converged: NDArray[np.bool_]


class _State(NamedTuple):
    q: Array
    turn: Array  # own_from_other
    by_z: Array  # (N, 6, 9)


def spatial_adjustment(
    own: SphericalLogs, other: SphericalLogs, prior: AttitudePrior
) -> SpatialFrame:
    """Exact adjustment (Gauss-Helmert) of q and own_from_other from L associated logs.

    Starts from the prior, for attitude errors up to some ten degrees.

    Raises:
        ValueError: own and other differ in length.
    """
    pairs = own.measured.shape[-2]
    if pairs != other.measured.shape[-2]:
        raise ValueError(
            f"need the same targets from both: own {pairs}, other {other.measured.shape[-2]}"
        )
    batch = np.broadcast_shapes(own.measured.shape[:-2], prior.offset_m.shape[:-1])
    both = [_flat(logs, batch) for logs in (own, other)]
    offset = np.broadcast_to(prior.offset_m, (*batch, 3)).reshape(-1, 3)
    root = root_of(prior.covariance)
    z, v = np.zeros((len(offset), 9)), [np.zeros_like(logs.measured) for logs in both]
    for _ in range(_STEPS):
        state = _state(z, offset, root)
        white, back = _conditions(both, v, state)
        gram = (transposed(white) @ white).sum(axis=1)
        information, vector = gram[:, :6, :6], -gram[:, :6, 6]
        covariance = inverse(np.eye(9) + transposed(state.by_z) @ information @ state.by_z)
        step = times(covariance, times(transposed(state.by_z), vector) - z)
        moved = np.concatenate([times(state.by_z, step), np.ones((len(z), 1))], axis=1)
        residual = times(white, moved[:, None])  # C^-1 (w + H step)
        v = [times(gain, residual) for gain in back]
        z = z + step
        still = np.sum(step * np.linalg.solve(covariance, step[..., None])[..., 0], 1) < _STILL**2
        if still.all():
            break
    end = _state(z, offset, root)
    return SpatialFrame(
        end.q.reshape(*batch, 3),
        end.turn.reshape(*batch, 3, 3),
        (end.by_z @ covariance @ transposed(end.by_z)).reshape(*batch, 6, 6),
        (np.square(residual).sum(axis=(1, 2)) + np.square(z).sum(axis=1)).reshape(batch),
        still.reshape(batch),
    )


def _flat(logs: SphericalLogs, batch: tuple[int, ...]) -> SphericalLogs:
    pairs = logs.measured.shape[-2]
    count = int(np.prod(batch))
    return SphericalLogs(
        np.broadcast_to(logs.measured, (*batch, pairs, 3)).reshape(count, pairs, 3),
        np.broadcast_to(logs.covariance, (*batch, pairs, 3, 3)).reshape(count, pairs, 3, 3),
    )


def _state(z: Array, offset: Array, root: Array) -> _State:
    """Q and own_from_other at z, and their derivative: fixed_from_own = exp(a1), and so on."""
    theta = z @ root.T
    a1, a2 = theta[:, 3:6], theta[:, 6:]
    own_from_fixed = transposed(rotation(a1))
    place = offset + theta[:, :3]
    by_theta = np.zeros((len(z), 6, 9))
    by_theta[:, :3, :3] = own_from_fixed
    by_theta[:, :3, 3:6] = own_from_fixed @ cross_matrix(place) @ _left_jacobian(a1)
    by_theta[:, 3:, 3:6] = -own_from_fixed @ _left_jacobian(a1)
    by_theta[:, 3:, 6:] = own_from_fixed @ _left_jacobian(a2)
    return _State(times(own_from_fixed, place), own_from_fixed @ rotation(a2), by_theta @ root)


def _conditions(
    both: list[SphericalLogs], v: list[Array], state: _State
) -> tuple[Array, list[Array]]:
    """Whitened [H w] (N, L, 3, 7) of p1 - q - R p2 = 0, and what takes residuals to each v."""
    turn = state.turn[:, None]
    own, by_own = _place(both[0].measured + v[0])
    seen, by_seen = _place(both[1].measured + v[1])
    other, by_other = times(turn, seen), turn @ by_seen
    spread = [
        by @ logs.covariance @ transposed(by)
        for by, logs in zip((by_own, by_other), both, strict=True)
    ]
    whiten = inverse(np.asarray(np.linalg.cholesky(spread[0] + spread[1]), dtype=float))
    columns = np.zeros((*own.shape[:2], 3, 7))
    columns[..., range(3), range(3)] = -1
    columns[..., 3:6] = cross_matrix(other)
    columns[..., 6] = own - state.q[:, None] - other - times(by_own, v[0]) + times(by_other, v[1])
    back = [
        sign * logs.covariance @ transposed(by) @ transposed(whiten)
        for sign, by, logs in zip((-1, 1), (by_own, by_other), both, strict=True)
    ]
    return whiten @ columns, back


def _place(measured: Array) -> tuple[Array, Array]:
    """Points (..., 3) east, north, up and derivatives (..., 3, 3) by bearing, range, elevation."""
    bearing, reach, elevation = np.moveaxis(measured, -1, 0)
    sin_b, cos_b, sin_e, cos_e = (f(a) for a in (bearing, elevation) for f in (np.sin, np.cos))
    toward = np.stack([cos_e * sin_b, cos_e * cos_b, sin_e], axis=-1)
    across = np.stack([cos_e * cos_b, -cos_e * sin_b, np.zeros_like(sin_e)], axis=-1)
    upward = np.stack([-sin_e * sin_b, -sin_e * cos_b, cos_e], axis=-1)
    far = reach[..., None]
    return far * toward, np.stack([far * across, toward, far * upward], axis=-1)


def rotation(vector: Array) -> Array:
    """Rotations (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    _, cross, sine, cosine = _rodrigues(vector)
    return np.eye(3) + sine * cross + cosine * (cross @ cross)


def rotation_vector(matrix: Array) -> Array:
    """Rotation vectors (..., 3) [rad] of rotations of less than half a turn."""
    axis = np.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(axis, axis=-1) / 2
    angle = np.arctan2(sine, (np.trace(matrix, axis1=-2, axis2=-1) - 1) / 2)
    scale = np.where(sine > 1e-8, angle / np.where(sine > 1e-8, sine, 1.0), 1.0)
    vector: Array = axis / 2 * scale[..., None]
    return vector


def cross_matrix(vector: Array) -> Array:
    """Matrices (..., 3, 3) that multiply as `vector` x."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*x.shape, 3, 3)


def _left_jacobian(vector: Array) -> Array:
    """J with exp(a + d) = exp(J d) exp(a) to first order."""
    angle, cross, _, cosine = _rodrigues(vector)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    third = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + cosine * cross + third * (cross @ cross)


def _rodrigues(vector: Array) -> tuple[Array, Array, Array, Array]:
    """Angle, cross matrix, sin(angle) / angle and (1 - cos(angle)) / angle^2, as (..., 1, 1)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    return angle, cross_matrix(vector), np.sinc(angle / np.pi), np.sinc(angle / 2 / np.pi) ** 2 / 2
