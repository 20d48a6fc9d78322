"""How good and how honest estimates are, target by target and by what it does just then."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.motions.told import Estimates
from bench.motions.worlds import STEP_S, World
from estimation.arrays import Array, Indices
from estimation.consistency import nees, rms

SETTLED_S = 60.0
"""Of a target's life, before it counts."""


class Errors(NamedTuple):
    """k estimates against their targets: row of instants, target, error [m], NEES/2 and NEES/4."""

    row: Indices
    target: Indices
    error_m: Array
    place: Array
    state: Array

    def only(self, which: NDArray[np.bool_]) -> Errors:
        """Some of them."""
        return Errors(*(part[which] for part in self))

    def rms_m(self) -> float:
        """Root mean square error of the place."""
        return float(rms(self.error_m)) if len(self.row) else float("nan")

    def mean(self, of: Array) -> tuple[float, float]:
        """Mean over the targets' estimates, and its standard error, targets being independent."""
        if not len(self.row):
            return float("nan"), float("nan")
        _, which = np.unique(self.target, return_inverse=True)
        total, number = np.bincount(which, of), np.bincount(which)
        mean = total.sum() / number.sum()
        off = total - mean * number
        return float(mean), float(np.sqrt(np.sum(off**2)) / number.sum())


def errors(world: World, estimates: Iterable[Estimates]) -> Errors:
    """Of filters that are told whose each plot is."""
    parts = [errors_of(world, np.full(len(each.target), each.row), *each[1:]) for each in estimates]
    return Errors(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def errors_of(
    world: World, row: Indices, target: Indices, mean: Array, covariance: Array
) -> Errors:
    """Of estimates (k, 4) with covariances, of targets that have lived long enough and still do."""
    born = world.alive.argmax(axis=0)
    old = world.alive[row, target] & ((row - born[target]) * STEP_S >= SETTLED_S)
    row, target = row[old], target[old]
    truth = np.hstack([part[row, target] for part in (world.place_m, world.velocity_mps)])
    off, covariance = mean[old] - truth, covariance[old]
    return Errors(
        row,
        target,
        np.linalg.norm(off[:, :2], axis=1),
        nees(off[:, :2], covariance[:, :2, :2]) / 2,
        nees(off, covariance) / 4,
    )
