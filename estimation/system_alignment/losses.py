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
_TRUSTED, _GONE = 3.0, 4.5  # sigmas to which a residual counts in full; from which not at all


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


def tapered(residual: Array) -> tuple[Array, Array]:
    """Squares up to 3 sigma, nothing gained or lost beyond 4.5, a straight way between (Hampel)."""
    size = np.abs(residual)
    left = np.clip((_GONE - size) / (_GONE - _TRUSTED), 0.0, 1.0)
    beyond = _TRUSTED * (_GONE - (_GONE - _TRUSTED) * left**2)
    weight = np.where(size <= _TRUSTED, 1.0, _TRUSTED / np.maximum(size, _TRUSTED) * left)
    return np.where(size <= _TRUSTED, size**2, beyond), weight


ROBUST: tuple[Loss, ...] = (huber, cauchy, tapered)
PLAIN: tuple[Loss, ...] = (squares,)
