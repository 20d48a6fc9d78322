"""Losses of a whitened residual: what it costs, and the weight its square then has.

A beacon heard by a detour reads late, never early, by many sigmas: squares would believe it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from estimation.arrays import Array

Loss: TypeAlias = Callable[[Array], tuple[Array, Array]]

_HUBER = 2.5  # sigmas; errors without tails stay below it
_CAUCHY = 3.0
_BEYOND = 3.5  # sigmas past which a residual is no measurement of its beacon


def squares(residual: Array) -> tuple[Array, Array]:
    """Least squares: r^2, weight 1."""
    return residual**2, np.ones_like(residual)


def huber(residual: Array) -> tuple[Array, Array]:
    """Convex: squares up to 2.5 sigma, straight beyond. Finds the neighbourhood from afar."""
    size = np.abs(residual)
    weight = np.minimum(1.0, _HUBER / np.maximum(size, 1e-12))
    return np.where(size <= _HUBER, size**2, _HUBER * (2 * size - _HUBER)), weight


def cauchy(residual: Array) -> tuple[Array, Array]:
    """Redescending: a residual of many sigmas hardly pulls any more."""
    scaled = (residual / _CAUCHY) ** 2
    return _CAUCHY**2 * np.log1p(scaled), 1 / (1 + scaled)


def truncated(residual: Array) -> tuple[Array, Array]:
    """Squares up to 3.5 sigma, nothing gained or lost beyond."""
    inside = np.abs(residual) <= _BEYOND
    return np.where(inside, residual**2, _BEYOND**2), inside.astype(float)


ROBUST: tuple[Loss, ...] = (huber, cauchy, truncated)
PLAIN: tuple[Loss, ...] = (squares,)
