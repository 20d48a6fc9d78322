"""Ranges, target logs and fixes as whitened rows about any mean of a joint state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from estimation.arrays import Array, Indices, transposed
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.joint_navigation.members import QUARTER_TURN, Sighting, lateness
from estimation.joint_navigation.online import (
    CLOCK,
    HEADING,
    LOG_AZIMUTH,
    LOG_BIAS,
    LOG_SCALE,
    LOG_TIME,
    NORTH,
    PSEUDO_BIAS,
    RANGE_BIAS,
    RANGE_SCALE,
    STAMP,
    Joint,
    Rows,
)

RowsAt = Callable[[Array], Rows]
LINK = "link/"
_LEAST_M = 1e-3


class Range(NamedTuple):
    """One range: who measured, to whom, of a difference less the range to whom.

    Attributes:
        carrier, peer, reference: blocks, or names of surveyed beacons; reference empty: none.
    """

    carrier: str
    peer: str
    kind: Literal["two_way", "pseudorange", "difference"]
    value_m: float
    sigma_m: float
    reference: str = ""


def link_of(log: Range) -> str:
    """Block of the constant error of all ranges between the same ends."""
    return LINK + "|".join((log.carrier, log.peer, log.reference, log.kind))


class Surroundings(NamedTuple):
    """What is known of an instant beside the state.

    Attributes:
        height_m: of each carrier, from the pivot.
        velocity_mps: (2,) of each carrier over ground.
        surveyed_m: (3,) of each beacon that is known, from the pivot along the scenario's axes.
    """

    height_m: Mapping[str, float]
    velocity_mps: Mapping[str, Array]
    surveyed_m: Mapping[str, Array]


class _Legs(NamedTuple):
    """Distances that ranges are made of, L of them: one of a range, two of a difference.

    Attributes:
        row, sign: of which range, added or taken away.
        own: first slot of the carrier; own_height.
        node: first slot of the other end, -1 where it is surveyed; kind: 0 carrier, 1 beacon, 2
            surveyed; place: (L, 3) where surveyed, a carrier's height in the third.
        velocity: (L, 2) of the other end.
    """

    row: Indices
    sign: Array
    own: Indices
    own_height: Array
    node: Indices
    kind: Indices
    place: Array
    velocity: Array


def range_rows(joint: Joint, ranges: Sequence[Range], there: Surroundings) -> RowsAt:
    """Rows of ranges taken at one instant."""
    legs = _legs(joint, ranges, there)
    own = np.array([joint.first(r.carrier) for r in ranges], dtype=np.intp)
    clocked = np.flatnonzero([r.kind == "pseudorange" for r in ranges])
    two_way = np.flatnonzero([r.kind == "two_way" for r in ranges])
    clocks = [r.kind == "pseudorange" and r.peer in there.height_m for r in ranges]
    peered = np.flatnonzero(clocks)
    peer = np.array([joint.first(ranges[int(i)].peer) for i in peered], dtype=np.intp)
    longer, variance = _bend(joint, legs, len(ranges))
    links = {i: joint.first(link_of(r)) for i, r in enumerate(ranges) if link_of(r) in joint.names}
    linked, link = (np.array(list(part), dtype=np.intp) for part in (links, links.values()))
    sigma = np.sqrt(np.array([r.sigma_m for r in ranges]) ** 2 + variance)
    value = np.array([r.value_m for r in ranges]) - longer

    def rows(mean: Array) -> Rows:
        by, distance = _distances(mean, legs, len(ranges))
        at = np.arange(len(ranges))
        scale = 1 + mean[own + RANGE_SCALE]
        by *= scale[:, None]
        by[at, own + RANGE_SCALE] += distance
        predicted = scale * distance
        for which, slots, sign in (
            (two_way, own[two_way] + RANGE_BIAS, 1.0),
            (clocked, own[clocked] + PSEUDO_BIAS, 1.0),
            (clocked, own[clocked] + CLOCK, 1.0),
            (peered, peer + CLOCK, -1.0),
            (linked, link, 1.0),
        ):
            by[which, slots] += sign
            predicted[which] += sign * mean[slots]
        return Rows((value - predicted) / sigma, by / sigma[:, None], at)

    return rows


def _legs(joint: Joint, ranges: Sequence[Range], there: Surroundings) -> _Legs:
    told = []
    for row, log in enumerate(ranges):
        for node, sign in ((log.peer, 1.0), (log.reference, -1.0)):
            if node:
                own = joint.first(log.carrier), there.height_m[log.carrier]
                told.append((row, sign, *own, *_end(joint, node, there)))
    row, sign, own_slot, height, slot, kind, *rest = np.array(told, dtype=float).T
    whole = (column.astype(np.intp) for column in (row, own_slot, slot, kind))
    r, o, s, k = whole
    return _Legs(r, sign, o, height, s, k, np.array(rest[:3]).T, np.array(rest[3:]).T)


def _end(joint: Joint, node: str, there: Surroundings) -> tuple[float, ...]:
    """Slot, kind, place and velocity of the other end of a range."""
    if node in there.surveyed_m:
        return (-1, 2, *there.surveyed_m[node], 0.0, 0.0)
    if node in there.height_m:
        velocity = there.velocity_mps[node]
        return (joint.first(node), 0, 0.0, 0.0, there.height_m[node], *velocity)
    return (joint.first(node), 1, 0.0, 0.0, 0.0, 0.0, 0.0)


def _sights(mean: Array, legs: _Legs) -> Array:
    """(L, 3) from the other ends to the carriers."""
    own = np.column_stack([mean[legs.own], mean[legs.own + 1], legs.own_height])
    end = legs.place.copy()
    known = legs.kind == 2
    end[known, :2] = legs.place[known, :2] @ rotation_clockwise(-mean[NORTH]).T
    moving, beacon = legs.kind == 0, legs.kind == 1
    later = mean[legs.node[moving] + STAMP] - mean[legs.own[moving] + STAMP]
    for axis in range(2):
        end[moving, axis] = mean[legs.node[moving] + axis] + later * legs.velocity[moving, axis]
    for axis in range(3):
        end[beacon, axis] = mean[legs.node[beacon] + axis]
    return np.asarray(own - end)


def _distances(mean: Array, legs: _Legs, count: int) -> tuple[Array, Array]:
    """Derivatives (m, N) of the sums of distances, and these (m,)."""
    sight = _sights(mean, legs)
    distance = np.maximum(np.sqrt(np.sum(sight**2, axis=1)), _LEAST_M)
    unit = legs.sign[:, None] * sight / distance[:, None]
    by = np.zeros((count, len(mean)))
    total = np.zeros(count)
    np.add.at(total, legs.row, legs.sign * distance)
    moving, beacon, known = (np.flatnonzero(legs.kind == kind) for kind in range(3))
    for axis in range(2):
        np.add.at(by, (legs.row, legs.own + axis), unit[:, axis])
        np.add.at(by, (legs.row[moving], legs.node[moving] + axis), -unit[moving, axis])
    for axis in range(3):
        np.add.at(by, (legs.row[beacon], legs.node[beacon] + axis), -unit[beacon, axis])
    closing = np.sum(unit[moving, :2] * legs.velocity[moving], axis=1)
    np.add.at(by, (legs.row[moving], legs.node[moving] + STAMP), -closing)
    np.add.at(by, (legs.row[moving], legs.own[moving] + STAMP), closing)
    turned = legs.place[known, :2] @ (QUARTER_TURN @ rotation_clockwise(-mean[NORTH])).T
    north = np.full(len(known), NORTH)
    np.add.at(by, (legs.row[known], north), np.sum(unit[known, :2] * turned, axis=1))
    return by, total


def _bend(joint: Joint, legs: _Legs, count: int) -> tuple[Array, Array]:
    """Mean and variance (m,) of the second-order term of ranges, see `second_order` of paper 003.

    With the Hessian H = (I - u u') / r of a range and the covariance C of one end less the other, a
    range is on average tr(H C) / 2 longer than between the means, with a variance tr(H C H C) / 2.
    """
    rows = np.full(len(joint.mean) + 1, len(joint.free), dtype=np.intp)
    rows[joint.free] = np.arange(len(joint.free))
    nowhere = len(joint.mean)
    node = np.where(legs.kind == 2, nowhere, legs.node)
    third = np.where(legs.kind == 1, legs.node + 2, nowhere)
    slots = np.column_stack([legs.own, legs.own + 1, node, np.minimum(node + 1, nowhere), third])
    padded = np.pad(joint.covariance, (0, 1))
    at = rows[slots]
    own = padded[at[:, :, None], at[:, None, :]]
    apart = np.zeros((3, 5))
    apart[0, 0] = apart[1, 1] = 1.0
    apart[0, 2] = apart[1, 3] = apart[2, 4] = -1.0
    covariance = apart @ own @ apart.T
    sight = _sights(joint.mean, legs)
    length = np.maximum(np.sqrt(np.sum(sight**2, axis=1)), 1.0)[:, None, None]
    unit = sight[:, :, None] / length
    bent = (np.eye(3) - unit @ transposed(unit)) @ covariance / length
    longer, variance = np.zeros(count), np.zeros(count)
    np.add.at(longer, legs.row, legs.sign * np.trace(bent, axis1=1, axis2=2) / 2)
    np.add.at(variance, legs.row, np.trace(bent @ bent, axis1=1, axis2=2) / 2)
    return longer, variance


def log_rows(joint: Joint, logs: Sequence[Sighting]) -> RowsAt:
    """Rows of target logs: range, and across it; two a log."""
    spreads = [_unsure_by_time(joint, log) for log in logs]

    def rows(mean: Array) -> Rows:
        parts = [_of_log(joint, mean, log, extra) for log, extra in zip(logs, spreads, strict=True)]
        residual = np.concatenate([part[0] for part in parts])
        by = np.concatenate([part[1] for part in parts])
        return Rows(residual, by, np.repeat(np.arange(len(logs)), 2))

    return rows


def _unsure_by_time(joint: Joint, log: Sighting) -> Array:
    """(2, 2) of what an unknown velocity times an unknown lateness adds to a log."""
    first = joint.first(log.target)
    _, doubt_s2 = lateness(joint, log)
    return doubt_s2 * joint.of([first + 2, first + 3])


def _of_log(joint: Joint, mean: Array, log: Sighting, extra: Array) -> tuple[Array, Array]:
    """Residuals (2,) and derivatives (2, N) of one log, in sigmas."""
    target, own, source = (joint.first(name) for name in (log.target, log.carrier, log.source))
    place, velocity = mean[target : target + 2], mean[target + 2 : target + 4]
    own_late = mean[source + LOG_TIME] - log.after_s
    late = mean[own + STAMP] + own_late
    sight = place - late * velocity - mean[own : own + 2] + own_late * log.carrier_mps
    far = max(float(np.hypot(*sight)), 1.0)
    along, across = sight / far, np.array([sight[1], -sight[0]]) / far
    scale = 1 + mean[source + LOG_SCALE]
    bearing = np.arctan2(*sight) - mean[own + HEADING] + mean[source + LOG_AZIMUTH]
    aside = wrap_pi(np.arctan2(*log.seen_m) - bearing)
    seen_far = max(float(np.hypot(*log.seen_m)), 1.0)
    beyond = seen_far - scale * far - mean[source + LOG_BIAS]
    by_sight = np.stack([scale * along, across])
    by = np.zeros((2, len(mean)))
    by[:, target : target + 2] = by_sight
    by[:, target + 2 : target + 4] = -late * by_sight
    by[:, own : own + 2] = -by_sight
    by[:, own + STAMP] = -by_sight @ velocity
    by[:, source + LOG_TIME] = by_sight @ (log.carrier_mps - velocity)
    by[1, own + HEADING], by[1, source + LOG_AZIMUTH] = -far, far
    by[0, source + LOG_SCALE], by[0, source + LOG_BIAS] = far, 1.0
    ahead = log.seen_m / seen_far
    polar = np.stack([ahead, [ahead[1], -ahead[0]]])
    spread = polar @ log.covariance @ polar.T + by_sight @ extra @ by_sight.T
    root = np.linalg.cholesky(spread)
    residual = np.asarray(np.linalg.solve(root, [beyond, far * aside]), dtype=float)
    return residual, np.asarray(np.linalg.solve(root, by), dtype=float)


def fix_rows(joint: Joint, carrier: str, place_m: Array, covariance: Array) -> RowsAt:
    """Rows of one absolute place (2,), from the pivot along the axes of the scenario."""
    first, root = joint.first(carrier), np.linalg.cholesky(covariance)

    def rows(mean: Array) -> Rows:
        turn = rotation_clockwise(mean[NORTH])
        place = turn @ mean[first : first + 2]
        by = np.zeros((2, len(mean)))
        by[:, first : first + 2] = turn
        by[:, NORTH] = QUARTER_TURN @ place
        residual = np.linalg.solve(root, place_m - place)
        return Rows(residual, np.linalg.solve(root, by), np.zeros(2, dtype=np.intp))

    return rows
