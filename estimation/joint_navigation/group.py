"""What a group of carriers brings to one joint solution: dead reckoning, priors, measurements.

Constants theta are, carrier by carrier, (heading bias; speed scale; current east, north; ranging
clock offset, drift; log-time offset, drift), then x, y, z of each beacon. At every epoch there are
the places of all carriers (east, north) and of all targets (east, north, velocity east, north).
Nodes are numbered: carriers first, then beacons.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike, Indices, broadcast
from estimation.system_alignment.logs import DeadReckoning

CONSTANTS = 8
HEADING, SPEED_SCALE, CURRENT, CLOCK, CLOCK_DRIFT = 0, 1, slice(2, 4), 4, 5
LOG_TIME, LOG_DRIFT = 6, 7


class CarrierPrior(NamedTuple):
    """One-sigma errors of a carrier before the data; 0 = known, and left out.

    Attributes:
        start_m: of the reported place, per axis; never quite 0.
        heading_rad: of its north, the same for dead reckoning and for its sensors.
        log_time_s: by which its target logs are stamped late (the log's time less the true one)
            at time 0; log_drift: by how much more in every second after that.
    """

    start_m: float = 0.0
    heading_rad: float = 0.0
    speed_scale: float = 0.0
    current_mps: float = 0.0
    clock_m: float = 0.0
    clock_drift_mps: float = 0.0
    log_time_s: float = 0.0
    log_drift: float = 0.0

    @property
    def sigmas(self) -> list[float]:
        """(8,) of the constants."""
        moving = [self.heading_rad, self.speed_scale, self.current_mps, self.current_mps]
        clocks = [self.clock_m, self.clock_drift_mps, self.log_time_s, self.log_drift]
        return [*moving, *clocks]


class Ranging(NamedTuple):
    """Ranges between nodes, by `ranging`.

    Attributes:
        epoch: (m,).
        carrier: (m,) who measured.
        peer: (m,) node at the other end.
        reference: (m,) node whose range was taken away, -1: none.
        clocked: (m,) whether both clocks are in it (a pseudorange).
        value_m: (m,).
        sigma_m: (m,).
    """

    epoch: Indices
    carrier: Indices
    peer: Indices
    reference: Indices
    clocked: NDArray[np.bool_]
    value_m: Array
    sigma_m: Array


class TargetLogs(NamedTuple):
    """Bearings and ranges of associated targets, by `target_logs`; all (m,).

    The bearing is clockwise from the carrier's own north; the epoch is the one of the stamp.
    """

    epoch: Indices
    carrier: Indices
    target: Indices
    bearing_rad: Array
    range_m: Array
    sigma_bearing_rad: Array
    sigma_range_m: Array


class Azimuths(NamedTuple):
    """Bearings of nodes from the carriers' own north, by `azimuths`; all (m,)."""

    epoch: Indices
    carrier: Indices
    peer: Indices
    bearing_rad: Array
    sigma_rad: Array


class Fixes(NamedTuple):
    """Absolute places of carriers, by `fixes`: (m,), and place (m, 2) with sigma (m,) per axis."""

    epoch: Indices
    carrier: Indices
    place_m: Array
    sigma_m: Array


def _columns(*values: ArrayLike) -> list[Array]:
    return [np.atleast_1d(column) for column in broadcast(*values)]


def _whole(column: Array) -> Indices:
    return column.astype(np.intp)


def ranging(
    epoch: ArrayLike,
    carrier: ArrayLike,
    peer: ArrayLike,
    value_m: ArrayLike,
    sigma_m: ArrayLike,
    *,
    reference: ArrayLike = -1,
    clocked: ArrayLike = False,
) -> Ranging:
    """Columns that broadcast: two-way ranges, pseudoranges (`clocked`), differences."""
    k, c, p, v, s, r, t = _columns(epoch, carrier, peer, value_m, sigma_m, reference, clocked)
    return Ranging(_whole(k), _whole(c), _whole(p), _whole(r), t.astype(bool), v, s)


def target_logs(
    epoch: ArrayLike,
    carrier: ArrayLike,
    target: ArrayLike,
    bearing_rad: ArrayLike,
    range_m: ArrayLike,
    sigma_bearing_rad: ArrayLike,
    sigma_range_m: ArrayLike,
) -> TargetLogs:
    """Columns that broadcast."""
    k, c, t, *polar = _columns(
        epoch, carrier, target, bearing_rad, range_m, sigma_bearing_rad, sigma_range_m
    )
    bearing, distance, sigma_bearing, sigma_range = polar
    indices = _whole(k), _whole(c), _whole(t)
    return TargetLogs(*indices, bearing, distance, sigma_bearing, sigma_range)


def azimuths(
    epoch: ArrayLike,
    carrier: ArrayLike,
    peer: ArrayLike,
    bearing_rad: ArrayLike,
    sigma_rad: ArrayLike,
) -> Azimuths:
    """Columns that broadcast."""
    k, c, p, bearing, sigma = _columns(epoch, carrier, peer, bearing_rad, sigma_rad)
    return Azimuths(_whole(k), _whole(c), _whole(p), bearing, sigma)


def fixes(epoch: ArrayLike, carrier: ArrayLike, place_m: ArrayLike, sigma_m: ArrayLike) -> Fixes:
    """Columns that broadcast; places (m, 2)."""
    k, c, s = _columns(epoch, carrier, sigma_m)
    return Fixes(_whole(k), _whole(c), np.asarray(place_m, dtype=float).reshape(-1, 2), s)


NO_RANGING = ranging([], [], [], [], [])
NO_LOGS = target_logs([], [], [], [], [], [], [])
NO_AZIMUTHS = azimuths([], [], [], [], [])
NO_FIXES = fixes([], [], [], [])


@dataclass(frozen=True, eq=False)
class Group:
    """Everything one joint solution is made of.

    Attributes:
        paths: dead reckoning of each carrier over the same n epochs; `start_m` as reported.
        priors: of each carrier.
        beacons_m: (J, 3) as believed.
        sigma_beacons_m: (J, 3), 0 where surveyed.
        targets: how many targets the logs name.
        target_height_m: above the plane of the starts.
        agility: intensity of the targets' white acceleration [m/s^1.5].
    """

    paths: tuple[DeadReckoning, ...]
    priors: tuple[CarrierPrior, ...]
    beacons_m: Array = field(default_factory=lambda: np.empty((0, 3)))
    sigma_beacons_m: Array = field(default_factory=lambda: np.empty((0, 3)))
    targets: int = 0
    target_height_m: float = 0.0
    agility: float = 0.3
    ranging: Ranging = NO_RANGING
    logs: TargetLogs = NO_LOGS
    azimuths: Azimuths = NO_AZIMUTHS
    fixes: Fixes = NO_FIXES

    @property
    def carriers(self) -> int:
        """C."""
        return len(self.paths)

    @property
    def block(self) -> int:
        """Unknowns of an epoch."""
        return 2 * self.carriers + 4 * self.targets

    @cached_property
    def mean(self) -> Array:
        """(8 C + 3 J,) constants before the data."""
        return np.concatenate([np.zeros(CONSTANTS * self.carriers), self.beacons_m.ravel()])

    @cached_property
    def sigma(self) -> Array:
        """(8 C + 3 J,) of the constants."""
        own = [sigma for prior in self.priors for sigma in prior.sigmas]
        return np.concatenate([own, self.sigma_beacons_m.ravel()])

    @cached_property
    def free(self) -> Indices:
        """Indices of the constants that are not known."""
        return np.flatnonzero(self.sigma > 0)

    @cached_property
    def interval_s(self) -> Array:
        """(n,) of the steps."""
        return self.paths[0].interval_s

    @cached_property
    def time_s(self) -> Array:
        """(n,) of the epochs."""
        return self.paths[0].time_s


def constant(carrier: int, which: int) -> int:
    """Index of a carrier's constant, e.g. `constant(1, LOG_TIME)`."""
    return CONSTANTS * carrier + which
