"""How much of each cell of the grid a sensor sees: cells may be far wider than its view."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.tracking.scan import View
from estimation.tracking.undetected import Region, cell_side, centres

_SAMPLES = 5
"""Points along a side of a cell that the edge of a view crosses."""
_LEAST = 0.5 / _SAMPLES**2
"""Share of a cell that a view touches between the points."""


def share_in_view(view: View, region: Region) -> Array:
    """Shares (cells, cells) of the area of each cell from which plots may come.

    Zero only where no point of the cell is in view, or else no target there could ever begin.
    """
    cells, side = centres(region), cell_side(region)
    off = np.abs(cells - np.asarray(view.site_m)[:, None, None])
    nearest = np.hypot(*np.maximum(off - side / 2, 0.0))
    farthest = np.hypot(*(off + side / 2))
    touched = (nearest <= view.range_max_m) & (farthest >= view.range_min_m)
    whole = (farthest <= view.range_max_m) & (nearest >= view.range_min_m)
    if view.width_rad < 2 * math.pi:
        inside, near = _in_sector(view, cells, np.hypot(*off), side)
        touched, whole = touched & near, whole & inside
    share: Array = whole.astype(float)
    row, column = np.nonzero(touched & ~whole)
    step = side * ((np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5)
    samples = np.stack(np.meshgrid(step, step, indexing="ij")).reshape(2, 1, -1)
    held = view.holds(cells[:, row, column, None] + samples)
    share[row, column] = np.maximum(held.mean(axis=1), _LEAST)
    return share


def _in_sector(
    view: View, cells: Array, far_m: Array, side_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which cells lie in the sector as a whole, and which perhaps in part."""
    east, north = cells - np.asarray(view.site_m)[:, None, None]
    half = np.arcsin(np.minimum(1.0, side_m * math.sqrt(0.5) / np.maximum(far_m, 1e-9)))
    half = np.where(half < math.pi / 2, half, math.pi)
    turned = np.arctan2(east, north) - view.start_rad - view.width_rad / 2
    aside = np.abs((turned + math.pi) % (2 * math.pi) - math.pi)
    return aside + half <= view.width_rad / 2, aside - half <= view.width_rad / 2
