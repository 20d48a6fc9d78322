"""Many small symmetric systems at once: matrices (M, M, B), the batch in the last axis.

LAPACK is called a matrix at a time; here each operation runs over the whole batch, which for
systems of five to ten unknowns is an order of magnitude faster.
"""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array

_FLOOR = 1e-15  # of the diagonal: below it a pivot is rounding


def cholesky(matrix: Array) -> Array:
    """Lower factors (M, M, B) of positive semi-definite matrices; what is above is left over.

    A vanishing pivot is lifted to rounding level: the direction comes out as good as unknown.
    """
    factor = matrix.copy()
    floor = _FLOOR * np.einsum("iib->ib", matrix) + 1e-290
    for k in range(len(factor)):
        pivot = np.sqrt(np.maximum(factor[k, k], floor[k]))
        factor[k, k] = pivot
        below = factor[k + 1 :, k]
        below /= pivot
        factor[k + 1 :, k + 1 :] -= below[:, None] * below[None, :]
    return factor


def solved(factor: Array, right: Array) -> Array:
    """Solutions x of L L' x = right, both (M, B)."""
    x = right.copy()
    for k in range(len(x)):
        x[k] /= factor[k, k]
        x[k + 1 :] -= factor[k + 1 :, k] * x[k]
    for k in range(len(x) - 1, -1, -1):
        x[k] /= factor[k, k]
        x[:k] -= factor[k, :k] * x[k]
    return x


def log_determinant(factor: Array) -> Array:
    """(B,) of the matrices that were factored."""
    total: Array = 2 * np.log(np.einsum("iib->ib", factor)).sum(axis=0)
    return total


def inverted(matrix: Array) -> Array:
    """Inverses (M, M, B) of positive semi-definite matrices, unknown directions very large."""
    scale = np.sqrt(np.einsum("iib->ib", matrix)) + 1e-150
    factor = cholesky(matrix / (scale[:, None] * scale[None, :]))
    units = np.eye(len(matrix))[..., None] * np.ones_like(scale[0])
    inverse: Array = solved(factor[:, :, None], units) / (scale[:, None] * scale[None, :])
    return inverse
