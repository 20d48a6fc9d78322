"""The array types of `estimation` under one short name, and what numpy says at length."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Array", "ArrayLike", "Indices", "beginnings", "broadcast", "transposed"]

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.intp]


def broadcast(*values: ArrayLike) -> tuple[Array, ...]:
    """The values as float arrays of one common shape."""
    arrays = [np.asarray(value, dtype=float) for value in values]
    shape = np.broadcast(*arrays).shape
    return tuple(a if a.shape == shape else np.broadcast_to(a, shape) for a in arrays)


def beginnings(labels: Indices) -> Indices:
    """Where each run of equal labels begins."""
    begins = np.ones(len(labels), dtype=np.bool_)
    np.not_equal(labels[1:], labels[:-1], out=begins[1:])
    return np.flatnonzero(begins)


def transposed(matrices: Array) -> Array:
    """Each matrix of a stack (..., m, n) transposed: (..., n, m)."""
    return np.swapaxes(matrices, -1, -2)
