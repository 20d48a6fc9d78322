"""How probable each range is under one motion, by the profile of its posterior.

A Gaussian in 1 / range knows a minimum and how it is curved there. Of a motion that turns that is
too little: the turn may lie between any two bearings, and each place may have a minimum of its own.
So at a few ranges about the minimum the best parameters are asked for that have this range. The
root of what they cost more than the minimum, negative below it, is standard normal where the
posterior is Gaussian in whatever parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.criterion import Criterion
from estimation.bearings_only.estimate import Estimate, inverse_range_at
from estimation.bearings_only.fitting import taken
from estimation.bearings_only.levenberg_marquardt import Minimum, minimised
from estimation.bearings_only.profile import Held

_ASKED = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])  # sigmas from the minimum
_FAR = 9.0  # sigmas to which the last slope, or this least one, is drawn on
_LEAST_SLOPE = 0.5
_SIGMAS = np.array([-_FAR, *_ASKED[:3], 0.0, *_ASKED[3:], _FAR])
_STARTS = 2  # of each descent to a range, from as many ends
_STEPS, _SETTLED = 8, 1e-2
_FIRM = 0.01  # sigmas: how firmly 1 / range is held where it is asked for
_SLIPPED = 0.1  # sigmas: what has gone farther astray says nothing


class Roots(NamedTuple):
    """Signed roots of the cost along 1 / range; between those that are asked for it is straight.

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

    Source: S. Wilks, Annals of Mathematical Statistics 9 (1938), 60-62.
    """
    problem = searched.problem.take(columns)
    lines = [_line(problem, taken(end, columns)) for end in searched.ends]
    every = _Line(*(np.stack(parts) for parts in zip(*lines, strict=True)))
    own = np.arange(len(columns))
    best, sigma, least = (part[rank, own] for part in (every.value, every.sigma, every.cost))
    cost = _least(problem, best + _ASKED[:, None] * sigma, sigma, every)
    more = np.sqrt(np.maximum(cost - least, 0.0))
    more = np.where(np.isfinite(more), more, np.abs(_ASKED)[:, None])
    middle = len(_ASKED) // 2
    below, above = (_drawn_on(side) for side in (more[:middle][::-1], more[middle:]))
    return Roots(_SIGMAS, np.concatenate([-below[::-1], np.zeros_like(best)[None], above]))


def _drawn_on(side: Array) -> Array:
    """Roots from the minimum outward, never falling, and one far away."""
    side = np.maximum.accumulate(side, axis=0)
    slope = np.maximum(side[-1] - side[-2], _LEAST_SLOPE)
    return np.concatenate([side, (side[-1] + slope * (_FAR - _ASKED[-1]))[None]])


class _Line(NamedTuple):
    """An end, and the straight line along which its parameters go with 1 / range.

    Attributes:
        value, sigma: of 1 / range (B,); cost: (B,).
        p, along: (M, B) parameters there, and their change by 1 / range.
    """

    value: Array
    sigma: Array
    cost: Array
    p: Array
    along: Array


def _line(problem: Criterion, end: Minimum) -> _Line:
    cost, matrix = end.normal.cost, end.normal.matrix
    here = Estimate(problem.scene, problem.motion, end.p, matrix, cost, end.converged)
    value, by = inverse_range_at(problem.scene, problem.motion, end.p)
    turned = np.einsum("mnb,nb->mb", here.covariance, by)
    variance = np.maximum(np.einsum("mb,mb->b", by, turned), 1e-290)
    return _Line(value, np.sqrt(variance), cost, end.p, turned / variance)


def _least(problem: Criterion, at: Array, sigma: Array, lines: _Line) -> Array:
    """The least cost (K, B) where 1 / range is `at` (K, B); inf where none is found.

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
    least: Array = np.nan_to_num(cost, nan=np.inf).reshape(-1, *at.shape).min(axis=0)
    return least
