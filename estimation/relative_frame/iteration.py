"""The iteration of an adjustment: Gauss-Helmert steps from a start until nothing moves.

Flat: N experiments at once; those that have arrived leave the batch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.relative_frame.gauge import Prior
from estimation.relative_frame.gauss_helmert import Measured, back_substituted, linearise
from estimation.relative_frame.matrices import Indices, inverse, solved

_GAUSS, _NEWTON = 6, 30  # most arrive in three to six steps; Newton's are for the stragglers
_CONVEX, _CAUTION = 0.05, 3.0  # in units of the prior's information
_STILL = 2e-6  # posterior sigmas: the step after which an experiment has arrived


class Solution(NamedTuple):
    """Where N iterations ended, each at its own point.

    Attributes:
        z: (N, M) in units of the prior.
        tangent: (N, K, M) of the parameters by z.
        covariance: (N, M, M) of z.
        information: (N, K, K) sum of H' S^-1 H of the pairs, at the end.
        vector: (N, K) minus the sum of H' S^-1 w, at the end.
        pair_chi2: (N, L) of each pair.
        converged: (N,) the last step was below 2e-6 sigma.
    """

    z: Array
    tangent: Array
    covariance: Array
    information: Array
    vector: Array
    pair_chi2: Array
    converged: NDArray[np.bool_]

    @property
    def criterion(self) -> Array:
        """(N,) what was minimised: the pairs' chi2 and the prior's."""
        total: Array = self.pair_chi2.sum(axis=1) + np.square(self.z).sum(axis=1)
        return total


def iterate(given: Measured, prior: Prior, start: Array) -> Solution:
    """Gauss-Helmert steps from whitened coordinates `start` (N, M)."""
    v = np.zeros((2, *given.bearing_rad.shape))
    z, found, waiting = start, None, np.arange(len(start))
    for count in range(1, _GAUSS + _NEWTON + 1):
        now, v, step_squared = _step(given, prior, z, v, newton=count > _GAUSS)
        still = step_squared < _STILL**2
        if still.all() and found is None:
            return now._replace(converged=still)
        found = _stored(found, now._replace(converged=still), waiting, len(start))
        if still.all() or count == _GAUSS + _NEWTON:
            break
        if still.any():
            on = np.flatnonzero(~still)
            given, prior, v = given.of(on), prior.of(on), v[:, :, on]
            waiting, z = waiting[on], now.z[on]
        else:
            z = now.z
    assert found is not None  # noqa: S101  (at least one step was made)
    return found


def _step(
    given: Measured, prior: Prior, z: Array, v: Array, *, newton: bool
) -> tuple[Solution, Array, Array]:
    """One step: where it leads, the measurements' corrections there, and its length^2 (N,)."""
    point, tangent = prior.at(z)
    at = linearise(given, v, point)
    gram = at.gram(given.weights)
    information, vector = gram[:, :-1, :-1], -gram[:, :-1, -1:]
    normal = np.eye(z.shape[1]) + transposed(tangent) @ information @ tangent
    covariance = inverse(normal)
    downhill = transposed(tangent) @ vector - z[..., None]
    step = _newton_step(normal, prior.bend(z), downhill) if newton else covariance @ downhill
    moved = tangent @ step
    v, pair_chi2 = back_substituted(given, at, moved[..., 0])
    step_squared = np.sum(step * (normal @ step), axis=(1, 2))
    now = Solution(
        z=prior.moved(z, step[..., 0], point + moved[..., 0]),
        tangent=tangent,
        covariance=covariance,
        information=information,
        vector=(vector - information @ moved)[..., 0],
        pair_chi2=pair_chi2,
        converged=np.zeros(len(z), dtype=bool),
    )
    return now, v, step_squared


def _newton_step(normal: Array, bend: Array, downhill: Array) -> Array:
    """The step with the prior's own curvature, where that leaves a minimum; shortened elsewhere.

    A short baseline that navigation puts at half or twice its length bends the prior of the norths
    so much that Gauss-Newton creeps or swings to and fro.
    """
    exact = normal + bend
    convex = np.linalg.eigvalsh(exact)[:, 0] > _CONVEX
    cautious = normal + _CAUTION * np.eye(normal.shape[-1])
    return solved(np.where(convex[:, None, None], exact, cautious), downhill)


def _stored(found: Solution | None, now: Solution, where: Indices, count: int) -> Solution:
    """`now` written into the places of the experiments still under way."""
    if found is None:
        found = Solution(*(np.empty((count, *array.shape[1:]), array.dtype) for array in now))
    for whole, part in zip(found, now, strict=True):
        whole[where] = part
    return found
