"""Other modes in words: which beacon lies elsewhere, and on which side."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.system_alignment.parameters import WIND, Prior, places_of

_MOVED = 0.3  # prior sigmas from which a constant is named
_QUARTERS = ("north", "east", "south", "west")


def track_of(way: Array) -> tuple[Array, Array]:
    """Middle (2,) and direction (2,), as it is gone, of the straight line nearest to (n, 2)."""
    middle = way.mean(axis=0)
    along = np.linalg.svd(way - middle, full_matrices=False)[2][0]
    onward = float(along @ (way[-1] - way[0])) >= 0
    return middle, along if onward else -along


def difference(prior: Prior, way: Array, height_m: float, best: Array, other: Array) -> str:
    """How other constants differ from the best.

    Args:
        prior: of the constants; what differs by less than .3 of its sigma is not named.
        way: (n, 2) places of the object.
        height_m: of the object.
        best: (7 + 4 J,).
        other: (7 + 4 J,).
    """
    sigma = np.sqrt(np.diag(prior.covariance))
    moved = np.abs(other - best) > _MOVED * np.maximum(sigma, 1e-12)
    return ", ".join(_parts(moved, way, height_m, best, other)) or "the same within the prior"


def _parts(
    moved: NDArray[np.bool_], way: Array, height_m: float, best: Array, other: Array
) -> Iterator[str]:
    middle, along = track_of(way)
    for number, index in enumerate(places_of(best), start=1):
        if not moved[index].any():
            continue
        here, there = best[index], other[index]
        before, after = (_left(place[:2] - middle, along) for place in (here, there))
        if moved[index[:2]].any() and before * after < 0:
            side, instead = ("left", "right") if after > 0 else ("right", "left")
            yield f"beacon {number} on the {side} of the track instead of the {instead}"
        elif moved[index[2]] and (here[2] - height_m) * (there[2] - height_m) < 0:
            side, instead = ("above", "below") if there[2] > height_m else ("below", "above")
            yield f"beacon {number} {side} the path instead of {instead}"
        else:
            yield f"beacon {number} {_way(there - here)}"
    if moved[WIND].any():
        east, north = other[WIND]
        yield f"wind {east:.1f} m/s east, {north:.1f} m/s north"


def _left(apart: Array, along: Array) -> float:
    """How far to the left."""
    return float(along[0] * apart[1] - along[1] * apart[0])


def _way(apart: Array) -> str:
    """A displacement (3,) in words."""
    level = float(np.hypot(*apart[:2]))
    if level < abs(apart[2]):
        return f"{abs(apart[2]):.0f} m {'higher' if apart[2] > 0 else 'lower'}"
    quarter = round(float(np.arctan2(apart[0], apart[1])) / (np.pi / 2)) % 4
    return f"{level:.0f} m further {_QUARTERS[quarter]}"
