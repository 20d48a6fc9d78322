"""How probable each range is under one motion, all else integrated out.

A Gaussian in 1 / range knows a minimum and how it is curved there. Of a motion that turns that is
too little: the turn may lie between any two bearings, and each place may have a minimum of its own.
So at a few ranges about the minimum the best parameters are asked for that have this range: what
they cost, and how much room there is about them, for far away more velocities fit the same
bearings. The root of what they cost more than the minimum, negative below it, and the logarithm of
that room are straight between the ranges that are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from estimation.arrays import Array
from estimation.bearings_only.criterion import Criterion
from estimation.bearings_only.estimate import Estimate, inverse_range_at
from estimation.bearings_only.fitting import taken
from estimation.bearings_only.levenberg_marquardt import Minimum, minimised
from estimation.bearings_only.linear_algebra import cholesky, log_determinant
from estimation.bearings_only.prior import MotionPrior, prior_rows, volume
from estimation.bearings_only.profile import Held

_ASKED = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])  # sigmas from the minimum
_FAR = 9.0  # sigmas to which the last slope, or this least one, is drawn on
_LEAST_SLOPE = 0.5
_SIGMAS = np.array([-_FAR, *_ASKED[:3], 0.0, *_ASKED[3:], _FAR])
_FINE, _NOTHING = 145, 1e-300  # places where the density is summed; its least sum
_STARTS = 2  # of each descent to a range, from as many ends
_STEPS, _SETTLED = 8, 1e-2
_FIRM = 0.01  # sigmas: how firmly 1 / range is held where it is asked for
_SLIPPED = 0.1  # sigmas: what has gone farther astray says nothing


class Roots(NamedTuple):
    """Standard normal quantiles along 1 / range; straight between those that are given.

    Attributes:
        sigmas: (K,) 1 / range less that of the minimum, in sigmas.
        root: (K, B) or (K,), never falling.
    """

    sigmas: Array
    root: Array


class Searched(NamedTuple):
    """One motion of all targets: what was minimised, and the ends of all descents."""

    problem: Criterion
    ends: Sequence[Minimum]


NORMAL = Roots(np.array([-_FAR, _FAR]), np.array([-_FAR, _FAR]))
"""Of a Gaussian."""


def roots(searched: Searched, rank: NDArray[np.int_], columns: NDArray[np.int_]) -> Roots:
    """About some of the ends, given by rank (B,) and target (B,).

    The other ends count too, as valleys beside these. Where no parameters have a range, as beyond
    infinity, the root is that of a Gaussian.

    Source: L. Tierney & J. Kadane, Journal of the American Statistical Association 81 (1986),
        82-86, section 4: marginal densities by Laplace's method.
    """
    problem = searched.problem.take(columns)
    lines = [_line(problem, taken(end, columns)) for end in searched.ends]
    every = _Line(*(np.stack(parts) for parts in zip(*lines, strict=True)))
    own = np.arange(len(columns))
    best, sigma, least, room = (part[rank, own] for part in every[:4])
    cost, rooms = _least(problem, best + _ASKED[:, None] * sigma, sigma, every)
    more = np.sqrt(np.maximum(cost - least, 0.0))
    rooms = np.where(np.isfinite(more), rooms - room, np.nan)
    more = np.where(np.isfinite(more), more, np.abs(_ASKED)[:, None])
    middle = len(_ASKED) // 2
    below, above = (_drawn_on(side) for side in (more[:middle][::-1], more[middle:]))
    nearer, farther = (_held_on(side) for side in (rooms[middle:], rooms[:middle][::-1]))
    none = np.zeros_like(best)[None]
    root = np.concatenate([-below[::-1], none, above])
    return Roots(_SIGMAS, _quantiles(root, np.concatenate([farther[::-1], none, nearer])))


def _drawn_on(side: Array) -> Array:
    """Roots from the minimum outward, never falling, and one far away."""
    side = np.maximum.accumulate(side, axis=0)
    slope = np.maximum(side[-1] - side[-2], _LEAST_SLOPE)
    return np.concatenate([side, (side[-1] + slope * (_FAR - _ASKED[-1]))[None]])


def _held_on(side: Array) -> Array:
    """Rooms from the minimum outward, the last one kept where none is known, and far away."""
    held = [np.zeros_like(side[0])]
    for room in side:
        held.append(np.where(np.isfinite(room), room, held[-1]))
    return np.stack([*held[1:], held[-1]])


def _quantiles(root: Array, room: Array) -> Array:
    """Standard normal quantiles (K, B) at `_SIGMAS` of the density exp(room - root^2 / 2)."""
    fine = np.linspace(-_FAR, _FAR, _FINE)
    after = np.clip(np.searchsorted(_SIGMAS, fine), 1, len(_SIGMAS) - 1)
    share = (fine - _SIGMAS[after - 1]) / (_SIGMAS[after] - _SIGMAS[after - 1])
    root, room = (
        part[after - 1] + share[:, None] * (part[after] - part[after - 1]) for part in (root, room)
    )
    density = np.exp(room - root**2 / 2)
    pieces = np.pad((density[1:] + density[:-1]) / 2, ((1, 1), (0, 0)))
    at = np.searchsorted(fine, _SIGMAS)
    below = np.cumsum(pieces, axis=0)[at]
    above = np.cumsum(pieces[::-1], axis=0)[::-1][at + 1]
    tail = ndtri(np.maximum(np.minimum(below, above) / (below + above), _NOTHING))
    quantiles: Array = np.maximum.accumulate(np.where(below < above, tail, -tail), axis=0)
    return quantiles


class _Line(NamedTuple):
    """An end, and the straight line along which its parameters go with 1 / range.

    Attributes:
        value, sigma: of 1 / range (B,); cost: (B,).
        room: (B,) about it, as of `_room`.
        p, along: (M, B) parameters there, and their change by 1 / range.
    """

    value: Array
    sigma: Array
    cost: Array
    room: Array
    p: Array
    along: Array


def _line(problem: Criterion, end: Minimum) -> _Line:
    cost, matrix = end.normal.cost, end.normal.matrix
    here = Estimate(problem.scene, problem.motion, end.p, matrix, cost, end.converged)
    value, by = inverse_range_at(problem.scene, problem.motion, end.p)
    turned = np.einsum("mnb,nb->mb", here.covariance, by)
    variance = np.maximum(np.einsum("mb,mb->b", by, turned), 1e-290)
    sigma = np.sqrt(variance)
    return _Line(value, sigma, cost, _room(problem, end, sigma), end.p, turned / variance)


def _room(problem: Criterion, end: Minimum, sigma: Array) -> Array:
    """Logarithm (B,) of the room across 1 / range: what is left of the prior's volume.

    Held within sigma there, |J'J| is |J'J| of what is across by sigma squared.
    """
    rows = prior_rows(problem.scene, problem.motion, problem.prior or MotionPrior(), end.p)
    before = volume(problem.scene, problem.motion, rows, end.p)
    h = problem.gauge(end.p)
    gauge = h[:, None] * h[None, :]
    left = log_determinant(cholesky(before + gauge))
    left -= log_determinant(cholesky(end.normal.matrix + gauge))
    return left / 2 - np.log(sigma)


def _least(problem: Criterion, at: Array, sigma: Array, lines: _Line) -> tuple[Array, Array]:
    """The least cost (K, B) where 1 / range is `at` (K, B), inf where none is found; and the room.

    Begun from those ends from which least is to be expected.
    """
    away = at - lines.value[:, None]
    expected = np.nan_to_num(lines.cost[:, None] + (away / lines.sigma[:, None]) ** 2, nan=np.inf)
    chosen = np.argsort(expected, axis=0, kind="stable")[:_STARTS]
    targets = np.arange(at.shape[1])
    from_end, along = (np.moveaxis(part, 1, 2)[chosen, targets] for part in (lines.p, lines.along))
    starts = from_end + along * np.take_along_axis(away, chosen, axis=0)[..., None]
    columns = np.tile(targets, len(chosen) * len(at))
    free, firm = problem.take(columns), _FIRM * sigma[columns]
    wanted = np.broadcast_to(at, (len(chosen), *at.shape)).ravel()
    start = starts.reshape(-1, starts.shape[-1]).T
    end = minimised(Held(free, wanted, firm), start, _STEPS, _SETTLED)
    off = (inverse_range_at(free.scene, free.motion, end.p)[0] - wanted) / firm
    cost = np.where(np.abs(off) < _SLIPPED / _FIRM, end.normal.cost - off**2, np.inf)
    cost = np.nan_to_num(cost, nan=np.inf)
    least = cost.reshape(-1, at.size).argmin(axis=0) * at.size + np.arange(at.size)
    room = _room(free.take(least), taken(end, least), firm[least])
    return cost[least].reshape(at.shape), room.reshape(at.shape)
