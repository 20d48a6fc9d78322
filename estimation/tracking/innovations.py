"""From rows to innovations and corrections: the Kalman update, one scalar equation after another.

The equations of a pair are made independent one by one (the update of a covariance by a scalar
needs no inverse), so that every kind of measurement takes the same path. Nothing of size 4 x 4 is
formed until it is known which pairs count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.tracking.imm import Bank
from estimation.tracking.measurements import Row


class Innovations(NamedTuple):
    """What each of k pairs would change in its track, under each model.

    Attributes:
        push: (rows, 4, 2, k) covariance of the state with each independent innovation.
        residual, variance: (rows, 2, k) of the independent innovations.
        log_density: (2, k) logarithm of the density of the plot given the track.
    """

    push: Array
    residual: Array
    variance: Array
    log_density: Array

    def distance_squared(self) -> Array:
        """Mahalanobis distances squared (2, k), chi-squared of as many degrees as rows."""
        squared: Array = (self.residual**2 / self.variance).sum(axis=0)
        return squared

    def take(self, which: Indices) -> Innovations:
        """The pairs `which`, in that order."""
        return Innovations(*(np.take(part, which, axis=-1) for part in self))

    def corrections(self) -> tuple[Array, Array]:
        """Change of the mean (4, 2, k) and decrease of the covariance (4, 4, 2, k)."""
        weight = (self.residual / self.variance)[:, None]
        shift = (self.push * weight).sum(axis=0)
        less = np.zeros((4, *shift.shape))
        for push, variance in zip(self.push, self.variance, strict=True):
            less += (push[:, None] * push) / variance
        return shift, less


class Common(NamedTuple):
    """An error that all plots of a scan share: that of the correction of the carrier's frame.

    Attributes:
        covariance: (3, 3) of (q east, q north [m], D clockwise [rad]).
        pivot_m: (2,) the point about which D turns, the carrier.
    """

    covariance: Array
    pivot_m: Array


def innovations(
    rows: list[Row], mean: Array, covariance: Array, common: Common | None = None
) -> Innovations:
    """Independent innovations of pairs whose states have the covariances (4, 4, 2, k).

    Args:
        rows: one or more equations of the same pairs, their noise independent.
        mean: (4, 2, k) the states at which the rows were taken.
        covariance: of those states.
        common: error shared by the plots; here it widens every pair by itself.
    """
    pushes: list[Array] = []
    residuals: list[Array] = []
    variances: list[Array] = []
    density = np.zeros(rows[0].residual.shape)
    for row in rows:
        gradient, push, residual = _widened(row, mean, covariance, common)
        for push_0, residual_0, variance_0 in zip(pushes, residuals, variances, strict=True):
            share = (gradient * push_0).sum(axis=0) / variance_0
            push = push - push_0 * share
            residual = residual - residual_0 * share
        variance = row.variance + (gradient * push).sum(axis=0)
        pushes.append(push)
        residuals.append(residual)
        variances.append(variance)
        density += row.log_reference - (residual**2 / variance + np.log(2 * np.pi * variance)) / 2
    push_of_state = np.stack([push[:4] for push in pushes])
    return Innovations(push_of_state, np.stack(residuals), np.stack(variances), density)


def joined_innovations(parts: list[Innovations]) -> Innovations:
    """Those of all the pairs, in order."""
    return Innovations(*(np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)))


def corrected(bank: Bank, found: Innovations) -> Bank:
    """The bank after one plot each, its models weighed by how well they foretold it."""
    shift, less = found.corrections()
    likelihood = np.exp(found.log_density - found.log_density.max(axis=0))
    joint = bank.model * likelihood
    return Bank(bank.mean + shift, bank.covariance - less, joint / joint.sum(axis=0))


def _widened(
    row: Row, mean: Array, covariance: Array, common: Common | None
) -> tuple[Array, Array, Array]:
    """Gradient, its product with the covariance, residual; the common error as three states."""
    push = covariance[:, 0] * row.gradient[0]
    for k in range(1, 4):
        push += covariance[:, k] * row.gradient[k]
    if common is None:
        return row.gradient, push, row.residual
    east, north = mean[:2] - common.pivot_m[:, None, None]
    turn = row.gradient[0] * north - row.gradient[1] * east
    shared = np.stack([row.gradient[0], row.gradient[1], turn])
    push_shared = np.einsum("ij,jmk->imk", common.covariance, shared)
    return np.concatenate([row.gradient, shared]), np.concatenate([push, push_shared]), row.residual
