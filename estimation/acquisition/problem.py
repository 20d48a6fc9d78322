"""What is given to an acquisition: two carriers' tracks in Cartesian form, clues, constraints.

The unknown is t = (q, D) of own axes: a target seen by the own carrier at p and by the other at r
obeys p = q + R(D) r. `Problem` holds both sides of it as plain arrays; nothing in it depends on t.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike, Indices, transposed
from estimation.frames import east_north_by_polar, east_north_from_polar
from estimation.relative_frame import PolarLogs

Mask: TypeAlias = NDArray[np.bool_]
LogRatio: TypeAlias = ArrayLike | Callable[[Indices, Indices], ArrayLike]

_AREA_BY_SPREAD = 12.0  # area / sqrt|covariance| of a rectangle; 4 pi for a Gaussian's own density
_UNKNOWN_VARIANCE = 1e12  # of a velocity that was not reported


@dataclass(frozen=True, eq=False, slots=True)
class Velocities:
    """Velocities over ground of one carrier's targets, along its own (biased) axes.

    Attributes:
        east_north_mps: (L, 2); NaN where a log has none.
        covariance: (L, 2, 2) [m^2/s^2].
    """

    east_north_mps: Array
    covariance: Array


@dataclass(frozen=True, eq=False, slots=True)
class Clues:
    """What else tells targets apart, beside where they are.

    Attributes:
        own_velocity, other_velocity: used when both are given; the other's turn with D.
        sigma_speed_mps: of one component of the velocity over all targets, which makes a likeness
            of velocities worth more or less.
        log_ratio: (N1, N2) ln p(features | same target) / p(features | two targets), or a function
            of two index arrays that gives it pair by pair; 0 where nothing is known, minus
            infinity where it is impossible.
    """

    own_velocity: Velocities | None = None
    other_velocity: Velocities | None = None
    sigma_speed_mps: float = 10.0
    log_ratio: LogRatio = 0.0


@dataclass(frozen=True, slots=True)
class Constraints:
    """Hard knowledge: pairs that are, and pairs that are not, of one target.

    Attributes:
        bound: (own index, other index) that must be paired.
        forbidden: that must not.
    """

    bound: frozenset[tuple[int, int]] = field(default_factory=frozenset)
    forbidden: frozenset[tuple[int, int]] = field(default_factory=frozenset)


def constraints(
    own_identities: Sequence[object] = (),
    other_identities: Sequence[object] = (),
    bind: Sequence[tuple[int, int]] = (),
    forbid: Sequence[tuple[int, int]] = (),
) -> Constraints:
    """Constraints by unique identities (None: not known) and by the operator, who overrules them.

    An identity that one carrier gives to two logs is not unique and binds neither of them.

    Raises:
        ValueError: a pair is both bound and forbidden, or a log is bound twice.
    """
    bound, forbidden = set(bind), set(forbid)
    if both := bound & forbidden:
        raise ValueError(f"pairs bound and forbidden at once: {sorted(both)}")
    own_bound, other_bound = {i for i, _ in bound}, {j for _, j in bound}
    if len(own_bound) < len(bound) or len(other_bound) < len(bound):
        raise ValueError(f"a log may be bound to one other log only: {sorted(bound)}")
    for i, mine in enumerate(own_identities):
        for j, theirs in enumerate(other_identities):
            if mine is None or theirs is None or i in own_bound or j in other_bound:
                continue
            if mine != theirs:
                forbidden.add((i, j))
            elif _unique(mine, own_identities) and _unique(theirs, other_identities):
                bound |= {(i, j)} - forbidden
    return Constraints(frozenset(bound), frozenset(forbidden))


def _unique(identity: object, among: Sequence[object]) -> bool:
    return sum(identity == each for each in among) == 1


@dataclass(frozen=True, eq=False, slots=True)
class Side:
    """One carrier's logs along its own axes; positions and, where m = 4, velocities.

    Attributes:
        state: (N, m) east, north [m] and perhaps their rates [m/s].
        covariance: (N, m, m), without correlation of position and velocity.
        moving: (N,) whether the velocity is known.
    """

    state: Array
    covariance: Array
    moving: Mask

    @property
    def count(self) -> int:
        """N."""
        return int(self.state.shape[0])

    def take(self, which: NDArray[Any]) -> Side:
        """The logs an index array names."""
        return Side(self.state[which], self.covariance[which], self.moving[which])


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """Two sides and what is known of pairs before any frame.

    Attributes:
        log_ratio: (N1, N2) of features, minus infinity where a pair is not allowed.
        bound: (K, 2) pairs that must be.
        area_m2: on which the logs lie: N / area is their density.
        sigma_speed_mps: of the population's velocities.
    """

    own: Side
    other: Side
    log_ratio: Array
    bound: Indices
    area_m2: float
    sigma_speed_mps: float


def problem(
    own: PolarLogs,
    other: PolarLogs,
    clues: Clues,
    known: Constraints,
    area_m2: float | None,
) -> Problem:
    """Cartesian form of two carriers' logs; the area is that of their spread if not given."""
    both = clues.own_velocity is not None and clues.other_velocity is not None
    sides = (
        _side(own, clues.own_velocity if both else None),
        _side(other, clues.other_velocity if both else None),
    )
    bound = np.array(sorted(known.bound), dtype=np.intp).reshape(-1, 2)
    ratio = _log_ratio(clues.log_ratio, own.count, other.count)
    for i, j in known.forbidden:
        ratio[i, j] = -np.inf
    kept = ratio[bound[:, 0], bound[:, 1]]
    ratio[bound[:, 0], :] = -np.inf
    ratio[:, bound[:, 1]] = -np.inf
    ratio[bound[:, 0], bound[:, 1]] = np.where(np.isfinite(kept), kept, 0.0)
    area = area_of(*sides) if area_m2 is None else area_m2
    return Problem(*sides, ratio, bound, area, clues.sigma_speed_mps)


def _side(logs: PolarLogs, velocity: Velocities | None) -> Side:
    """Cartesian states of a carrier's logs, with their velocities if there are any."""
    position = east_north_from_polar(logs.bearing_rad, logs.range_m)
    by_polar = east_north_by_polar(logs.bearing_rad, logs.range_m)
    spread = by_polar @ logs.covariance @ transposed(by_polar)
    if velocity is None:
        return Side(position, spread, np.zeros(logs.count, dtype=bool))
    rates = np.asarray(velocity.east_north_mps, dtype=float)
    moving = np.isfinite(rates).all(axis=1)
    covariance = np.zeros((logs.count, 4, 4))
    covariance[:, :2, :2] = spread
    unknown = _UNKNOWN_VARIANCE * np.eye(2)
    covariance[:, 2:, 2:] = np.where(moving[:, None, None], velocity.covariance, unknown)
    state = np.concatenate([position, np.where(moving[:, None], rates, 0.0)], axis=1)
    return Side(state, covariance, moving)


def _log_ratio(given: LogRatio, own: int, other: int) -> Array:
    """The matrix (N1, N2) of a matrix, a number or a function of pairs."""
    if callable(given):
        i, j = np.indices((own, other)).reshape(2, -1)
        given = np.asarray(given(i, j), dtype=float).reshape(own, other)
    return np.array(np.broadcast_to(np.asarray(given, dtype=float), (own, other)))


def area_of(own: Side, other: Side) -> float:
    """Area [m^2] on which logs of both carriers lie, as their spread has it.

    Few logs tell little of their spread: each side is joined by four imagined logs at its carrier's
    mean range, north, east, south and west of it. Densities are averaged, not areas: a pair is
    worth the less the denser the logs, so the error is on the side of doubt.
    """
    density = np.mean([1 / _spread(side) for side in (own, other)])
    return float(_AREA_BY_SPREAD / np.maximum(density, np.finfo(float).tiny))


def _spread(side: Side) -> float:
    """sqrt|covariance| [m^2] of one carrier's positions."""
    place = side.state[:, :2]
    off = place - place.mean(axis=0)
    imagined = 2 * np.square(place).sum(axis=1).mean() * np.eye(2)
    few = 1 / side.count  # of the imagined logs' weight: gone when there are many
    weight = side.count - 1 + 4 * few
    return float(np.sqrt(np.linalg.det((off.T @ off + few * imagined) / weight)))
