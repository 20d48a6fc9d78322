"""Stacks of small matrices: what numpy says at length, typed."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array

Indices: TypeAlias = NDArray[np.signedinteger[Any]]


def inverse(matrices: Array) -> Array:
    """Each matrix (..., n, n) inverted."""
    return np.asarray(np.linalg.inv(matrices), dtype=float)


def solved(matrices: Array, columns: Array) -> Array:
    """Each system (..., n, n) solved for its columns (..., n, k)."""
    return np.asarray(np.linalg.solve(matrices, columns), dtype=float)


def times(matrices: Array, vectors: Array) -> Array:
    """Each matrix (..., m, n) times its vector (..., n)."""
    product: Array = (matrices @ vectors[..., None])[..., 0]
    return product
