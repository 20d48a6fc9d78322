"""Where targets may be that no track stands for yet: the Poisson half of the picture.

A grid over the picture holds the expected number of undetected targets by area, of that share of
each cell that was ever in view: cells may be wider than what a sensor sees. What comes into view
for the first time gets the density that the plots in it, less the clutter, show; each look thins
the density by the probability of a miss; targets appear and vanish at the rate that keeps their
number.

Source: Williams, Marginal multi-Bernoulli filters: RFS derivation of MHT, JIPDA, and
association-based MeMBer, IEEE Trans. AES 51(3), 2015, section III.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices


class Region(NamedTuple):
    """The square the picture covers; no tracks begin outside.

    Attributes:
        centre_m: east, north; half_m: from the centre to an edge; cells: along an edge.
    """

    centre_m: tuple[float, float] = (0.0, 0.0)
    half_m: float = 200_000.0
    cells: int = 40


class Undetected(NamedTuple):
    """Expected undetected targets.

    Attributes:
        region: the square.
        density: (cells, cells) [1/m^2], by east and north, of what was ever in view.
        seen: (cells, cells) share of the cell that was, by the sensor that saw most of it.
    """

    region: Region
    density: Array
    seen: Array


class Look(NamedTuple):
    """One scan, as the grid sees it.

    Attributes:
        visible: (cells, cells) share of each cell in view.
        detection: probability that a target in view gives a plot.
        plots_m: (2, m) where the plots are.
        clutter: expected false plots [1/m^2].
    """

    visible: Array
    detection: float
    plots_m: Array
    clutter: float


def unseen(region: Region) -> Undetected:
    """The grid before any scan."""
    shape = (region.cells, region.cells)
    return Undetected(region, np.zeros(shape), np.zeros(shape))


@lru_cache(maxsize=8)
def centres(region: Region) -> Array:
    """East and north of the cells (2, cells, cells); not to be written to."""
    along = (np.arange(region.cells) + 0.5) * cell_side(region) - region.half_m
    grid = np.stack(np.meshgrid(along, along, indexing="ij"))
    placed: Array = grid + np.asarray(region.centre_m)[:, None, None]
    placed.flags.writeable = False
    return placed


def cell_side(region: Region) -> float:
    """Of a cell, along an edge [m]."""
    return 2 * region.half_m / region.cells


def cell_area(region: Region) -> float:
    """m^2."""
    return cell_side(region) ** 2


def first_looked(now: Undetected, look: Look) -> Undetected:
    """What is in view for the first time gets one common density, from the plots found in it.

    At least one target is expected in all that is in view, or else none could ever begin.
    """
    new = np.maximum(look.visible - now.seen, 0.0)
    if not new.any():
        return now
    area = float(new.sum()) * cell_area(now.region)
    in_view = float(look.visible.sum()) * cell_area(now.region)
    share = new / np.maximum(look.visible, 1e-300)
    plots = float(_at(share, now.region, look.plots_m).sum())
    fresh = (plots / area - look.clutter) / max(look.detection, 1e-3)
    both = now.density * now.seen + max(fresh, 1.0 / in_view) * new
    density = now.density.copy()
    np.divide(both, now.seen + new, out=density, where=new > 0)
    return now._replace(density=density, seen=now.seen + new)


def aged(now: Undetected, dt_s: float, lifetime_s: float, targets: float) -> Undetected:
    """The grid `dt_s` later, when `targets` in all live `lifetime_s` each and are replaced."""
    area = max(float(now.seen.sum()) * cell_area(now.region), 1.0)
    gone = -math.expm1(-dt_s / lifetime_s)
    come = np.where(now.seen > 0, max(targets, 1.0) * gone / area, 0.0)
    return now._replace(density=now.density * (1.0 - gone) + come)


def thinned(now: Undetected, look: Look) -> Undetected:
    """What a look leaves undetected."""
    looked = look.visible / np.maximum(now.seen, 1e-300)
    return now._replace(density=now.density * (1.0 - look.detection * np.minimum(looked, 1.0)))


def vague(region: Region, covariance_m2: Array) -> NDArray[np.bool_]:
    """Which places (n,) of covariances (2, 2, n) are no better known than a cell of the grid."""
    middle = (covariance_m2[0, 0] + covariance_m2[1, 1]) / 2
    half = (covariance_m2[0, 0] - covariance_m2[1, 1]) / 2
    longest = middle + np.hypot(half, covariance_m2[0, 1])
    return np.asarray(longest > cell_area(region) / 12, dtype=np.bool_)


def returned(now: Undetected, place_m: Array, existence: Array) -> Undetected:
    """The grid with targets at places (2, n) that no track stands for any more.

    Where no sensor ever looked nobody is counted.

    Source: Williams, Hybrid Poisson and multi-Bernoulli filters, FUSION 2012 (recycling).
    """
    if not existence.size:
        return now
    east, north, inside = _cells(now.region, place_m)
    share = now.seen[east, north]
    counted = existence * (inside & (share > 0))
    density = now.density.copy()
    np.add.at(density, (east, north), counted / np.maximum(share * cell_area(now.region), 1.0))
    return now._replace(density=density)


def density_at(now: Undetected, place_m: Array) -> Array:
    """Density [1/m^2] at places (2, m); none outside the region."""
    return _at(now.density, now.region, place_m)


def expected(now: Undetected) -> float:
    """Number of undetected targets where a sensor ever looked."""
    return float((now.density * now.seen).sum()) * cell_area(now.region)


def _at(values: Array, region: Region, place_m: Array) -> Array:
    """Values of the cells of places (2, m), 0 outside."""
    east, north, inside = _cells(region, place_m)
    return np.where(inside, values[east, north], 0.0)


def _cells(region: Region, place_m: Array) -> tuple[Indices, Indices, NDArray[np.bool_]]:
    """Rows and columns of the cells of places (2, m), any cell outside, and which are inside."""
    from_corner = place_m - np.asarray(region.centre_m)[:, None] + region.half_m
    cell = np.floor(from_corner * (region.cells / (2 * region.half_m)))
    inside = ((cell >= 0) & (cell < region.cells)).all(axis=0)
    east, north = np.where(inside, cell, 0.0).astype(np.intp)
    return east, north, inside
