"""One motion fitted to many targets: starts, the descent from the best of them, the lowest end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.criterion import Criterion, criterion
from estimation.bearings_only.estimate import Estimate
from estimation.bearings_only.levenberg_marquardt import SETTLED, Minimum, minimised
from estimation.bearings_only.linear_algebra import inverted
from estimation.bearings_only.measurements import Bearings, Scene, scene_of
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.normal_equations import Loss, Normal
from estimation.bearings_only.prior import prior_rows
from estimation.bearings_only.robust import borne, screened
from estimation.bearings_only.starts import lines_of, misfit, ridge, scales_of, taubin

_RANGE_QUANTILES = (-1.28, 0.0, 1.28)  # of the logarithm, in sigmas: ridge starts
_BLOCK = 512
_APART = 3.0  # sigmas between two minima
_TIMED = 0.2  # half spans: sigma of the middle of a turn that the bearings show
_HOPELESS = 12.0  # of chi-squared: what is so much less likely does not count


class Search(NamedTuple):
    """How hard a minimum is looked for.

    Attributes:
        tried, few: starts from which `few` steps are made.
        kept, many: of these the best, followed for `many` steps at most.
        settled: gain of chi-squared below which a step is the last.
    """

    tried: int = 16
    few: int = 4
    kept: int = 5
    many: int = 30
    settled: float = 1e-3


BRISK, THOROUGH = Search(), Search(tried=48, few=8, kept=8, many=40)
_EXACT = Search(many=40, settled=SETTLED)


def maximum_likelihood(given: Bearings, motion: Motion, loss: Loss | None = None) -> Estimate:
    """The most likely motion of a known kind, targets flattened to B.

    Args:
        given: bearings of one or many targets.
        motion: such as `polynomial(2)`.
        loss: None for Gaussian errors.

    A geometry that determines nothing comes back with a very large sigma, never an exception.
    """
    scene = scene_of(given)
    with np.errstate(all="ignore"):
        ends = [
            _descended(criterion(part, motion, loss=loss))
            for part in (
                scene.take(np.arange(i, min(i + _BLOCK, scene.targets)))
                for i in range(0, scene.targets, _BLOCK)
            )
        ]
    return Estimate(
        scene,
        motion,
        np.concatenate([end.p for end in ends], axis=1),
        np.concatenate([end.normal.matrix for end in ends], axis=2),
        np.concatenate([end.normal.cost for end in ends]),
        np.concatenate([end.converged for end in ends]),
    )


def _descended(problem: Criterion) -> Minimum:
    clean = screened(problem.scene, problem.loss)
    return lowest(problem, begun(problem, grid_of(problem.motion), clean), _EXACT)


def grid_of(motion: Motion) -> Array:
    """The grid (P, G, 1) of a motion; one empty shape when it has none."""
    count = len(motion.shape_names)
    if not count:
        return np.zeros((0, 1, 1))
    return np.array(motion.grid, dtype=float)[..., None]


def begun(problem: Criterion, grid: Array, clean: Scene) -> Array:
    """Starts (T, M, B), the best first: for every shape of a grid (P, G, 1 or B) the best one.

    Each is tried without a range and, when there is a prior, with some.

    Args:
        clean: the scene without gross errors: closed forms know no loss.
    """
    scene, motion, prior = problem.scene, problem.motion, problem.prior
    lines = lines_of(clean, motion, grid)
    starts = [taubin(lines)]
    if prior is not None:
        scales = np.tile(scales_of(scene, motion, prior) + np.zeros(scene.targets), grid.shape[1])
        for quantile in _RANGE_QUANTILES:
            distance = scales[0] * np.exp(quantile * prior.sigma_log_range)
            starts.append(ridge(lines, scales, distance))
    if len(starts) == grid.shape[1] == 1:
        return starts[0][None]
    cost = np.stack([misfit(lines, start) + _before(problem, start) for start in starts])
    cost = np.where(np.isfinite(cost), cost, np.inf)
    every = np.stack(starts)
    if grid.shape[1] > 1:
        kind = np.argmin(cost, axis=0)[None]
        cost = np.take_along_axis(cost, kind, axis=0)
        every = np.take_along_axis(every, kind[:, None], axis=0)
    cost = cost.reshape(-1, scene.targets)
    every = np.swapaxes(every.reshape(len(every), motion.size, -1, scene.targets), 1, 2)
    every = every.reshape(-1, motion.size, scene.targets)
    return np.take_along_axis(every, np.argsort(cost, axis=0)[:, None], axis=0)


def _before(problem: Criterion, p: Array) -> Array:
    """What the prior says against starts (M, C), (C,)."""
    if problem.prior is None:
        return np.zeros(p.shape[1])
    shapes = p.shape[1] // problem.scene.targets
    scene = problem.scene.take(np.tile(np.arange(problem.scene.targets), shapes))
    rows = prior_rows(scene, problem.motion, problem.prior, p).residual
    squared: Array = np.einsum("rc,rc->c", rows, rows)
    return squared


def lowest(problem: Criterion, starts: Array, search: Search = BRISK) -> Minimum:
    """The lowest end of descents from starts (T, M, B): a few steps from many, then the best."""
    return ends(problem, starts, search)[0]


def ends(problem: Criterion, starts: Array, search: Search = BRISK) -> list[Minimum]:
    """All ends of these descents, of each target the lowest first."""
    begin = borne(problem)
    if len(starts) > 1:
        first = _descended_from(begin, starts[: search.tried], search.few, search.settled)
        starts = np.stack([end.p for end in first[: search.kept]])
    if begin is not problem:
        near = _descended_from(begin, starts, search.many, search.settled)
        starts = np.stack([end.p for end in near])
    return _descended_from(problem, starts, search.many, search.settled)


def _descended_from(problem: Criterion, starts: Array, steps: int, settled: float) -> list[Minimum]:
    """Where some steps lead from each start, of each target the lowest first."""
    tries, size, many = starts.shape
    flat = np.moveaxis(starts, 1, 0).reshape(size, tries * many)
    wide = problem if tries == 1 else problem.take(np.tile(np.arange(many), tries))
    end = minimised(wide, flat, steps, settled)
    cost = np.where(np.isfinite(end.normal.cost), end.normal.cost, np.inf).reshape(tries, many)
    order = np.argsort(cost, axis=0)
    return [taken(end, rank * many + np.arange(many)) for rank in order]


def distinct(problem: Criterion, found: Sequence[Minimum], rank: int) -> NDArray[np.int_]:
    """Targets (C,) whose end of this rank is a minimum of its own, and nearly as low as the best.

    It is another when it lies `_APART` sigmas from every lower one, as that sees its surroundings,
    and when the bearings say when its turns are: of one that may be at any time, such as between
    the last two bearings, a Gaussian about the minimum says far too much.
    """
    here, others = found[rank], found[:rank]
    own = here.converged & (here.normal.cost < found[0].normal.cost + _HOPELESS)
    for lower in others:
        apart = here.p - lower.p
        far = np.einsum("mb,mnb,nb->b", apart, lower.normal.matrix, apart) > _APART**2
        own &= far
    columns = np.flatnonzero(own)
    middles = [k for k, name in enumerate(problem.motion.shape_names) if name == "middle"]
    if not middles or not len(columns):
        return columns
    h = problem.gauge(here.p)[:, columns]
    matrix = here.normal.matrix[..., columns]
    trace = np.einsum("iib->b", matrix)
    spread = np.einsum("iib->ib", inverted(matrix + trace * h[:, None] * h[None]))
    timed = spread[problem.motion.scale_row + 1 + np.array(middles)] < _TIMED**2
    shown: NDArray[np.int_] = columns[timed.all(axis=0)]
    return shown


def taken(end: Minimum, columns: NDArray[np.int_]) -> Minimum:
    """Some of the targets of a minimum."""
    normal = Normal(*(part[..., columns] for part in end.normal))
    return Minimum(end.p[:, columns], normal, end.converged[columns])
