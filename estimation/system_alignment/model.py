"""The equations of a system alignment as whitened rows: steps, ranges, prior.

Unknown at epoch k are the place p_k (east, north), not its correction, and where turns are summed
up the heading's error psi_k: then the steps are linear in wind and place, and only the ranges bend.

    p_k = p_{k-1} + (1 + kappa) R(beta + psi_k) travel_k + W dt_k              (1), (8)
    Z = (1 + rho) (|p_k - s_i| - |p_k - s_j|) + d_i + clock + drift t_k        (2), (3)

Source: Grinyak et al.; (10), (12), (14), (15) are these rows linearised, (13) prints a minus
before the wind where a plus belongs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimation.arrays import Array, Indices
from estimation.bordered import Chain, Linearised, Observed
from estimation.frames import rotation_clockwise
from estimation.system_alignment.logs import DeadReckoning, Ranges
from estimation.system_alignment.losses import Loss, squares
from estimation.system_alignment.parameters import (
    CLOCK_DRIFT,
    CLOCK_OFFSET,
    HEADING_BIAS,
    RANGE_SCALE,
    SPEED_SCALE,
    WIND,
    Prior,
    offsets_of,
    places_of,
)

_QUARTER_TURN = rotation_clockwise(np.pi / 2)


class Sight:
    """Lines of sight of the ranges from given places to given beacons.

    Attributes:
        unit: (m, 3) from beacon to object, less that of the reference.
        length_m: (m,) the range or the difference.
    """

    def __init__(self, logs: Ranges, places: Array, beacons: Array) -> None:
        self.of_beacon, length = _unit(places - beacons[logs.beacon])
        self.unit, self.length_m = self.of_beacon.copy(), length
        self.differs = np.flatnonzero(logs.reference >= 0)
        if self.differs.size:
            reference = beacons[logs.reference[self.differs]]
            self.of_reference, less = _unit(places[self.differs] - reference)
            self.unit[self.differs] -= self.of_reference
            self.length_m[self.differs] -= less


def predicted_ranges(
    theta: Array, logs: Ranges, places: Array, time_s: Array
) -> tuple[Array, Array, Array]:
    """Ranges (m,) by the model, with derivatives by place (m, 2) and by theta (m, 7 + 4 J).

    Args:
        theta: (7 + 4 J,).
        logs: which ranges.
        places: (m, 3) of the object at each.
        time_s: (m,) since the start.
    """
    where, offset = places_of(theta), offsets_of(theta)
    sight = Sight(logs, places, theta[where])
    stretch = 1 + theta[RANGE_SCALE]
    rows = np.arange(len(places))
    by_theta = np.zeros((len(places), len(theta)))
    by_theta[:, RANGE_SCALE] = sight.length_m
    by_theta[rows[:, None], where[logs.beacon]] = -stretch * sight.of_beacon
    by_theta[rows, offset[logs.beacon]] = 1
    plain = logs.reference < 0
    by_theta[plain, CLOCK_OFFSET] = 1
    by_theta[plain, CLOCK_DRIFT] = time_s[plain]
    if (on := sight.differs).size:
        by_theta[on[:, None], where[logs.reference[on]]] += stretch * sight.of_reference
    value = stretch * sight.length_m + theta[offset[logs.beacon]]
    value[plain] += theta[CLOCK_OFFSET] + theta[CLOCK_DRIFT] * time_s[plain]
    return value, stretch * sight.unit[:, :2], by_theta


@dataclass(frozen=True, eq=False)
class Model:
    """One alignment: what was measured, what is known before."""

    path: DeadReckoning
    logs: Ranges
    prior: Prior
    loss: Loss = squares

    @property
    def block(self) -> int:
        """Unknowns of an epoch: 2, or 3 with a heading's error that walks."""
        return 3 if self.path.turns else 2

    @cached_property
    def free(self) -> Indices:
        """Of the constants."""
        return self.prior.free

    def theta(self, free: Array) -> Array:
        """All constants, from those that are free."""
        theta = self.prior.mean.copy()
        theta[self.free] = free
        return theta

    def dead_reckoned(self, free: Array, known: Array | None = None) -> Array:
        """(n, b) the path as these constants have it, no walk added, after its known epochs."""
        theta, path = self.theta(free), self.path
        count = 0 if known is None else len(known)
        start = np.zeros(self.block)
        start[:2] = path.start_m
        if known is not None and count:
            start = known[-1]
        turn = start[2] if self.block == 3 else 0.0
        travel = turned_travel(theta, path.travel_m[count:], turn)
        steps = travel + theta[WIND] * path.interval_s[count:, None]
        x = np.tile(start, (len(path.interval_s), 1))
        x[count:, :2] += np.cumsum(steps, axis=0)
        if known is not None:
            x[:count] = known
        return x

    def places(self, x: Array) -> Array:
        """(m, 3) of the object at each range."""
        at = self.logs.epoch
        return np.column_stack([x[at, :2], self.path.height_m[at]])

    def residuals(self, x: Array, free: Array) -> Array:
        """(m,) measured less predicted, in sigmas."""
        value, _, _ = self._predicted(x, free)
        return (self.logs.value_m - value) / self.logs.sigma_m

    def __call__(self, x: Array, free: Array) -> Linearised:
        """All rows about a point."""
        chain = self._steps(x, self.theta(free))
        observed, loss = self._ranges(x, free)
        whitener = self.whitener
        known = whitener @ (free - self.prior.mean[self.free])
        cost = float(np.sum(chain.residual**2) + loss + known @ known)
        return Linearised(chain, observed, known, whitener, cost)

    @cached_property
    def whitener(self) -> Array:
        """(T, T) of the free constants' prior."""
        free = self.free
        covariance = self.prior.covariance[np.ix_(free, free)]
        sigma = np.sqrt(np.diag(covariance))
        root = np.linalg.cholesky(covariance / np.outer(sigma, sigma))
        whitener: Array = np.linalg.inv(root) / sigma
        return whitener

    def by_theta(self, x: Array, free: Array) -> Array:
        """(m, 7 + 4 J) derivatives of the ranges by all constants."""
        return self._predicted(x, free)[2]

    def _predicted(self, x: Array, free: Array) -> tuple[Array, Array, Array]:
        return predicted_ranges(self.theta(free), self.logs, self.places(x), self._time_s)

    @cached_property
    def _time_s(self) -> Array:
        """(m,) of the ranges, since the start."""
        return self.path.time_s[self.logs.epoch]

    def _ranges(self, x: Array, free: Array) -> tuple[Observed, float]:
        value, by_place, by_theta = self._predicted(x, free)
        residual = (value - self.logs.value_m) / self.logs.sigma_m
        cost, weight = self.loss(residual)
        root = np.sqrt(weight)
        scale = (root / self.logs.sigma_m)[:, None]
        by_epoch = np.zeros((len(value), self.block))
        by_epoch[:, :2] = scale * by_place
        by_free = scale * by_theta[:, self.free]
        return Observed(self.logs.epoch, root * residual, by_epoch, by_free), float(cost.sum())

    def _steps(self, x: Array, theta: Array) -> Chain:
        """Rows of (1): places, and the heading's walk where there is one."""
        path, b = self.path, self.block
        turn = x[:, 2] if b == 3 else np.zeros(len(x))
        travel = turned_travel(theta, path.travel_m, turn)
        before = np.zeros_like(x)
        before[1:] = x[:-1]
        before[0, :2] = path.start_m
        aside = travel @ _QUARTER_TURN.T  # derivative by an angle
        by_theta = np.zeros((len(x), b, len(theta)))
        by_theta[:, [0, 1], [0, 1]] = -path.interval_s[:, None]
        by_theta[:, :2, SPEED_SCALE] = -travel / (1 + theta[SPEED_SCALE])
        by_theta[:, :2, HEADING_BIAS] = -aside
        residual = x - before
        residual[:, :2] -= travel + theta[WIND] * path.interval_s[:, None]
        by_epoch = np.broadcast_to(np.eye(b), (len(x), b, b)).copy()
        if b == 3:
            by_epoch[:, :2, 2] = -aside
        whitener = self._step_whitener
        return Chain(
            (whitener @ residual[..., None])[..., 0],
            -whitener,
            whitener @ by_epoch,
            whitener @ by_theta[:, :, self.free],
        )

    @cached_property
    def _step_whitener(self) -> Array:
        """(n, b, b) inverse roots of the steps' covariances."""
        whitener = np.zeros((len(self.path.interval_s), self.block, self.block))
        whitener[:, :2, :2] = _inverse_roots(self.path.covariance)
        if self.block == 3:
            whitener[:, 2, 2] = 1 / np.maximum(self.path.sigma_turn_rad, 1e-9)
        return whitener


def turned_travel(theta: Array, travel_m: Array, turn_rad: Array | float) -> Array:
    """(n, 2) travel with speed scale and heading bias taken into account."""
    rotation = rotation_clockwise(theta[HEADING_BIAS] + turn_rad)
    turned: Array = (1 + theta[SPEED_SCALE]) * (rotation @ travel_m[..., None])[..., 0]
    return turned


def _inverse_roots(covariance: Array) -> Array:
    """Lower inverse Cholesky factors of (n, 2, 2), written out: numpy's loop is slow for 2 by 2."""
    a, b, c = covariance[:, 0, 0], covariance[:, 1, 0], covariance[:, 1, 1]
    first = np.sqrt(a)
    second = np.sqrt(c - b**2 / a)
    inverse = np.zeros_like(covariance)
    inverse[:, 0, 0] = 1 / first
    inverse[:, 1, 0] = -b / (a * second)
    inverse[:, 1, 1] = 1 / second
    return inverse


def _unit(vector: Array) -> tuple[Array, Array]:
    """Unit vectors and lengths; a vector of no length stays, and points nowhere."""
    length = np.sqrt(np.sum(vector**2, axis=1))
    return vector / np.maximum(length, 1e-9)[:, None], length
