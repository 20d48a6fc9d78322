"""Levenberg-Marquardt for many targets at once; a target that has settled is left alone."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.linear_algebra import cholesky, solved
from estimation.bearings_only.normal_equations import Normal

_STEPS = 40
SETTLED = 1e-5  # of chi-squared still to be gained: a step of 3e-3 of a sigma, and it is made
_DAMPING = 1e-3
_HOPELESS = 1e8  # damping


class Problem(Protocol):
    """A criterion over homogeneous parameters of B targets."""

    def evaluate(self, p: Array) -> Normal:
        """Cost, half gradient and J'J at p (M, B)."""

    def admissible(self, p: Array) -> Array:
        """Parameters of unit length, its shape within bounds."""

    def gauge(self, p: Array) -> Array:
        """Directions (M, B) along which nothing changes."""

    def take(self, columns: NDArray[np.int_]) -> Problem:
        """The same for some of the targets."""


class Minimum(NamedTuple):
    """Where the steps ended: parameters (M, B), the criterion there, settled or not (B,)."""

    p: Array
    normal: Normal
    converged: NDArray[np.bool_]


def minimised(
    problem: Problem, start: Array, steps: int = _STEPS, settled: float = SETTLED
) -> Minimum:
    """A local minimum for each target, from start (M, B)."""
    p = problem.admissible(start)
    here = problem.evaluate(p)
    end = Minimum(p.copy(), Normal(*(part.copy() for part in here)), np.zeros(p.shape[1], bool))
    active, damping = np.arange(p.shape[1]), np.full(p.shape[1], _DAMPING)
    for _ in range(steps):
        step, gain = _step(here, problem.gauge(p), damping)
        trial_p = problem.admissible(p + step)
        trial = problem.evaluate(trial_p)
        better = trial.cost <= here.cost
        p = np.where(better, trial_p, p)
        here = trial if better.all() else _chosen(better, trial, here)
        damping = np.where(better, damping * 0.1, damping * 8.0)
        done = (gain < settled) | (damping > _HOPELESS)
        if done.any():
            _store(end, active[done], p[:, done], here, done)
            rest = np.flatnonzero(~done)
            if rest.size == 0:
                return end
            active, p, damping, problem = (
                active[rest],
                p[:, rest],
                damping[rest],
                problem.take(rest),
            )
            here = Normal(*(part[..., rest] for part in here))
    _store(end, active, p, here, np.ones(len(active), dtype=bool))
    end.converged[active] = False
    return end


def _step(here: Normal, gauge: Array, damping: Array) -> tuple[Array, Array]:
    """A damped step, and what it should gain."""
    diagonal = np.einsum("iib->ib", here.matrix)
    damped = here.matrix + diagonal.sum(axis=0) * gauge[:, None] * gauge[None, :]
    np.einsum("iib->ib", damped)[...] += damping * diagonal
    step = -solved(cholesky(damped), here.gradient)
    return step, -np.einsum("mb,mb->b", step, here.gradient)


def _chosen(better: NDArray[np.bool_], trial: Normal, here: Normal) -> Normal:
    return Normal(*(np.where(better, new, old) for new, old in zip(trial, here, strict=True)))


def _store(
    end: Minimum,
    columns: NDArray[np.int_],
    p: Array,
    here: Normal,
    done: NDArray[np.bool_],
) -> None:
    """Note the ends of `columns`; where no step gains anything (a kink) it is a minimum too."""
    end.p[:, columns] = p
    for whole, part in zip(end.normal, here, strict=True):
        whole[..., columns] = part[..., done]
    end.converged[columns] = np.isfinite(here.cost[done])
