"""Where targets may be that no track stands for yet: the Poisson half of the picture.

A grid over the picture holds the expected number of undetected targets by area. What a sensor
sees for the first time gets the density that its plots, less the clutter, show; each look thins
the density by the probability of a miss; targets appear and vanish at the rate that keeps their
number.

Source: Williams, Marginal multi-Bernoulli filters: RFS derivation of MHT, JIPDA, and
association-based MeMBer, IEEE Trans. AES 51(3), 2015, section III.
"""

from __future__ import annotations

import math
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
        density: (cells, cells) [1/m^2], by east and north.
        seen: (cells, cells) whether any sensor ever looked there.
    """

    region: Region
    density: Array
    seen: NDArray[np.bool_]


class Look(NamedTuple):
    """One scan, as the grid sees it.

    Attributes:
        visible: (cells, cells) cells in view.
        detection: probability that a target in view gives a plot.
        plots_m: (2, m) where the plots are.
        clutter: expected false plots [1/m^2].
    """

    visible: NDArray[np.bool_]
    detection: float
    plots_m: Array
    clutter: float


def unseen(region: Region) -> Undetected:
    """The grid before any scan."""
    shape = (region.cells, region.cells)
    return Undetected(region, np.zeros(shape), np.zeros(shape, dtype=bool))


def centres(region: Region) -> Array:
    """East and north of the cells (2, cells, cells)."""
    along = (np.arange(region.cells) + 0.5) * (2 * region.half_m / region.cells) - region.half_m
    grid = np.stack(np.meshgrid(along, along, indexing="ij"))
    placed: Array = grid + np.asarray(region.centre_m)[:, None, None]
    return placed


def cell_area(region: Region) -> float:
    """m^2."""
    return (2 * region.half_m / region.cells) ** 2


def first_looked(now: Undetected, look: Look) -> Undetected:
    """Cells in view for the first time get one common density, from the plots found in them.

    At least one target is expected among them, or else none could ever begin.
    """
    new = look.visible & ~now.seen
    if not new.any():
        return now
    area = float(new.sum()) * cell_area(now.region)
    plots = float(_at(new, now.region, look.plots_m).sum())
    number = max((plots - look.clutter * area) / max(look.detection, 1e-3), 1.0)
    return now._replace(density=np.where(new, number / area, now.density), seen=now.seen | new)


def aged(now: Undetected, dt_s: float, lifetime_s: float, targets: float) -> Undetected:
    """The grid `dt_s` later, when `targets` in all live `lifetime_s` each and are replaced."""
    area = max(float(now.seen.sum()), 1.0) * cell_area(now.region)
    gone = -math.expm1(-dt_s / lifetime_s)
    density = now.density * (1.0 - gone) + now.seen * (max(targets, 1.0) * gone / area)
    return now._replace(density=density)


def thinned(now: Undetected, look: Look) -> Undetected:
    """What a look leaves undetected."""
    return now._replace(density=now.density * np.where(look.visible, 1.0 - look.detection, 1.0))


def vague(region: Region, covariance_m2: Array) -> NDArray[np.bool_]:
    """Which places (n,) of covariances (2, 2, n) are no better known than a cell of the grid."""
    middle = (covariance_m2[0, 0] + covariance_m2[1, 1]) / 2
    half = (covariance_m2[0, 0] - covariance_m2[1, 1]) / 2
    longest = middle + np.hypot(half, covariance_m2[0, 1])
    return np.asarray(longest > cell_area(region) / 12, dtype=np.bool_)


def returned(now: Undetected, place_m: Array, existence: Array) -> Undetected:
    """The grid with targets at places (2, n) that no track stands for any more.

    Source: Williams, Hybrid Poisson and multi-Bernoulli filters, FUSION 2012 (recycling).
    """
    if not existence.size:
        return now
    east, north, inside = _cells(now.region, place_m)
    density = now.density.copy()
    np.add.at(density, (east, north), inside * existence / cell_area(now.region))
    return now._replace(density=density)


def density_at(now: Undetected, place_m: Array) -> Array:
    """Density [1/m^2] at places (2, m); none outside the region."""
    return _at(now.density, now.region, place_m)


def expected(now: Undetected) -> float:
    """Number of undetected targets where a sensor ever looked."""
    return float(now.density.sum()) * cell_area(now.region)


def _at(values: NDArray[np.bool_] | Array, region: Region, place_m: Array) -> Array:
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
