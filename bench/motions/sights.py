"""Radars at their places and what they see of a world: plots, false ones among them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bench.motions.worlds import STEP_S, World
from estimation.arrays import Array, Indices
from estimation.tracking.features import Layout, Said
from estimation.tracking.measurements import polar
from estimation.tracking.scan import Scan, View

DETECTION, FALSE = 0.9, 2.0
LENGTH, LENGTHS_M, SIGMA_LENGTH_M = Layout(1, ()), (20.0, 300.0), 30.0
_GOLDEN = (np.sqrt(5) - 1) / 2
SIGMA_RANGE_M, SIGMA_BEARING_RAD = 30.0, float(np.radians(0.3))


class Radars(NamedTuple):
    """Alike radars in turn.

    Attributes:
        sites: (radars, 2) in halves of the world's square.
        period_s: of each.
        sigmas: one sigma of range [m] and of bearing [rad].
        lengths: whether plots tell a length, which differs from target to target.
    """

    name: str
    sites: tuple[tuple[float, float], ...]
    period_s: float
    sigmas: tuple[float, float] = (SIGMA_RANGE_M, SIGMA_BEARING_RAD)
    lengths: bool = False


EVERY = (
    Radars("three radars, 1 s", ((-1.0, -0.8), (1.1, -0.6), (0.1, 1.1)), 1.0),
    Radars("one radar, 2 s", ((-1.0, -0.8),), 2.0),
    Radars("two radars, 4 s", ((-1.0, -0.8), (1.1, -0.6)), 4.0),
)


class Sight(NamedTuple):
    """A scan, its row of instants, the target of each plot (-1: false), the last of its round."""

    scan: Scan
    row: int
    owner: Indices
    ends_round: bool


def sights(rng: np.random.Generator, world: World, radars: Radars) -> list[Sight]:
    """All scans in the order of their instants."""
    period = round(radars.period_s / STEP_S)
    phase = [k * period // len(radars.sites) for k in range(len(radars.sites))]
    half_m = extent_m(world)
    every = []
    for row in range(len(world.place_m)):
        if row % period in phase:
            k = phase.index(row % period)
            site = np.array(radars.sites[k]) * world.half_m
            scan, owner = _scan(rng, world, row, site, radars, half_m)
            every.append(Sight(scan, row, owner, k == len(phase) - 1))
    return every


def extent_m(world: World) -> float:
    """Half of the square in which false plots lie, and the picture."""
    return float(np.abs(world.place_m[world.alive]).max() * 1.05)


def _scan(
    rng: np.random.Generator, world: World, row: int, site: Array, radars: Radars, half_m: float
) -> tuple[Scan, Indices]:
    hit = np.flatnonzero(world.alive[row] & (rng.random(world.alive.shape[1]) < DETECTION))
    ghosts = rng.uniform(-half_m, half_m, (rng.poisson(FALSE), 2))
    owner = np.concatenate([hit, np.full(len(ghosts), -1)])
    order = rng.permutation(len(owner))
    noise = rng.normal(size=(2, len(owner))) * (owner >= 0)
    away = np.concatenate([world.place_m[row, hit], ghosts]) - site
    far = np.hypot(*away.T) + noise[0] * radars.sigmas[0]
    bearing = np.arctan2(*away.T) + noise[1] * radars.sigmas[1]
    plots = polar(site, bearing[order], far[order], radars.sigmas[1], radars.sigmas[0])
    clutter = FALSE / (2 * half_m) ** 2
    t_ns = round(row * STEP_S * 1e9)
    scan = Scan(t_ns, plots, View(site), DETECTION, clutter)
    if radars.lengths:
        scan = scan._replace(features=_lengths(rng, owner[order], world.kind.size))
    return scan, owner[order]


def _lengths(rng: np.random.Generator, owner: Indices, targets: int) -> Said:
    """A length [m] of each plot: of false ones any, of two targets in a row never the same."""
    least, greatest = LENGTHS_M
    of_target = least + (greatest - least) * (np.arange(targets) * _GOLDEN % 1.0)
    value = of_target[owner] + rng.normal(0, SIGMA_LENGTH_M, len(owner))
    value = np.where(owner >= 0, value, rng.uniform(least, greatest, len(owner)))[None]
    variance = np.full_like(value, SIGMA_LENGTH_M**2)
    width = np.array([greatest - least])
    return Said(value, variance, np.empty((0, len(owner))), width, LENGTH)
