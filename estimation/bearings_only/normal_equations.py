"""Cost, gradient and J'J of the bearings in homogeneous coordinates.

With h = (theta, s) and place = theta / s, the direction to the target is d = Phi theta - s o: it
needs no range, and an infinite one (s = 0) is a point like any other. The residual is the angle
between the bearing and d; all of it is blind to the length of h.

Parameters (M, B) are the real parts of the coefficients, their imaginary parts, s, the shape.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.measurements import ComplexArray, Scene
from estimation.bearings_only.motions import Motion

Loss: TypeAlias = Callable[[Array, Array], tuple[Array, Array]]
"""Squared standardised residuals (N, B) and 1 / sigma, 0 = not seen -> cost and weight of each."""


class Normal(NamedTuple):
    """A criterion about a point: cost (B,), half its gradient (M, B), J'J (M, M, B)."""

    cost: Array
    gradient: Array
    matrix: Array


class Tables(NamedTuple):
    """What J'J of a polynomial needs of times and places, the same for all targets.

    Attributes:
        basis: (N, K) powers of time.
        products: (C, N) of basis and basis, basis and east, basis and north, east and north.
        linear: (K + 2, N) basis, east, north.
    """

    basis: Array
    products: Array
    linear: Array


def tables_of(scene: Scene, motion: Motion) -> Tables:
    """The tables of a scene whose targets share times and places."""
    basis = motion.basis(scene.time, np.zeros((0, 1)))[0].real[..., 0]
    east, north = scene.observer.real[:, 0], scene.observer.imag[:, 0]
    upper = np.triu_indices(len(basis))
    products = np.concatenate(
        [
            basis[upper[0]] * basis[upper[1]],
            basis * east,
            basis * north,
            [east * east, east * north, north * north],
        ]
    )
    return Tables(basis.T.copy(), products, np.concatenate([basis, [east, north]]))


def polynomial_normal(scene: Scene, tables: Tables, p: Array, loss: Loss | None) -> Normal:
    """Of polynomials, by products with constant tables."""
    size = tables.basis.shape[1]
    s = p[2 * size]
    dx = tables.basis @ p[:size] - scene.observer.real * s
    dy = tables.basis @ p[size : 2 * size] - scene.observer.imag * s
    u, v = scene.toward.real, scene.toward.imag
    residual = np.arctan2(dy * u - dx * v, dx * u + dy * v)
    residual *= scene.weight
    by_range = scene.weight / (dx * dx + dy * dy + 1e-300)
    cost, weight = _losses(residual, scene.weight, loss)
    if weight is not None:
        root = np.sqrt(weight)
        residual, by_range = residual * root, by_range * root
    a, b = dy * by_range, dx * by_range
    a *= -1
    square = [tables.products @ (a * a), tables.products @ (a * b), tables.products @ (b * b)]
    right = tables.linear @ (a * residual), tables.linear @ (b * residual)
    return Normal(cost, _gradient(size, *right), _matrix(size, *square))


def _gradient(size: int, a: Array, b: Array) -> Array:
    return np.concatenate([a[:size], b[:size], [-a[size] - b[size + 1]]])


def _matrix(size: int, aa: Array, ab: Array, bb: Array) -> Array:
    """J'J (2K + 1, 2K + 1, B) from its products with the tables."""
    matrix = np.empty((2 * size + 1, 2 * size + 1, aa.shape[1]))
    i, j = np.triu_indices(size)
    pairs, s = len(i), 2 * size
    for rows, columns, part in ((0, 0, aa), (0, size, ab), (size, size, bb)):
        matrix[i + rows, j + columns] = part[:pairs]
        matrix[j + rows, i + columns] = part[:pairs]
    matrix[size:s, :size] = matrix[:size, size:s]
    east, north = slice(pairs, pairs + size), slice(pairs + size, pairs + 2 * size)
    matrix[:size, s] = matrix[s, :size] = -aa[east] - ab[north]
    matrix[size:s, s] = matrix[s, size:s] = -ab[east] - bb[north]
    matrix[s, s] = aa[-3] + 2 * ab[-2] + bb[-1]
    return matrix


def general_normal(scene: Scene, motion: Motion, p: Array, loss: Loss | None) -> Normal:
    """Of any motion and any times and places."""
    residual, jacobian = residuals(scene, motion, p)
    cost, weight = _losses(residual, scene.weight, loss)
    if weight is not None:
        root = np.sqrt(weight)
        residual, jacobian = residual * root, jacobian * root
    return Normal(cost, *products(residual, jacobian))


def products(residual: Array, jacobian: Array) -> tuple[Array, Array]:
    """J'r (M, B) and J'J (M, M, B) of r (N, B) and J (M, N, B)."""
    rows = np.ascontiguousarray(np.moveaxis(jacobian, 2, 0))
    matrix = np.moveaxis(rows @ np.swapaxes(rows, 1, 2), 0, 2)
    return np.einsum("mnb,nb->mb", jacobian, residual), matrix


def residuals(scene: Scene, motion: Motion, p: Array) -> tuple[Array, Array]:
    """Standardised residuals (N, B), measured less predicted bearing, with J (M, N, B)."""
    c, s, shape = unpacked(motion, p)
    f, slopes = motion.basis(scene.time, shape)
    d = (f[1:] * c[1:, None]).sum(axis=0) if len(f) > 2 else f[1] * c[1]
    d += c[0]
    d -= s * scene.observer
    turned = d * scene.toward.conj()
    residual = np.arctan2(turned.imag, turned.real)
    residual *= scene.weight
    reciprocal = d.conj()
    reciprocal *= scene.weight / (d.real**2 + d.imag**2 + 1e-300)
    size, row = motion.degree + 1, motion.scale_row
    jacobian = np.empty((len(p), *residual.shape))
    jacobian[0], jacobian[size] = reciprocal.imag, reciprocal.real
    for k in range(1, size):
        rows = f[k] * reciprocal
        jacobian[k], jacobian[size + k] = rows.imag, rows.real
    jacobian[row] = -(scene.observer * reciprocal).imag
    reciprocal *= c[1]
    for k, slope in enumerate(slopes):
        jacobian[row + 1 + k] = (slope * reciprocal).imag
    return residual, jacobian


def directions(scene: Scene, motion: Motion, p: Array) -> tuple[ComplexArray, ComplexArray]:
    """Directions d (N, B) and its derivatives (M, N, B) by the parameters."""
    c, s, shape = unpacked(motion, p)
    f, slopes = motion.basis(scene.time, shape)
    size = len(f)
    by = np.empty((len(p), len(scene.time), p.shape[1]), dtype=complex)
    by[:size] = f
    by[size : 2 * size] = 1j * f
    by[2 * size] = -scene.observer
    by[2 * size + 1 :] = slopes * c[1]
    return np.einsum("knb,kb->nb", by[:size], c) - s * scene.observer, by


def unpacked(motion: Motion, p: Array) -> tuple[ComplexArray, Array, Array]:
    """Coefficients (K, B), homogeneous scale (B,) and shape (P, B)."""
    size, s = motion.degree + 1, motion.scale_row
    return p[:size] + 1j * p[size:s], p[s], p[s + 1 :]


def _losses(
    residual: Array, by_sigma: Array, loss: Loss | None
) -> tuple[Array, NDArray[np.float64] | None]:
    if loss is None:
        return np.einsum("nb,nb->b", residual, residual), None
    cost, weight = loss(residual**2, by_sigma)
    return cost.sum(axis=0), weight
