"""The factors of a group as whitened rows: steps of carriers and targets, and all measurements.

A target log stamped t was taken at t - tau, tau its carrier's log-time offset, which may grow:
carrier and target are carried there by their velocities. What tau multiplies is not differentiated
again by heading, scale and current: half a second of a knot is a foot.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.bordered import Chain, Linearised, Observed
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.joint_navigation.group import (
    CLOCK,
    CLOCK_DRIFT,
    CONSTANTS,
    CURRENT,
    HEADING,
    LOG_DRIFT,
    LOG_TIME,
    SPEED_SCALE,
    Group,
)
from estimation.system_alignment.losses import Loss

_QUARTER_TURN = rotation_clockwise(np.pi / 2)
_UNKNOWN_M, _UNKNOWN_MPS = 1e5, 1e3  # of a target before its first log


class Point(NamedTuple):
    """Where the unknowns are.

    Attributes:
        x: (n, 2 C + 4 M).
        theta: (8 C + 3 J,) all constants.
    """

    x: Array
    theta: Array


class Rows:
    """Rows of one kind of measurement, filled column by column."""

    def __init__(self, group: Group, epoch: Indices) -> None:
        self.group, self.epoch = group, epoch
        self.index = np.arange(len(epoch))
        self.by_epoch = np.zeros((len(epoch), group.block))
        self.by_theta = np.zeros((len(epoch), len(group.mean)))

    def add_place(self, node: Indices, gradient: Array, which: Indices | None = None) -> None:
        """A gradient (m, 3) by the place of a node."""
        rows = self.index if which is None else which
        carriers = self.group.carriers
        own = node < carriers
        for axis in range(2):
            self.by_epoch[rows[own], 2 * node[own] + axis] += gradient[own, axis]
        for axis in range(3):
            column = CONSTANTS * carriers + 3 * (node[~own] - carriers) + axis
            self.by_theta[rows[~own], column] += gradient[~own, axis]

    def add_constant(self, carrier: Indices, which: int, gradient: Array | float) -> None:
        """A gradient by a constant of a carrier."""
        self.by_theta[self.index, CONSTANTS * carrier + which] += gradient

    def whitened(self, residual: Array, sigma: Array, loss: Loss) -> tuple[Observed, float]:
        """The rows in sigmas, and what they cost."""
        scaled = residual / sigma
        cost, weight = loss(scaled)
        root = np.sqrt(weight)
        by = (root / sigma)[:, None]
        free = self.by_theta[:, self.group.free]
        return Observed(self.epoch, root * scaled, by * self.by_epoch, by * free), float(cost.sum())


class Factors:
    """All rows of a group about any point: what the banded solver asks for."""

    def __init__(self, group: Group, loss: Loss) -> None:
        self.group, self.loss = group, loss

    def __call__(self, x: Array, free: Array) -> Linearised:
        """About x (n, b) and the free constants."""
        at = Point(x, self.theta(free))
        chain = self.steps(at)
        kinds = [self.ranging(at), *self.logs(at), self.azimuths(at), *self.fixes(at)]
        seen = [rows for rows, _ in kinds]
        observed = Observed(*(np.concatenate(part) for part in zip(*seen, strict=True)))
        known = (free - self.group.mean[self.group.free]) / self.group.sigma[self.group.free]
        cost = float(np.sum(chain.residual**2) + known @ known) + sum(c for _, c in kinds)
        by_theta = np.diag(1 / self.group.sigma[self.group.free])
        return Linearised(chain, observed, known, by_theta, cost)

    def theta(self, free: Array) -> Array:
        """All constants."""
        theta = self.group.mean.copy()
        theta[self.group.free] = free
        return theta

    def ranging(self, at: Point) -> tuple[Observed, float]:
        """Two-way ranges, pseudoranges and differences."""
        logs, group = self.group.ranging, self.group
        rows = Rows(group, logs.epoch)
        own = self._places(at, logs.carrier, logs.epoch)
        unit, distance = _sight(own, self._places(at, logs.peer, logs.epoch))
        rows.add_place(logs.peer, -unit)
        differs = np.flatnonzero(logs.reference >= 0)
        reference = logs.reference[differs]
        less, less_m = _sight(own[differs], self._places(at, reference, logs.epoch[differs]))
        rows.add_place(reference, less, differs)
        unit[differs] -= less
        distance[differs] -= less_m
        rows.add_place(logs.carrier, unit)
        distance += self._clocks(at, rows)
        return rows.whitened(distance - logs.value_m, logs.sigma_m, self.loss)

    def _clocks(self, at: Point, rows: Rows) -> Array:
        """What the clocks of both ends add to pseudoranges; a beacon's is right."""
        logs, group = self.group.ranging, self.group
        total = np.zeros(len(logs.epoch))
        time = group.time_s[logs.epoch]
        for node, sign in ((logs.carrier, 1.0), (logs.peer, -1.0)):
            counts = np.where(logs.clocked & (node < group.carriers), sign, 0.0)
            carrier = np.minimum(node, group.carriers - 1)
            rows.add_constant(carrier, CLOCK, counts)
            rows.add_constant(carrier, CLOCK_DRIFT, counts * time)
            offset, drift = (at.theta[CONSTANTS * carrier + i] for i in (CLOCK, CLOCK_DRIFT))
            total += counts * (offset + drift * time)
        return total

    def logs(self, at: Point) -> list[tuple[Observed, float]]:
        """Bearings and ranges of targets."""
        logs, group = self.group.logs, self.group
        first = 2 * group.carriers + 4 * logs.target
        target = np.stack([at.x[logs.epoch, first + i] for i in range(4)], axis=1)
        late, drift = (at.theta[CONSTANTS * logs.carrier + i] for i in (LOG_TIME, LOG_DRIFT))
        late = late + drift * group.time_s[logs.epoch]
        closing = target[:, 2:] - self._velocities(at)[logs.epoch, logs.carrier]
        apart = np.zeros((len(late), 3))
        own = self._places(at, logs.carrier, logs.epoch)
        apart[:, :2] = target[:, :2] - own[:, :2] - late[:, None] * closing
        apart[:, 2] = group.target_height_m - own[:, 2]
        unit, distance = _sight(apart, np.zeros_like(apart))
        rows = self._log_rows(unit, late, closing)
        ranges = rows.whitened(distance - logs.range_m, logs.sigma_range_m, self.loss)
        east, north = apart[:, :2].T
        level = np.maximum(east**2 + north**2, 1e-6)
        across = np.column_stack([north / level, -east / level, np.zeros_like(east)])
        rows = self._log_rows(across, late, closing)
        rows.add_constant(logs.carrier, HEADING, -1.0)
        bearing = np.arctan2(east, north) - at.theta[CONSTANTS * logs.carrier + HEADING]
        residual = wrap_pi(bearing - logs.bearing_rad)
        return [ranges, rows.whitened(residual, logs.sigma_bearing_rad, self.loss)]

    def _log_rows(self, gradient: Array, late: Array, closing: Array) -> Rows:
        """Rows of logs from the gradient (m, 3) by where the target is from the carrier."""
        logs = self.group.logs
        rows = Rows(self.group, logs.epoch)
        rows.add_place(logs.carrier, -gradient)
        first = 2 * self.group.carriers + 4 * logs.target
        for axis in range(2):
            rows.by_epoch[rows.index, first + axis] += gradient[:, axis]
            rows.by_epoch[rows.index, first + 2 + axis] -= late * gradient[:, axis]
        by_late = -np.sum(gradient[:, :2] * closing, axis=1)
        rows.add_constant(logs.carrier, LOG_TIME, by_late)
        rows.add_constant(logs.carrier, LOG_DRIFT, by_late * self.group.time_s[logs.epoch])
        return rows

    def azimuths(self, at: Point) -> tuple[Observed, float]:
        """Bearings of beacons and other carriers."""
        logs = self.group.azimuths
        rows = Rows(self.group, logs.epoch)
        apart = self._places(at, logs.peer, logs.epoch)
        apart = apart - self._places(at, logs.carrier, logs.epoch)
        east, north = apart[:, :2].T
        level = np.maximum(east**2 + north**2, 1e-6)
        across = np.column_stack([north / level, -east / level, np.zeros_like(east)])
        rows.add_place(logs.peer, across)
        rows.add_place(logs.carrier, -across)
        rows.add_constant(logs.carrier, HEADING, -1.0)
        bearing = np.arctan2(east, north) - at.theta[CONSTANTS * logs.carrier + HEADING]
        return rows.whitened(wrap_pi(bearing - logs.bearing_rad), logs.sigma_rad, self.loss)

    def fixes(self, at: Point) -> list[tuple[Observed, float]]:
        """Absolute places, east and north."""
        logs = self.group.fixes
        place = self._places(at, logs.carrier, logs.epoch)
        told = []
        for axis in range(2):
            rows = Rows(self.group, logs.epoch)
            rows.by_epoch[rows.index, 2 * logs.carrier + axis] = 1
            residual = place[:, axis] - logs.place_m[:, axis]
            told.append(rows.whitened(residual, logs.sigma_m, self.loss))
        return told

    def steps(self, at: Point) -> Chain:
        """Rows between epochs: carriers by dead reckoning, targets by constant velocity."""
        group, x = self.group, at.x
        b, carriers = group.block, group.carriers
        whitener, by_previous = self._step_matrices
        before = np.vstack([np.zeros(b), x[:-1]])
        moved = np.zeros_like(x)
        by_theta = np.zeros((len(x), b, len(at.theta)))
        for carrier in range(carriers):
            own = slice(2 * carrier, 2 * carrier + 2)
            moved[0, own] = group.paths[carrier].start_m
            moved[:, own] += self._travel(at, carrier)
            by_theta[:, own] = self._travel_by_theta(at, carrier)
        first = 2 * carriers  # constants move carriers only
        by_free = np.zeros((len(x), b, len(group.free)))
        by_free[:, :first] = whitener[:, :first, :first] @ by_theta[:, :first, group.free]
        residual = whitener @ (x - moved)[..., None] + by_previous @ before[..., None]
        return Chain(residual[..., 0], by_previous, whitener, by_free)

    def _travel(self, at: Point, carrier: int) -> Array:
        """(n, 2) step of a carrier, its errors taken out."""
        path, own = self.group.paths[carrier], at.theta[CONSTANTS * carrier :]
        rotation = rotation_clockwise(own[HEADING])
        drifted = own[CURRENT] * path.interval_s[:, None]
        travel: Array = (1 + own[SPEED_SCALE]) * path.travel_m @ rotation.T + drifted
        return travel

    def _travel_by_theta(self, at: Point, carrier: int) -> Array:
        """(n, 2, 8 C + 3 J) minus its derivatives."""
        path, first = self.group.paths[carrier], CONSTANTS * carrier
        own = at.theta[first:]
        turned = path.travel_m @ rotation_clockwise(own[HEADING]).T
        by_theta = np.zeros((len(turned), 2, len(at.theta)))
        by_theta[:, :, first + HEADING] = -(1 + own[SPEED_SCALE]) * turned @ _QUARTER_TURN.T
        by_theta[:, :, first + SPEED_SCALE] = -turned
        by_theta[:, [0, 1], [first + 2, first + 3]] = -path.interval_s[:, None]
        return by_theta

    def _velocities(self, at: Point) -> Array:
        """(n, C, 2) of the carriers over ground."""
        interval = self.group.interval_s[:, None]
        steps = [self._travel(at, carrier) / interval for carrier in range(self.group.carriers)]
        return np.stack(steps, axis=1)

    def _places(self, at: Point, node: Indices, epoch: Indices) -> Array:
        """(m, 3) of nodes."""
        group = self.group
        own = np.flatnonzero(node < group.carriers)
        beacon = np.flatnonzero(node >= group.carriers)
        places = np.empty((len(node), 3))
        heights = np.stack([path.height_m for path in group.paths], axis=1)
        for axis in range(2):
            places[own, axis] = at.x[epoch[own], 2 * node[own] + axis]
        places[own, 2] = heights[epoch[own], node[own]]
        beacons = at.theta[CONSTANTS * group.carriers :].reshape(-1, 3)
        places[beacon] = beacons[node[beacon] - group.carriers]
        return places

    @cached_property
    def _step_matrices(self) -> tuple[Array, Array]:
        """Whiteners (n, b, b) of the steps, and whitened rows by the previous epoch (n, b, b)."""
        group = self.group
        n, b, first = len(group.interval_s), group.block, 2 * group.carriers
        transition = np.broadcast_to(np.eye(b), (n, b, b)).copy()
        covariance = np.zeros((n, b, b))
        for carrier, (path, prior) in enumerate(zip(group.paths, group.priors, strict=True)):
            own = slice(2 * carrier, 2 * carrier + 2)
            covariance[:, own, own] = path.covariance
            covariance[0, own, own] += prior.start_m**2 * np.eye(2)
        for target in range(group.targets):
            own = slice(first + 4 * target, first + 4 * target + 4)
            transition[:, own, own], covariance[:, own, own] = self._target_step()
        by_previous = -transition
        by_previous[0] = 0
        whitener = np.linalg.inv(np.linalg.cholesky(covariance))
        return whitener, whitener @ by_previous

    def _target_step(self) -> tuple[Array, Array]:
        """Transitions and covariances (n, 4, 4) of a target; before the first epoch: unknown."""
        dt = self.group.interval_s[:, None, None]
        eye, nothing = np.eye(2), np.zeros((2, 2))
        ones = np.ones_like(dt)
        transition = np.block([[ones * eye, dt * eye], [ones * nothing, ones * eye]])
        noise = np.block([[dt**3 / 3 * eye, dt**2 / 2 * eye], [dt**2 / 2 * eye, dt * eye]])
        noise = self.group.agility**2 * noise
        noise[0] = np.diag([_UNKNOWN_M**2] * 2 + [_UNKNOWN_MPS**2] * 2)
        return transition, noise


def _sight(place: Array, other: Array) -> tuple[Array, Array]:
    """Unit vectors (m, 3) from the other to the place, and distances (m,)."""
    apart = place - other
    distance = np.sqrt(np.sum(apart**2, axis=1))
    return apart / np.maximum(distance, 1e-9)[:, None], distance
