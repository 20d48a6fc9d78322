"""The array types of `estimation` under one short name, and two things numpy says at length."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Array", "ArrayLike", "Indices", "broadcast", "transposed"]

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.intp]


def broadcast(*values: ArrayLike) -> tuple[Array, ...]:
    """The values as float arrays of one common shape."""
    return np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in values))


def transposed(matrices: Array) -> Array:
    """Each matrix of a stack (..., m, n) transposed: (..., n, m)."""
    return np.swapaxes(matrices, -1, -2)
