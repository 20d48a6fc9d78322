"""From readings to innovations and corrections: the Kalman update with as little algebra as can be.

What costs is done once a state (`foretold`): what it should give, how surely, and what a reading
would push. A pair of a state and a plot is then a few numbers a row, made independent one after
another (S = L D L'), and what the pairs of a state do to it is summed before anything of size
4 x 4 is formed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.frames import wrap_pi
from estimation.tracking.imm import Bank
from estimation.tracking.measurements import Expected, Readings
from estimation.tracking.measurements.line_of_sight import LEAST_M


class Together(NamedTuple):
    """Errors of several frames that are known together, and hang together.

    Attributes:
        names: of the frames; sizes: how many errors each has, see `Common`.
        pivots_m: (frames, 2) about which each turns.
        covariance: (T, T) of all of them.
    """

    names: tuple[str, ...]
    sizes: tuple[int, ...]
    pivots_m: Array
    covariance: Array


class Common(NamedTuple):
    """An error that all plots of a scan share: that of the correction of the carrier's frame.

    Attributes:
        covariance: (K, K) of (q east, q north [m], D clockwise [rad]) and, for each source of the
            carrier whose ranges err, of what is to be added to them: b [m], and s a metre of range.
        pivot_m: (2,) the point about which D turns, the carrier.
        name: of the frame; errors of a frame without one are forgotten with the scan.
        slot: first of its columns among what tracks remember of frames, -1 if they do not.
        ranges: first of b and s of the scan's source among the K, 0 if its ranges do not err.
        site_m: (2,) from where ranges are measured; None = the pivot.
        together: these errors with those of other frames; None = independent of all.
        crossed: (errors, K) covariance of all that tracks remember with these.
    """

    covariance: Array
    pivot_m: Array
    name: str = ""
    slot: int = -1
    ranges: int = 0
    site_m: Array | None = None
    together: Together | None = None
    crossed: Array | None = None

    def displaces(self, mean: Array) -> Array:
        """By what (2, K, models, n) the errors displace the plots of targets (4, models, n)."""
        by = np.zeros((2, len(self.covariance), *mean.shape[1:]))
        east, north = mean[:2] - self.pivot_m[:, None, None]
        by[0, 0] = by[1, 1] = 1.0
        by[0, 2], by[1, 2] = north, -east
        if self.ranges:
            site_m = self.pivot_m if self.site_m is None else self.site_m
            away = mean[:2] - site_m[:, None, None]
            by[:, self.ranges] = away / np.maximum(np.hypot(*away), LEAST_M)
            by[:, self.ranges + 1] = away
        return by


class Foretold(NamedTuple):
    """What n states should give a sensor, under each model.

    Attributes:
        value: (rows, models, n).
        spread: (rows, rows, models, n) covariance of what is foretold, the common error included.
        push: (rows, 4, models, n) covariance of the state with it.
        rate: (rows, models, n) of the value by time.
        push_shared: (rows, errors, models, n) covariance of the errors of frames with it.
    """

    value: Array
    spread: Array
    push: Array
    rate: Array
    push_shared: Array


class Innovations(NamedTuple):
    """k pairs of a state and a plot, under each model.

    Attributes:
        state: (k,) rows of what was foretold.
        residual, variance: (rows, models, k) of the independent innovations.
        mixing: (rows, rows - 1, models, k) by what of the residuals before it each is less, or 0.
        log_density: (models, k) logarithm of the density of the plot given the track.
    """

    state: Indices
    residual: Array
    variance: Array
    mixing: Array
    log_density: Array

    def distance_squared(self) -> Array:
        """Mahalanobis distances squared (models, k), chi-squared of as many degrees as rows."""
        squared: Array = (self.residual**2 / self.variance).sum(axis=0)
        return squared

    def take(self, which: Indices) -> Innovations:
        """The pairs `which`, in that order."""
        return Innovations(self.state[which], *(part.take(which, axis=-1) for part in self[1:]))

    def weights(self) -> tuple[Array, Array]:
        """Of residuals r with covariance S: inv(S) r as r, inv(S) (rows, rows, models, k)."""
        inverse = np.zeros((len(self.residual), *self.residual.shape))
        weight = self.residual / self.variance
        for row in range(len(weight)):
            made = [*self.mixing[row, :row], 1.0]
            for i, one in enumerate(made):
                for j, other in enumerate(made):
                    inverse[i, j] += one * other / self.variance[row]
            share = self.residual[row] / self.variance[row]
            weight[:row] += self.mixing[row, :row] * share
        return weight, inverse


def foretold(expected: Expected, bank: Bank, common: Common | None = None) -> Foretold:
    """What states should give, and how surely.

    Args:
        common: error shared by the plots; one that tracks do not remember widens every pair anew.
    """
    rows, states = len(expected.value), expected.value.shape[1:]
    push, spread = np.zeros((rows, 4, *states)), np.zeros((rows, rows, *states))
    for row, gradient in enumerate(expected.gradient):
        axes = [axis for axis in range(4) if gradient[axis].any()]
        for axis in axes:
            push[row] += bank.covariance[:, axis] * gradient[axis]
        for axis in axes:
            spread[row, : row + 1] += push[: row + 1, axis] * gradient[axis]
    push_shared = np.einsum("aemn,ramn->remn", bank.shared, expected.gradient)
    if common is not None:
        by_frame = np.einsum(
            "ramn,aimn->rimn", expected.gradient[:, :2], common.displaces(bank.mean)
        )
        spread += np.einsum("rimn,ij,sjmn->rsmn", by_frame, common.covariance, by_frame)
        if common.crossed is not None:
            mine = slice(common.slot, common.slot + len(common.covariance))
            crossed = np.einsum("rimn,simn->rsmn", push_shared[:, mine], by_frame)
            spread += crossed + crossed.swapaxes(0, 1)
            push += np.einsum("aimn,rimn->ramn", bank.shared[:, mine], by_frame)
            push_shared += np.einsum("ij,rjmn->rimn", common.crossed, by_frame)
    rate = (expected.gradient[:, :2] * bank.mean[2:]).sum(axis=1)
    return Foretold(expected.value, spread, push, rate, push_shared)


def innovations(readings: Readings, told: Foretold, state: Indices, plot: Indices) -> Innovations:
    """Independent innovations of pairs (k,) of states and plots."""
    rows, shape = len(readings.value), (told.value.shape[1], len(state))
    residual, variance = np.empty((rows, *shape)), np.empty((rows, *shape))
    mixing, density = np.zeros((rows, max(rows - 1, 0), *shape)), np.zeros(shape)
    for row in range(rows):
        residual[row], covariance = _raw(readings, told, row, state, plot)
        variance[row] = covariance[row]
        for j in range(row):
            with_j = covariance[j] + sum(mixing[j, i] * covariance[i] for i in range(j))
            share = with_j / variance[j]
            residual[row] -= share * residual[j]
            variance[row] -= share * with_j
            mixing[row, j] -= share
            mixing[row, :j] -= share * mixing[j, :j]
        logarithm = np.log(2 * np.pi * variance[row])
        each = readings.log_reference[row] - (residual[row] ** 2 / variance[row] + logarithm) / 2
        density += np.where(np.isinf(variance[row]), 0.0, each)
    return Innovations(state, residual, variance, mixing, density)


def joined_innovations(parts: list[Innovations]) -> Innovations:
    """Those of all the pairs, in order."""
    return Innovations(*(np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)))


def corrections(told: Foretold, found: Innovations) -> tuple[Array, Array]:
    """Change of mean (4, models, k) and decrease of covariance (4, 4, models, k) by each pair."""
    weight, inverse = found.weights()
    return moved(told.push.take(found.state, axis=-1), weight, inverse)


def moved(push: Array, weight: Array, inverse: Array) -> tuple[Array, Array]:
    """Pushes (rows, 4, models, n) times weights (rows, models, n); matrices pushed both ways."""
    shift = np.zeros(push.shape[1:])
    change = np.zeros((4, *shift.shape))
    for row, along in enumerate(push):
        shift += along * weight[row]
        across = (push * inverse[row][:, None]).sum(axis=0)
        change += along[:, None] * across
    return shift, change


def corrected(bank: Bank, told: Foretold, found: Innovations) -> Bank:
    """The bank after one plot each, its models weighed by how well they foretold it."""
    shift, less = corrections(told, found)
    likelihood = np.exp(found.log_density - found.log_density.max(axis=0))
    joint = bank.model * likelihood
    return bank._replace(
        mean=bank.mean + shift,
        covariance=bank.covariance - less,
        model=joint / joint.sum(axis=0),
    )


def _raw(
    readings: Readings, told: Foretold, row: int, state: Indices, plot: Indices
) -> tuple[Array, list[Array]]:
    """Residuals (models, k) of a row, covariances with those up to it; inf if it is not there.

    An instant known to a sigma displaces the target by its velocity times that.
    """
    residual = readings.value[row, plot] - told.value[row].take(state, axis=-1)
    if readings.angle[row]:
        residual = wrap_pi(residual)
    covariance = [
        told.spread[row, j].take(state, axis=-1) + readings.covariance[row, j, plot]
        for j in range(row + 1)
    ]
    if readings.sigma_offset_s.any():
        covariance[row] += (told.rate[row][:, state] * readings.sigma_offset_s[plot]) ** 2
    absent = np.isnan(residual)
    if absent.any():
        residual[absent], covariance[row][absent] = 0.0, np.inf
    return residual, covariance
