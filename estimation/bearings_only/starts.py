"""Where a search begins: closed forms that need no range (Taubin) or assume one (ridge)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.bearings_only.linear_algebra import cholesky, solved
from estimation.bearings_only.measurements import ComplexArray, Scene
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.prior import MotionPrior

_RIDGE = 1e-9
_ITERATIONS = 5


class Lines(NamedTuple):
    """Bearings as lines, linear in h = (theta, s); columns C are shapes times targets.

    Attributes:
        across: (2K + 1, N, C) rows a: a'h is the offset of the target from the line.
        along: (2K + 1, N, C) rows g: g'h is its distance along it.
        offsets, distances: (2K + 1, 2K + 1, C) sums of aa' and gg'.
        shape: (P, C) of the motion.
        weight: (N, C) of the bearings.
        middle: (C,) unit vector along the mean bearing.
    """

    across: Array
    along: Array
    offsets: Array
    distances: Array
    shape: Array
    weight: Array
    middle: ComplexArray


def lines_of(scene: Scene, motion: Motion, grid: Array) -> Lines:
    """The lines for every shape of a grid (P, G, 1 or B) and every target, shapes outermost."""
    shapes, targets = grid.shape[1], scene.targets
    shape = np.broadcast_to(grid, (*grid.shape[:2], targets)).reshape(len(grid), shapes * targets)
    if scene.time.shape[1] == 1 and grid.shape[2] == 1:
        f = np.repeat(
            motion.basis(scene.time, grid[..., 0])[0], targets if motion.path else 1, axis=2
        )
    else:
        time = np.tile(scene.time, shapes) if scene.time.shape[1] > 1 else scene.time
        f = motion.basis(time, shape)[0]
    turned = np.tile(scene.weight * scene.toward.conj(), shapes)
    along_f = f * turned
    observer = np.tile(scene.observer, shapes if scene.observer.shape[1] > 1 else 1) * turned
    across = np.concatenate([along_f.imag, along_f.real, -observer.imag[None]])
    along = np.concatenate([along_f.real, -along_f.imag, -observer.real[None]])
    mean = (scene.toward * scene.weight**2).sum(axis=0)
    return Lines(
        across,
        along,
        _gram(across),
        _gram(along),
        shape,
        np.tile(scene.weight, shapes),
        np.tile(mean / (np.abs(mean) + 1e-290), shapes),
    )


def taubin(lines: Lines) -> Array:
    """Parameters (M, C) with the least sum of squared offsets by that of squared distances.

    This eigenvector needs no range and is not drawn to the observer as least squares is. Found by
    inverse iteration; its sign puts the target in front.

    Source: G. Taubin, Estimation of planar curves ..., IEEE PAMI 13 (1991), section 5.
    """
    m, n = lines.offsets, lines.distances
    trace = np.einsum("iib->b", m) + 1e-290
    factor = cholesky(m + _RIDGE * trace * np.eye(len(m))[..., None])
    h = lines.along.sum(axis=1)
    for _ in range(_ITERATIONS):
        h = solved(factor, np.einsum("ijb,jb->ib", n, h))
        h /= np.sqrt(np.einsum("ib,ib->b", h, h)) + 1e-290
    front = np.einsum("mnb,mb->b", lines.along, h)
    return np.concatenate([np.where(front < 0, -h, h), lines.shape])


def ridge(lines: Lines, scales: Array, distance: Array) -> Array:
    """Parameters (M, C) by pseudo-linear least squares about an assumed range, with the prior.

    The offsets of the target from the bearings are divided by the range, the rows of the prior
    keep velocity and acceleration small.

    Args:
        scales: (K, C) prior sigmas of the coefficients in units of the scene; the first is free.
        distance: (C,) the assumed range, likewise.
    """
    size = len(scales)
    m = lines.offsets / distance**2
    for order in range(size):
        weight = (1 / scales[order] if order else 1 / distance) ** 2
        m[order, order] += weight
        m[size + order, size + order] += weight
    s = 2 * size
    right = -m[:s, s]
    right[0] += lines.middle.real / distance
    right[size] += lines.middle.imag / distance
    theta = solved(cholesky(m[:s, :s]), right)
    return np.concatenate([theta, np.ones((1, theta.shape[1])), lines.shape])


def misfit(lines: Lines, p: Array) -> Array:
    """(C,) about the chi-squared of the bearings: sines for angles, behind counts as right off."""
    h = p[: len(lines.across)]
    offset = np.einsum("mnc,mc->nc", lines.across, h)
    distance = np.einsum("mnc,mc->nc", lines.along, h)
    squared = offset**2
    sine = squared / (squared + distance**2 + 1e-290)
    sine = np.where(distance > 0, sine, 2 - sine) * lines.weight**2
    found: Array = sine.sum(axis=0)
    return found


def scales_of(scene: Scene, motion: Motion, prior: MotionPrior) -> Array:
    """Prior sigmas (K, 1 or B) of the coefficients in units of the scene, the range's first."""
    sigmas = (prior.sigma_speed_mps, prior.sigma_acceleration_mps2, prior.sigma_jerk_mps3)
    orders = range(1, motion.degree + 1)
    units = [sigmas[j - 1] * scene.half_span_s**j / scene.length_m for j in orders]
    return np.stack([prior.range_m / scene.length_m, *units])


def _gram(rows: Array) -> Array:
    each = np.ascontiguousarray(np.moveaxis(rows, 2, 0))
    return np.ascontiguousarray(np.moveaxis(each @ np.swapaxes(each, 1, 2), 0, 2))
