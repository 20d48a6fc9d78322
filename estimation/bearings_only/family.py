"""A target of unknown motion: every motion of a family with its posterior weight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.criterion import Criterion, criterion
from estimation.bearings_only.doubt import FrameDoubt, lessened
from estimation.bearings_only.estimate import Estimate, InverseRange
from estimation.bearings_only.fitting import (
    BRISK,
    THOROUGH,
    Search,
    begun,
    distinct,
    ends,
    grid_of,
    taken,
)
from estimation.bearings_only.linear_algebra import cholesky, log_determinant
from estimation.bearings_only.marginal import Searched
from estimation.bearings_only.measurements import Scene
from estimation.bearings_only.motions import FAMILY, THREE_LEGS, Motion
from estimation.bearings_only.normal_equations import Loss, products, residuals
from estimation.bearings_only.prior import MotionPrior, prior_rows, volume
from estimation.bearings_only.robust import kept, screened

_SECOND_ANGLES = (-1.6, -0.9, -0.4, 0.4, 0.9, 1.6)
_SECOND_MIDDLES = (-0.8, -0.55, -0.3, -0.05, 0.2, 0.45, 0.7)
_SECOND_LOG_DURATION = -1.9  # of half spans


class Hypothesis(NamedTuple):
    """One motion at a maximum of its posterior, of some of the targets.

    Attributes:
        columns: (B,) the targets that it is of.
        estimate: parameters and what bearings and prior say of them.
        log_evidence: (B,) logarithm of the odds of this motion times the probability of the
            bearings under it, but for a constant of all motions; -inf where it found no end.
        dof: (B,) bearings that count less the parameters that they, not the prior, determine.
        aided: 1 / range at the last bearing.
        alone: the same with the sigma as if the prior said nothing of metres.
        searched, rank: of which descents it is an end, and which end.
    """

    columns: NDArray[np.int_]
    estimate: Estimate
    log_evidence: Array
    dof: Array
    aided: InverseRange
    alone: InverseRange
    searched: Searched
    rank: int


def hypotheses(
    scene: Scene,
    prior: MotionPrior,
    motions: Sequence[Motion] = FAMILY,
    loss: Loss | None = None,
    doubt: FrameDoubt | None = None,
) -> list[Hypothesis]:
    """Every motion fitted to every target; of a motion as many as there are minima."""
    problems = [criterion(scene, motion, prior, loss) for motion in motions]
    clean = screened(scene, loss)
    return [
        found
        for problem in problems
        for found in modes(problem, grid_of(problem.motion), clean, doubt=doubt)
    ]


def three_legs(
    scene: Scene,
    prior: MotionPrior,
    first: Array | None,
    loss: Loss | None = None,
    doubt: FrameDoubt | None = None,
) -> list[Hypothesis]:
    """Two turns: from a grid, and from the one turn (3, B) that was found before."""
    common = grid_of(THREE_LEGS)
    grid = np.broadcast_to(common, (*common.shape[:2], scene.targets))
    if first is not None:
        grid = np.concatenate([grid, second_turns(first)], axis=1)
    problem = criterion(scene, THREE_LEGS, prior, loss)
    return modes(problem, grid, screened(scene, loss), THOROUGH, doubt)


def modes(
    problem: Criterion,
    grid: Array,
    clean: Scene,
    search: Search = BRISK,
    doubt: FrameDoubt | None = None,
) -> list[Hypothesis]:
    """The posterior maxima of one motion, the highest of every target first.

    Turns at quite different times may explain the same bearings, at different ranges.
    """
    found = ends(problem, begun(problem, grid, clean), search)
    everyone = np.arange(problem.scene.targets)
    ranked = [(0, everyone)] + [(k, distinct(problem, found, k)) for k in range(1, len(found))]
    searched = Searched(problem, found)
    return [hypothesis(searched, rank, columns, doubt) for rank, columns in ranked if len(columns)]


def hypothesis(
    searched: Searched, rank: int, columns: NDArray[np.int_], doubt: FrameDoubt | None = None
) -> Hypothesis:
    """A maximum of the posterior of one motion and its evidence by Laplace's approximation.

    Around the maximum the posterior is taken as Gaussian, log E = -cost / 2 + log |P| / 2 -
    log |P + J'J| / 2 with P the information of the prior, all of it in homogeneous coordinates,
    where the bearings are nearly linear.

    Source: D. MacKay, Information Theory, Inference and Learning Algorithms, chapter 28.
    """
    problem, end = searched.problem.take(columns), taken(searched.ends[rank], columns)
    prior = problem.prior or MotionPrior()
    rows = prior_rows(problem.scene, problem.motion, prior, end.p)
    before = volume(problem.scene, problem.motion, rows, end.p)
    of_bearings = problem.of_bearings(end.p)
    h = problem.gauge(end.p)
    gauge = h[:, None] * h[None, :]
    log_evidence = (
        -end.normal.cost
        + log_determinant(cholesky(before + gauge))
        - log_determinant(cholesky(end.normal.matrix + gauge))
    ) / 2
    shapes = rows.of_shape()
    unaided = of_bearings.matrix + products(shapes.residual, shapes.jacobian)[1]
    chi2, counted = of_bearings.cost, problem.scene.seen.astype(float)
    if problem.loss is not None:
        residual, _ = residuals(problem.scene, problem.motion, end.p)
        chi2, counted = kept(residual, problem.scene.weight)
    estimate = Estimate(
        problem.scene, problem.motion, end.p, end.normal.matrix, chi2, end.converged
    )
    effective = np.einsum("ijb,jib->b", estimate.covariance, of_bearings.matrix)
    ok = np.isfinite(log_evidence)
    dof = np.maximum(counted - np.nan_to_num(effective), 1e-3)
    if doubt is not None:
        unaided, told = (
            lessened(of, problem.scene, problem.motion, end.p, doubt.take(columns))
            for of in (unaided, estimate.information)
        )
        estimate = estimate._replace(information=told)
    alone = estimate._replace(information=unaided).inverse_range()
    log_evidence = np.where(ok, log_evidence + np.log(problem.motion.odds), -np.inf)
    aided = estimate.inverse_range()
    return Hypothesis(columns, estimate, log_evidence, dof, aided, alone, searched, rank)


def second_turns(first: Array) -> Array:
    """Shapes (6, G, B) of two turns, one of them as found (angle, middle, log duration; (3, B))."""
    angles, middles = np.meshgrid(_SECOND_ANGLES, _SECOND_MIDDLES)
    count, many = angles.size, first.shape[1]
    second = np.stack([angles.ravel(), middles.ravel(), np.full(count, _SECOND_LOG_DURATION)])
    second = np.broadcast_to(second[:, :, None], (3, count, many))
    known = np.broadcast_to(first[:, None], (3, count, many))
    before = second[1] < known[1]
    return np.concatenate([np.where(before, second, known), np.where(before, known, second)])
