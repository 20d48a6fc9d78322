"""Filters that are told whose each plot is: what motion alone costs, without association."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.motions.sights import Sight
from estimation.arrays import Array
from estimation.tracking import imm
from estimation.tracking.imm import Bank, Motion
from estimation.tracking.innovations import corrected, foretold, innovations

SINGLE = tuple(Motion((density,), (), ()) for density in np.geomspace(1e-5, 300.0, 9))
"""Filters of one model each, the noise of the acceleration [m^2/s^3] from next to none to hard."""


class Estimates(NamedTuple):
    """Of the targets with a filter, at the end of a round: rows, means (n, 4), covariances."""

    row: int
    target: NDArray[np.intp]
    mean: Array
    covariance: Array


def filtered(sights: Sequence[Sight], targets: int, motion: Motion) -> Iterator[Estimates]:
    """A filter for each target from its first plot on."""
    bank = imm.empty(motion.models)
    owner = np.empty(0, dtype=np.intp)
    t_ns = 0
    for sight in sights:
        bank = imm.predicted(bank, (sight.scan.t_ns - t_ns) * 1e-9, motion)
        t_ns = sight.scan.t_ns
        row = np.full(targets, -1)
        row[owner] = np.arange(len(owner))
        mine = np.flatnonzero(sight.owner >= 0)
        known = mine[row[sight.owner[mine]] >= 0]
        bank = _improved(bank, sight, row[sight.owner[known]], known)
        fresh = np.setdiff1d(mine, known)
        found = sight.scan.plots.found()
        if found is not None:
            born = imm.born(
                found.place_m[:, fresh],
                found.covariance_m2[..., fresh],
                np.zeros(len(fresh)),
                motion,
            )
            bank, owner = imm.joined(bank, born), np.append(owner, sight.owner[fresh])
        if sight.ends_round:
            mean, covariance = imm.combined(bank)
            yield Estimates(sight.row, owner, mean.T, np.moveaxis(covariance, -1, 0))


def _improved(bank: Bank, sight: Sight, rows: NDArray[np.intp], plots: NDArray[np.intp]) -> Bank:
    """The bank with one plot each taken into some of its rows."""
    if not rows.size:
        return bank
    some = bank.take(rows)
    told = foretold(sight.scan.plots.expected(some.mean, 0.0), some)
    found = innovations(sight.scan.plots.readings(), told, np.arange(len(rows)), plots)
    after = corrected(some, told, found)
    parts = tuple(part.copy() for part in bank)
    for whole, part in zip(parts, after, strict=True):
        whole[..., rows] = part
    return Bank(*parts)
