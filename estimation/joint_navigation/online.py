"""The joint state of a group as it grows: one extended Kalman filter over all carriers.

The state is made of *blocks* by name: the gauge, then carriers, sources, beacons and targets as
they join and leave. A block has a fixed number of *slots*; slots that are known have no row in the
covariance.

Ranges and target logs do not change when everything is turned about one known point, so a filter
in true axes would feign to learn the turn each time it linearises anew. The state therefore lies in
axes turned with the north of the carrier that founded the group, about a pivot: p' = R(-n)(p - c).
There the unobservable turn is one slot, the gauge's north n, which only what knows true axes
(further beacons, fixes) touches. Stamps and their drifts are likewise counted from the founder's
clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices
from estimation.frames import rotation_clockwise
from estimation.system_alignment.losses import huber, tapered

GAUGE = "gauge"
SIZES = {GAUGE: 3, "carrier": 13, "source": 5, "beacon": 3, "target": 4, "waiting": 1, "link": 1}
NORTH, TIME, RATE = 0, 1, 2
"""Slots of the gauge: bearing of the founder's north; its clock less true time when clocks were as
sure as is stated, and by how much more in every second after that."""
PLACE, HEADING, SPEED_SCALE, CURRENT = slice(0, 2), 2, 3, slice(4, 6)
RANGE_SCALE, RANGE_BIAS, PSEUDO_BIAS, CLOCK, CLOCK_DRIFT, STAMP, STAMP_DRIFT = range(6, 13)
"""Slots of a carrier; heading, stamp and its drift are counted from the gauge's."""
LOG_BIAS, LOG_SCALE, LOG_AZIMUTH, LOG_TIME, LOG_DRIFT = range(5)
"""Slots of a source: what its ranges and bearings show too much, how late it stamps its logs now,
and how fast that grows."""
NOTHING = 1e-9
"""Weight of a measurement that is left out."""
SURE = 4.0
"""Variance of a prediction, in that of the noise, up to which the noise says what is far off."""

_QUARTER_TURN = rotation_clockwise(np.pi / 2)
_HOPELESS = 8.0  # sigmas of the prediction: what is so far off is not used at all
_BY_DOF = np.array([1.0, 1.0, 1.19])  # sqrt(chi2) of one and of two dof that are as likely: 2.5, 3
_MOST_STEPS = 4
_BENT = 0.1  # sigmas of a measurement by which a step may miss what its line foretold


class Joint(NamedTuple):
    """What is known of a group.

    Attributes:
        names: of the blocks, `kind/name`.
        mean: (N,) of all slots.
        covariance: (n, n) of the slots that are not known.
        free: (n,) which slots these are.
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array
    free: Indices

    def first(self, name: str) -> int:
        """The first slot of a block."""
        return _offsets(self.names)[name]

    def of(self, slots: Sequence[int] | Indices) -> Array:
        """Covariance (k, k) of slots; zeros where one is known."""
        rows = _rows(self)[np.asarray(slots, dtype=np.intp)]
        whole: Array = self.covariance[rows[:, None], rows]
        known = rows < 0
        whole[known] = whole[:, known] = 0.0
        return whole

    def between(self, slots: Sequence[int] | Indices, others: Sequence[int] | Indices) -> Array:
        """Covariance (k, l) of slots with others; zeros where one is known."""
        rows = _rows(self)
        one, two = rows[np.asarray(slots)], rows[np.asarray(others)]
        whole: Array = self.covariance[one[:, None], two]
        whole[one < 0] = 0.0
        whole[:, two < 0] = 0.0
        return whole


class Rows(NamedTuple):
    """Measurements about a point, whitened.

    Attributes:
        residual: (m,) measured less predicted.
        by: (m, N) derivatives of what is predicted by all slots.
        unit: (m,) number of the measurement each row is of: one or two rows, believed together.
    """

    residual: Array
    by: Array
    unit: Indices


class Foretold(NamedTuple):
    """Measurements as a group expects them.

    Attributes:
        rows: of them.
        linked: (m, n) derivatives by what is not known; tied: (m, n) covariance with that.
        spread: (m, m) covariance of what is predicted, without noise.
    """

    rows: Rows
    linked: Array
    tied: Array
    spread: Array


class Improved(NamedTuple):
    """A group with measurements taken in.

    Attributes:
        joint: after them.
        weight: (u,) by which each measurement was believed; next to nothing = refused.
        residual: (m,) of the rows before; spread: (m, m) its covariance, weights included.
        unit: (m,) measurement of each row.
    """

    joint: Joint
    weight: Array
    residual: Array
    spread: Array
    unit: Indices

    @property
    def refused(self) -> NDArray[np.bool_]:
        """(u,) whether each measurement was left out."""
        return np.asarray(self.weight < 10 * NOTHING)

    def misclosure(self, units: Sequence[int]) -> tuple[float, int]:
        """Chi2 of some measurements that were not left out, and its degrees of freedom."""
        used = np.isin(self.unit, units) & ~self.refused[self.unit]
        which = np.flatnonzero(used)
        residual = self.residual[which]
        chi2 = residual @ np.linalg.solve(self.spread[np.ix_(which, which)], residual)
        return float(chi2), len(which)


@lru_cache(maxsize=512)
def _offsets(names: tuple[str, ...]) -> dict[str, int]:
    starts = np.cumsum([0, *(SIZES[name.partition("/")[0]] for name in names)]).tolist()
    return dict(zip(names, starts, strict=False))


def _rows(joint: Joint) -> Indices:
    """(N,) row of each slot in the covariance; -1 where it is known."""
    rows = np.full(len(joint.mean), -1, dtype=np.intp)
    rows[joint.free] = np.arange(len(joint.free))
    return rows


def place_among_free(joint: Joint, slot: int) -> int:
    """Row of a slot in the covariance; -1 where it is known."""
    return int(_rows(joint)[slot])


NOBODY = Joint((), np.zeros(0), np.zeros((0, 0)), np.zeros(0, dtype=np.intp))


def joined(
    joint: Joint,
    name: str,
    mean: Array,
    by_known: Array,
    covariance: Array,
    wandering: Sequence[int] = (),
) -> Joint:
    """A group with one block more.

    Args:
        mean: (k,) of the block.
        by_known: (k, N) how its error follows from those of the slots there are.
        covariance: (k, k) of the rest of its error.
        wandering: slots of the block that are known now, but will not stay so.
    """
    linked = by_known[:, joint.free]
    tied = linked @ joint.covariance
    block = tied @ linked.T + covariance
    unsure = np.diag(block) > 0
    unsure[list(wandering)] = True
    free = np.flatnonzero(unsure)
    whole = np.block([[joint.covariance, tied[free].T], [tied[free], block[np.ix_(free, free)]]])
    return Joint(
        names=(*joint.names, name),
        mean=np.concatenate([joint.mean, mean]),
        covariance=whole,
        free=np.concatenate([joint.free, len(joint.mean) + free]),
    )


def without(joint: Joint, gone: Sequence[str]) -> Joint:
    """A group without some blocks; what they have taught of the others stays."""
    leaving = set(gone)
    if not leaving & set(joint.names):
        return joint
    stays = np.ones(len(joint.mean), dtype=np.bool_)
    for name in joint.names:
        if name in leaving:
            first = joint.first(name)
            stays[first : first + SIZES[name.partition("/")[0]]] = False
    kept = np.flatnonzero(stays[joint.free])
    place = np.cumsum(stays) - 1
    return Joint(
        names=tuple(name for name in joint.names if name not in leaving),
        mean=joint.mean[stays],
        covariance=joint.covariance[np.ix_(kept, kept)],
        free=place[joint.free[kept]].astype(np.intp),
    )


def part(joint: Joint, names: Sequence[str]) -> Joint:
    """Some blocks alone."""
    slots = [range(joint.first(n), joint.first(n) + SIZES[n.partition("/")[0]]) for n in names]
    which = np.array([slot for block in slots for slot in block], dtype=np.intp)
    rows = _rows(joint)[which]
    free = np.flatnonzero(rows >= 0)
    covariance = joint.covariance[np.ix_(rows[free], rows[free])]
    return Joint(tuple(names), joint.mean[which], covariance, free)


def transformed(
    joint: Joint, mean: Array, out: Sequence[int], into: Sequence[int], by: Array, noise: Array
) -> Joint:
    """A group after some slots have become a function of some.

    Args:
        mean: (N,) after it.
        out: (k,) slots that change.
        into: (l,) slots they depend on, themselves included where they do.
        by: (k, l) derivatives; noise: (k, k) what is added.
    """
    rows = _rows(joint)
    target, source = rows[list(out)], rows[list(into)]
    changed, used = np.flatnonzero(target >= 0), np.flatnonzero(source >= 0)
    target, source = target[changed], source[used]
    step = by[changed[:, None], used]
    tied = step @ joint.covariance[source]
    covariance = joint.covariance.copy()
    covariance[target] = tied
    covariance[:, target] = tied.T
    own = tied[:, source] @ step.T + noise[changed[:, None], changed]
    covariance[target[:, None], target] = (own + own.T) / 2
    return joint._replace(mean=mean, covariance=covariance)


def improved(joint: Joint, rows_at: Callable[[Array], Rows]) -> Improved:
    """A group with measurements taken in, linearised again where they turn out to be bent.

    A measurement is believed less the further it lies from its prediction, by Huber's weight of its
    distance in sigmas; where the prediction is sure, by weights that taper to nothing beyond 4.5.

    Args:
        rows_at: the measurements about any mean (N,).
    """
    first = foretold(joint, rows_at(joint.mean))
    return weighed(joint, rows_at, first, weights(first))


def weighed(
    joint: Joint, rows_at: Callable[[Array], Rows], first: Foretold, weight: Array
) -> Improved:
    """The same with weights (u,) of the measurements, as foretold about the mean there is."""
    start = mean = joint.mean
    rows, linked, tied, spread = first
    noise = np.diag(1 / weight[rows.unit])
    for _ in range(_MOST_STEPS):
        root = np.linalg.cholesky(spread + noise)
        moved = mean[joint.free] - start[joint.free]
        innovation = rows.residual + linked @ moved
        half = np.linalg.solve(root, tied)
        there = start.copy()
        there[joint.free] += half.T @ np.linalg.solve(root, innovation)
        promised = rows.residual - linked @ (there[joint.free] - mean[joint.free])
        mean, rows = there, rows_at(there)
        believed = np.sqrt(weight[rows.unit])
        if np.max(np.abs(rows.residual - promised) * believed, initial=0.0) < _BENT:
            break
        _, linked, tied, spread = foretold(joint, rows)
    covariance = joint.covariance - half.T @ half
    after = joint._replace(mean=mean, covariance=(covariance + covariance.T) / 2)
    return Improved(after, weight, first.rows.residual, first.spread + noise, first.rows.unit)


def foretold(joint: Joint, rows: Rows) -> Foretold:
    """What a group expects of measurements."""
    linked = rows.by[:, joint.free]
    tied = linked @ joint.covariance
    return Foretold(rows, linked, tied, tied @ linked.T)


def weights(first: Foretold) -> Array:
    """(u,) how much each measurement is believed."""
    rows, spread = first.rows, first.spread
    size = np.bincount(rows.unit)
    variance = 1 + np.diag(spread)
    squared = np.bincount(rows.unit, rows.residual**2 / variance)
    unsure = np.zeros(len(size))
    np.maximum.at(unsure, rows.unit, variance - 1)
    for unit in np.flatnonzero(size > 1):
        which = np.flatnonzero(rows.unit == unit)
        own = spread[np.ix_(which, which)] + np.eye(len(which))
        squared[unit] = rows.residual[which] @ np.linalg.solve(own, rows.residual[which])
    distance = np.sqrt(np.maximum(squared, 0.0)) / _BY_DOF[np.minimum(size, 2)]
    believed = np.where(unsure < SURE, tapered(distance)[1], huber(distance)[1])
    return np.asarray(np.maximum(np.where(distance < _HOPELESS, believed, 0.0), NOTHING))


class Step(NamedTuple):
    """What a carrier has reckoned since: along the axes of the scenario, by its own north.

    Attributes:
        seconds: that passed by its clock.
        travel_m: (2,) east, north; covariance: (2, 2) of its independent errors.
        sigma_turn_rad: by which its north may have wandered.
    """

    seconds: float
    travel_m: Array
    covariance: Array
    sigma_turn_rad: float = 0.0


def carried(joint: Joint, steps: Sequence[tuple[str, Step]]) -> Joint:
    """A group after the dead reckoning of some carriers."""
    size, count = SIZES["carrier"], len(steps)
    mean = joint.mean.copy()
    by, noise = np.zeros((5 * count, size * count)), np.zeros((5 * count, 5 * count))
    out: list[int] = []
    into: list[int] = []
    for i, (carrier, step) in enumerate(steps):
        first = joint.first(carrier)
        own = mean[first : first + size]
        there = slice(5 * i, 5 * i + 5)
        by[there, size * i : size * i + size], noise[there, there], moved = _step(own, step)
        out += [first, first + 1, *(first + slot for slot in (HEADING, CLOCK, STAMP))]
        into += range(first, first + size)
        mean[first : first + 2] += moved
        mean[first + CLOCK] += step.seconds * own[CLOCK_DRIFT]
        mean[first + STAMP] += step.seconds * own[STAMP_DRIFT]
    return transformed(joint, mean, out, into, by, noise)


def _step(own: Array, step: Step) -> tuple[Array, Array, Array]:
    """Derivatives (5, 13) of place, heading and clocks after a step, noise (5, 5), way (2,)."""
    turn = rotation_clockwise(own[HEADING])
    turned, dt = turn @ step.travel_m, step.seconds
    travel = (1 + own[SPEED_SCALE]) * turned
    by = np.zeros((5, len(own)))
    by[:2, PLACE] = np.eye(2)
    by[:2, HEADING] = _QUARTER_TURN @ travel
    by[:2, SPEED_SCALE] = turned
    by[:2, CURRENT] = dt * np.eye(2)
    by[2, HEADING] = by[3, CLOCK] = by[4, STAMP] = 1.0
    by[3, CLOCK_DRIFT] = by[4, STAMP_DRIFT] = dt
    noise = np.zeros((5, 5))
    noise[:2, :2] = turn @ step.covariance @ turn.T
    noise[2, 2] = step.sigma_turn_rad**2
    return by, noise, travel + dt * own[CURRENT]


def velocity_mps(joint: Joint, carrier: str, reckoned_mps: Array) -> Array:
    """(2,) of a carrier over ground, from what it reckons along the axes of the scenario."""
    first = joint.first(carrier)
    own = joint.mean[first : first + SIZES["carrier"]]
    turned = rotation_clockwise(own[HEADING]) @ reckoned_mps
    over: Array = (1 + own[SPEED_SCALE]) * turned + own[CURRENT]
    return over


def aged(joint: Joint, sources: Sequence[str], seconds: float) -> Joint:
    """A group after the clocks of some sources have run on."""
    late = [joint.first(source) + LOG_TIME for source in sources]
    drift = [joint.first(source) + LOG_DRIFT for source in sources]
    mean, eye = joint.mean.copy(), np.eye(len(late))
    mean[late] += seconds * mean[drift]
    by = np.hstack([eye, seconds * eye])
    return transformed(joint, mean, late, [*late, *drift], by, np.zeros_like(eye))


def moved_targets(joint: Joint, seconds: Mapping[str, float], noise_m2ps3: float) -> Joint:
    """A group after some targets have gone on, their velocities wandering."""
    mean, count = joint.mean.copy(), len(seconds)
    by, noise = np.zeros((4 * count, 4 * count)), np.zeros((4 * count, 4 * count))
    slots: list[int] = []
    for i, (target, passed_s) in enumerate(seconds.items()):
        first, there = joint.first(target), slice(4 * i, 4 * i + 4)
        by[there, there] = np.eye(4) + passed_s * np.eye(4, k=2)
        noise[there, there] = wandered(abs(passed_s), noise_m2ps3)
        mean[first : first + 2] += passed_s * mean[first + 2 : first + 4]
        slots += range(first, first + 4)
    return transformed(joint, mean, slots, slots, by, noise)


def wandered(seconds: float, noise_m2ps3: float) -> Array:
    """(4, 4) what white acceleration adds to place and velocity."""
    eye = noise_m2ps3 * np.eye(2)
    cross = seconds**2 / 2 * eye
    return np.block([[seconds**3 / 3 * eye, cross], [cross, seconds * eye]])


def manoeuvred(joint: Joint, target: str, seconds: float, noise_m2ps3: float) -> Joint:
    """A group in which a target may have turned in the last seconds."""
    slots = range(joint.first(target), joint.first(target) + 4)
    added = wandered(seconds, noise_m2ps3)
    return transformed(joint, joint.mean, slots, slots, np.eye(4), added)
