"""Least squares over a chain of epochs and a few constants: block-tridiagonal with a border.

Unknown are a block x_k of b numbers at each of n epochs and T constants theta. A row joins two
neighbouring epochs, or belongs to one; either may touch theta. The normal matrix of x is then
block-tridiagonal and the constants are its dense border, so that one step costs O(n): a banded
Cholesky factor and a Schur complement, which is the information of theta with all x eliminated.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array

from estimation.arrays import Array, Indices, transposed

_STILL = 1e-6  # chi2: the gain that the last step promised, or made
_NEARLY = 1e-2  # chi2 promised where weights change with the step and it made none
_LEAST, _FIRST, _HOPELESS = 1e-2, 1.0, 1e8  # damping: what tells, what is tried first, given up
_HARDER, _SOFTER = 5.0, 0.2
_KEPT = 0.75  # of the gain promised: from a step that makes as much, the next is damped less


class Chain(NamedTuple):
    """Whitened rows that lead from epoch k - 1 to k; those of epoch 0 lead from a known start.

    Attributes:
        residual: (n, r).
        by_previous: (n, r, b) derivatives by x_{k-1}; the first is not used.
        by_epoch: (n, r, b) by x_k.
        by_theta: (n, r, T).
    """

    residual: Array
    by_previous: Array
    by_epoch: Array
    by_theta: Array


class Observed(NamedTuple):
    """Whitened rows of one epoch each, in any order.

    Attributes:
        epoch: (m,) which.
        residual: (m,).
        by_epoch: (m, b).
        by_theta: (m, T).
    """

    epoch: Indices
    residual: Array
    by_epoch: Array
    by_theta: Array


class Linearised(NamedTuple):
    """A problem about one point, and the cost there.

    Attributes:
        chain: rows between epochs.
        observed: rows of epochs.
        known_residual: (q,) whitened rows of theta alone: a prior.
        known_by_theta: (q, T).
        cost: what is minimised; the sum of squares when no row is weighted down.
    """

    chain: Chain
    observed: Observed
    known_residual: Array
    known_by_theta: Array
    cost: float


class Normal(NamedTuple):
    """Normal equations of one step.

    Attributes:
        band: (2 b, n b) lower band of the matrix of x.
        border: (n b, T).
        corner: (T, T).
        pull_x: (n b,) minus half the gradient.
        pull_theta: (T,).
    """

    band: Array
    border: Array
    corner: Array
    pull_x: Array
    pull_theta: Array


class Factored(NamedTuple):
    """Normal equations taken apart.

    Attributes:
        root: (2 b, n b) banded Cholesky factor of the matrix of x.
        shadow: (n b, T) that matrix's inverse times the border.
        information: (T, T) of theta, all x eliminated.
    """

    root: Array
    shadow: Array
    information: Array


class Solution(NamedTuple):
    """Where the iteration ended.

    Attributes:
        x: (n, b).
        theta: (T,).
        factored: of the last normal equations, which give every covariance.
        cost: there.
        converged: the last step promised no gain.
        steps: how many were tried.
    """

    x: Array
    theta: Array
    factored: Factored
    cost: float
    converged: bool
    steps: int

    @property
    def covariance(self) -> Array:
        """(T, T) of theta."""
        return inverse(self.factored.information)


class Descent(NamedTuple):
    """Where steps led.

    Attributes:
        x: (n, b).
        theta: (T,).
        at: the problem about them.
        normal: its normal equations, of the last step but one where it promised no gain.
        converged: that it did.
        steps: how many were tried.
    """

    x: Array
    theta: Array
    at: Linearised
    normal: Normal | None
    converged: bool
    steps: int


Linearise = Callable[[Array, Array], Linearised]


def minimise(linearise: Linearise, x: Array, theta: Array, most: int = 50) -> Solution:
    """Gauss-Newton steps, damped where one would not pay (Levenberg-Marquardt).

    Damping of 1 is as much as the rows of theta alone know: what the data determine a thousand
    times better goes on freely, and what they leave loose along a bend takes short steps.

    Args:
        linearise: the problem about a point (x, theta).
        x: (n, b) start.
        theta: (T,) start.
        most: steps to try at the most.
    """
    end = descend(linearise, x, theta, most)
    normal = end.normal or normal_equations(end.at)
    return Solution(end.x, end.theta, factor(normal), end.at.cost, end.converged, end.steps)


def descend(linearise: Linearise, x: Array, theta: Array, most: int) -> Descent:
    """The steps of `minimise`, nothing factored at the end."""
    at, normal, damping = linearise(x, theta), None, 0.0
    for count in range(1, most + 1):
        normal = normal or normal_equations(at)
        step_x, step_theta, gain = _step(at, normal, x.shape, damping)
        there = linearise(x + step_x, theta + step_theta)
        settled = abs(at.cost - there.cost) < _STILL and gain < _NEARLY
        if damping == 0 and (gain < _STILL or settled):
            return Descent(x + step_x, theta + step_theta, there, normal, True, count)
        if there.cost <= at.cost:
            if at.cost - there.cost > _KEPT * gain:
                damping = damping * _SOFTER if damping > _LEAST else 0.0
            x, theta, at, normal = x + step_x, theta + step_theta, there, None
        elif damping > _HOPELESS:
            break
        else:
            damping = max(damping * _HARDER, _FIRST)
    return Descent(x, theta, at, normal, False, count)


def normal_equations(at: Linearised) -> Normal:
    """Sum all rows."""
    chain, seen = at.chain, at.observed
    n, _, b = chain.by_epoch.shape
    count = chain.by_theta.shape[2]
    now = np.concatenate([chain.by_epoch, chain.by_theta, chain.residual[..., None]], axis=2)
    before = transposed(chain.by_previous[1:])
    summed = transposed(chain.by_epoch) @ now
    ahead = before @ now[1:]
    summed[:-1, :, :b] += before @ chain.by_previous[1:]
    summed[:-1, :, b:] += ahead[:, :, b:]
    rows = np.concatenate([seen.by_epoch, seen.by_theta, seen.residual[:, None]], axis=1)
    outer = seen.by_epoch[:, :, None] * rows[:, None, :]
    summed += _by_epoch(seen.epoch, n, outer.reshape(len(rows), b * rows.shape[1])).reshape(
        summed.shape
    )
    constants = np.concatenate([chain.by_theta.reshape(-1, count), seen.by_theta])
    constants = np.concatenate([constants, at.known_by_theta])
    residuals = [chain.residual.ravel(), seen.residual, at.known_residual]
    return Normal(
        band=_band(summed[:, :, :b], ahead[:, :, :b]),
        border=summed[:, :, b:-1].reshape(n * b, count),
        corner=constants.T @ constants,
        pull_x=-summed[:, :, -1].ravel(),
        pull_theta=-constants.T @ np.concatenate(residuals),
    )


def factor(normal: Normal) -> Factored:
    """Cholesky of the chain, Schur complement of the border."""
    root = cholesky_banded(normal.band, lower=True, check_finite=False)
    shadow = cho_solve_banded((root, True), normal.border, check_finite=False)
    return Factored(root, shadow, normal.corner - normal.border.T @ shadow)


def inverse(matrix: Array) -> Array:
    """Of a positive definite (K, K) whose rows differ much in scale."""
    scale = 1 / np.sqrt(np.diag(matrix))
    inverted: Array = np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
    return (inverted + inverted.T) / 2


def last_covariance(found: Solution, theta: Array | None = None) -> Array:
    """(b + T, b + T) covariance of the last epoch's block, then theta, together.

    Args:
        theta: (T, T) covariance to take for that of theta, default the solution's own.
    """
    b, factored = found.x.shape[1], found.factored
    ends = np.zeros((found.x.size, b))
    ends[-b:] = np.eye(b)
    alone = cho_solve_banded((factored.root, True), ends, check_finite=False)[-b:]
    theta = found.covariance if theta is None else theta
    tied = -factored.shadow[-b:] @ theta
    return np.block([[alone - tied @ factored.shadow[-b:].T, tied], [tied.T, theta]])


def block_covariances(found: Solution, theta: Array | None = None) -> Array:
    """(n, b, b) covariance of every x_k, by the backward recursion of selected inversion.

    Args:
        theta: (T, T) covariance to take for that of theta, default the solution's own.
    """
    n, b = found.x.shape
    diagonal, below = _root_blocks(found.factored.root, n, b)
    inverted = np.linalg.inv(diagonal).astype(float)
    alone = np.empty((n, b, b))
    alone[-1] = inverted[-1].T @ inverted[-1]
    gains = below @ inverted[:-1]  # L_{k+1,k} L_kk^-1
    own = transposed(inverted) @ inverted
    for k in range(n - 2, -1, -1):
        alone[k] = own[k] + gains[k].T @ alone[k + 1] @ gains[k]
    shadow = found.factored.shadow.reshape(n, b, -1)
    known = found.covariance if theta is None else theta
    spread: Array = shadow @ known @ transposed(shadow)
    return alone + spread


def _root_blocks(root: Array, n: int, b: int) -> tuple[Array, Array]:
    """The factor's diagonal blocks (n, b, b), and those below them (n - 1, b, b)."""
    diagonal, below = np.zeros((n, b, b)), np.zeros((n - 1, b, b))
    for i in range(b):
        for j in range(b):
            if i >= j:
                diagonal[:, i, j] = root[i - j, j::b]
            below[:, i, j] = root[b + i - j, j::b][:-1]
    return diagonal, below


def _step(
    at: Linearised, normal: Normal, shape: tuple[int, ...], damping: float
) -> tuple[Array, Array, float]:
    """A step of x and theta, and the decrease of the cost it promises."""
    if damping:
        known, share = at.known_by_theta, damping / _HOPELESS
        band, corner = normal.band.copy(), normal.corner + damping * known.T @ known
        band[0] *= 1 + share
        corner[np.diag_indices_from(corner)] *= 1 + share
        normal = normal._replace(band=band, corner=corner)
    root = cholesky_banded(normal.band, lower=True, check_finite=False)
    right = np.column_stack([normal.border, normal.pull_x])
    solved = cho_solve_banded((root, True), right, check_finite=False)
    shadow, alone = solved[:, :-1], solved[:, -1]
    information = normal.corner - normal.border.T @ shadow
    theta = inverse(information) @ (normal.pull_theta - normal.border.T @ alone)
    x = alone - shadow @ theta
    return x.reshape(shape), theta, float(x @ normal.pull_x + theta @ normal.pull_theta)


def _by_epoch(epoch: Indices, n: int, values: Array) -> Array:
    """Sums (n, c) of the values (m, c) of each epoch."""
    starts = np.arange(len(epoch) + 1)
    picks = csr_array((np.ones(len(epoch)), epoch, starts), shape=(len(epoch), n))
    return np.asarray(picks.T @ values, dtype=float)


def _band(diagonal: Array, coupling: Array) -> Array:
    """Lower band (2 b, n b) of blocks (n, b, b) and of those right of them (n - 1, b, b)."""
    n, b, _ = diagonal.shape
    band = np.zeros((2 * b, n * b))
    for i in range(b):
        for j in range(b):
            if i >= j:
                band[i - j, j::b] = diagonal[:, i, j]
            band[b + i - j, j::b][:-1] = coupling[:, j, i]
    return band
