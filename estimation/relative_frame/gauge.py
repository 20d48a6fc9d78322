"""Priors of the iteration: a step is taken where the prior is the unit matrix, z.

`Gauge` is navigation's prior of (x, y, c1, c2): exactly Gaussian there, so c1 is carried as a
weakly known gauge and the frame seen from own axes follows. `Gaussian` is a prior of (q, D)
itself, what a recursion hands on. Either may be singular (a sigma of zero is a constraint).
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from estimation.arrays import Array
from estimation.relative_frame.logs import OwnAxesFrame, RelativeFramePrior
from estimation.relative_frame.matrices import Indices, times


class Prior(Protocol):
    """What the iteration asks of a prior; arrays are flat over N experiments."""

    def at(self, z: Array) -> tuple[Array, Array]:
        """Parameters (N, K), (q, D) first, of z (N, M), and their derivative (N, K, M)."""

    def moved(self, z: Array, step: Array, aim: Array) -> Array:
        """Where a step (N, M) from z leads, which is to reach the parameters `aim` (N, K)."""

    def bend(self, z: Array) -> Array:
        """Half the second derivative (N, M, M) of |moved(z, step)|^2, less the unit matrix."""

    def of(self, which: Indices) -> Prior:
        """The experiments `which` (n,) of the N."""


class Gauge(NamedTuple):
    """Prior of theta = (x, y, c1, c2) about a reported offset; theta = root z.

    Attributes:
        offset_m: (N, 2).
        root: (N, 4, 4).
        whitener: (N, 2, 2) the inverse of the root's block of x and y, where it has one.
    """

    offset_m: Array
    root: Array
    whitener: Array

    def theta(self, z: Array) -> Array:
        """(N, 4) corrections in fixed axes."""
        return times(self.root, z)

    def at(self, z: Array) -> tuple[Array, Array]:
        """(q, D) and its derivative (N, 3, 4)."""
        theta = self.theta(z)
        sin, cos = np.sin(theta[:, 2]), np.cos(theta[:, 2])
        x, y = (self.offset_m + theta[:, :2]).T
        point = np.empty((len(z), 3))
        point[:, 0] = cos * x - sin * y
        point[:, 1] = sin * x + cos * y
        point[:, 2] = theta[:, 3] - theta[:, 2]
        by_theta = np.zeros((len(z), 3, 4))
        by_theta[:, 0, 0] = by_theta[:, 1, 1] = cos
        by_theta[:, 0, 1], by_theta[:, 1, 0] = -sin, sin
        by_theta[:, 0, 2], by_theta[:, 1, 2] = -point[:, 1], point[:, 0]
        by_theta[:, 2, 2], by_theta[:, 2, 3] = -1, 1
        return point, by_theta @ self.root

    def moved(self, z: Array, step: Array, aim: Array) -> Array:
        """A turn of c1 carries q along its circle: the data hold q, so keep its linear motion."""
        return self.with_q(z + step, aim)

    def bend(self, z: Array) -> Array:
        """Offsets move by c1 G dxy + c1^2/2 (offset + xy) beyond the linear, G the quarter turn."""
        pull = (z[:, None, :2] @ self.whitener)[:, 0]  # z' W
        sigma_c1 = self.root[:, 2, 2]
        offset = self.offset_m + self.theta(z)[:, :2]
        turned = np.stack([-pull[:, 1], pull[:, 0]], axis=1)  # pull' G
        matrix = np.zeros((len(z), 4, 4))
        matrix[:, 2, 2] = sigma_c1**2 * np.sum(pull * offset, axis=1)
        cross = sigma_c1[:, None] * (turned[:, None] @ self.root[:, :2, :2])[:, 0]
        matrix[:, 2, :2] = matrix[:, :2, 2] = cross
        return matrix

    def with_q(self, z: Array, q_m: Array) -> Array:
        """With the c1 and c2 of z, the offset that puts the other carrier at q (N, 2 or more)."""
        c1 = self.root[:, 2, 2] * z[:, 2]
        sin, cos = np.sin(c1), np.cos(c1)
        apart = -self.offset_m
        apart[:, 0] += cos * q_m[:, 0] + sin * q_m[:, 1]
        apart[:, 1] += cos * q_m[:, 1] - sin * q_m[:, 0]
        z = z.copy()
        z[:, :2] = times(self.whitener, apart)
        return z

    def of(self, which: Indices) -> Gauge:
        """The experiments `which`."""
        return Gauge(*(array[which] for array in self))


class Gaussian(NamedTuple):
    """Prior of any parameters whose first three are (q, D): mean (N, K), root (N, K, K)."""

    mean: Array
    root: Array

    def at(self, z: Array) -> tuple[Array, Array]:
        """The mean + root z, and the root, wherever z is."""
        return self.mean + times(self.root, z), self.root

    def moved(self, z: Array, step: Array, aim: Array) -> Array:
        """The sum: everything is linear."""
        del aim
        return z + step

    def bend(self, z: Array) -> Array:
        """None."""
        return np.zeros((len(z), *self.root.shape[1:]))

    def of(self, which: Indices) -> Gaussian:
        """The experiments `which`."""
        return Gaussian(self.mean[which], self.root[which])


def gauge(prior: RelativeFramePrior, batch: tuple[int, ...]) -> Gauge:
    """Navigation's prior, broadcast to a batch and made flat."""
    root = np.broadcast_to(prior.root, (*batch, 4, 4)).reshape(-1, 4, 4)
    offset = np.broadcast_to(prior.offset_m, (*batch, 2)).reshape(-1, 2)
    return Gauge(offset, root, np.linalg.pinv(root[:, :2, :2]).astype(float))


def root_of(covariance: Array) -> Array:
    """A square root (..., n, n) of covariances of mixed units, which may be singular.

    What is known, with a variance of 0, stays known: its row is 0, not rounding.
    """
    sigmas = np.sqrt(np.einsum("...ii->...i", covariance))
    scale = np.where(sigmas > 0, sigmas, 1)
    variances, axes = np.linalg.eigh(covariance / (scale[..., :, None] * scale[..., None, :]))
    root: Array = sigmas[..., None] * axes * np.sqrt(np.maximum(variances, 0))[..., None, :]
    return root


def gaussian(frame: OwnAxesFrame, batch: tuple[int, ...]) -> Gaussian:
    """A frame known from before, broadcast to a batch and made flat."""
    mean = np.concatenate([frame.q_m, np.asarray(frame.D_rad)[..., None]], axis=-1)
    root = root_of(frame.covariance)
    return Gaussian(
        np.broadcast_to(mean, (*batch, 3)).reshape(-1, 3),
        np.broadcast_to(root, (*batch, 3, 3)).reshape(-1, 3, 3),
    )
