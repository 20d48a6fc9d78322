"""Ridges that bend each other: the posterior sampled along them, Gaussian across them.

Where the data leave several directions loose (a straight track with vague beacons, a drift), the
probable constants lie along a curved surface of as many dimensions. Chains of Newton steps walk on
it: each moves along the axes that are loose where it stands, falls back onto the surface across
them, and is taken or not so that in the long run every part is visited by its probability
(Metropolis and Hastings). Jumps to mirror images join what is apart. Every place carries the
Gaussian across the surface, so that a few hundred of them tell all moments.

Sources: Martin, Wilcox, Burstedde, Ghattas, A stochastic Newton MCMC method, SIAM J. Sci. Comput.
34 (2012), the steps; Zappa, Holmes-Cerfon, Goodman, Monte Carlo on manifolds, Comm. Pure Appl.
Math. 71 (2018), why moves along one tangent and back along another need no Jacobian.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.bordered import Solution, factor, inverse, minimise, normal_equations
from estimation.system_alignment.bends import LOOSE, across, held, path_after, width
from estimation.system_alignment.model import Model
from estimation.system_alignment.parameters import HEADING_BIAS, WIND, places_of
from estimation.system_alignment.sides import track_of

_CHAINS, _STEPS, _SETTLING = 8, 40, 8
_JUMPS = 0.25  # share of steps that are jumps to a mirror image
_SHORTEST = 0.05  # of a Newton step
_PATIENT = 8  # steps to fall back onto the surface
_BELIEVED = 0.5  # power of the posterior that is sampled along the surface
_SEED = 3


class _Place(NamedTuple):
    """A place on the surface.

    Attributes:
        solution: the most probable constants and path across from it.
        loose: (T, K) axes of the surface there, in prior sigmas.
        slope: (K,) of half the cost along them.
        along: (K, K) covariance along them by the curvature there.
        cost: chi2 with the width across.
        mean: (T,) of the Gaussian across.
        across: (T, T) its covariance.
    """

    solution: Solution
    loose: Array
    slope: Array
    along: Array
    cost: float
    mean: Array
    across: Array


class Sample(NamedTuple):
    """Where the free constants lie, as Gaussians of equal probability.

    Attributes:
        mean: (C, S, T) of S places of C chains.
        across: (C, S, T, T) covariances.
        dimensions: K of the surface.
    """

    mean: Array
    across: Array
    dimensions: int

    def about(self, point: Array) -> Array:
        """(T, T) mean square distance from a point, more by what so few independent ones lack.

        Of m independent places in K dimensions the inverse of the scatter is too large by
        m / (m - K - 1), by which the scatter is widened, though never more than twofold.
        """
        within = self.across.mean(axis=(0, 1))
        apart = (self.mean - point).reshape(-1, len(point))
        independent = max(self._independent(), 2 * (self.dimensions + 1))
        widened = independent / (independent - self.dimensions - 1)
        square: Array = within + widened * (apart.T @ apart) / len(apart)
        return square

    def _independent(self) -> float:
        """How many independent places scatter as the chains' means do."""
        chains, steps, count = self.mean.shape
        scale = np.sqrt(np.einsum("csii->i", self.across) / (chains * steps))
        whole = (self.mean - self.mean.mean(axis=(0, 1))) / scale
        values, axes = np.linalg.eigh(np.cov(whole.reshape(-1, count).T))
        main = axes[:, -self.dimensions :] / np.sqrt(np.maximum(values[-self.dimensions :], 1e-12))
        scatter = np.var(whole.mean(axis=1) @ main, axis=0, ddof=1).mean()
        return float(min(1 / max(scatter, 1e-12), chains * steps))


def sampled(model: Model, modes: list[Solution], shares: Array, steps: int = _STEPS) -> Sample:
    """Chains from modes, each begun as often as its share says.

    Along the surface a power of the posterior is sampled (Miller, Dunson, Robust Bayesian
    inference via coarsening, JASA 114 (2019)): the noise of a log that is read of a steady motion
    is fitted to the ranges as if it were motion, and tells places apart that nothing does.
    """
    rng = np.random.default_rng(_SEED)
    count = max(1, *(_dimensions(model, mode) for mode in modes))
    firsts = [_here(model, mode, count) for mode in modes]
    edges = np.cumsum(shares)
    picks = np.searchsorted(edges, (np.arange(_CHAINS) + 0.5) / _CHAINS * edges[-1])
    chains = [list(_chain(model, firsts[int(pick)], rng, steps)) for pick in picks]
    mean = np.array([[place.mean for place in chain] for chain in chains])
    covariance = np.array([[place.across for place in chain] for chain in chains])
    return Sample(mean, covariance, count)


def _chain(model: Model, place: _Place, rng: np.random.Generator, steps: int) -> Iterator[_Place]:
    for step in range(_SETTLING + steps):
        move = _jumped if rng.random() < _JUMPS else _stepped
        place = move(model, place, rng)
        if step >= _SETTLING:
            yield place


def _dimensions(model: Model, found: Solution) -> int:
    """How many axes are loose at a mode."""
    back = np.linalg.inv(model.whitener)
    values = np.linalg.eigvalsh(back.T @ found.factored.information @ back)
    return int(np.sum(values <= LOOSE**-2))


def _here(model: Model, found: Solution, count: int) -> _Place:
    """A place from a solution with nothing held."""
    found = found._replace(cost=model(found.x, found.theta).cost)
    return _place(model, found, found.factored.information, np.zeros(len(found.theta)), count)


def _place(model: Model, found: Solution, information: Array, slope: Array, count: int) -> _Place:
    """A place from the constants, their information, and the slope (T,) of half the cost."""
    back = np.linalg.inv(model.whitener)
    scaled = back.T @ information @ back
    loose = np.linalg.eigh((scaled + scaled.T) / 2)[1][:, :count]
    rows = held(model, loose)
    pinned = information + rows.T @ rows
    aside = inverse(pinned)
    whole = found._replace(factored=found.factored._replace(information=pinned))
    return _Place(
        found,
        loose,
        loose.T @ back.T @ slope,
        inverse(loose.T @ scaled @ loose),
        found.cost - float(slope @ aside @ slope) + width(whole),
        found.theta - aside @ slope,
        aside,
    )


def _stepped(model: Model, place: _Place, rng: np.random.Generator) -> _Place:
    """A Newton step of random length with as much noise as keeps the Gaussian in place."""
    share = _SHORTEST ** rng.random()
    moved = rng.multivariate_normal(*_proposal(place, share), method="cholesky")
    target = place.solution.theta + np.linalg.solve(model.whitener, place.loose @ moved)
    x = place.solution.x + path_after(place.solution, target - place.solution.theta)
    there = _fallen(model, place.loose, x, target)
    if there is None:
        return place
    forth = model.whitener @ (there.solution.theta - place.solution.theta)
    chance = -_BELIEVED * (there.cost - place.cost) / 2
    chance += _log_normal(-there.loose.T @ forth, *_proposal(there, share))
    chance -= _log_normal(place.loose.T @ forth, *_proposal(place, share))
    return there if np.log(rng.random()) < chance else place


def _jumped(model: Model, place: _Place, rng: np.random.Generator) -> _Place:
    """To a mirror image."""
    theta, x = _mirrored(model, place.solution, rng)
    normal = normal_equations(model(x, theta))
    information = factor(normal).information
    back = np.linalg.inv(model.whitener)
    scaled = back.T @ information @ back
    loose = np.linalg.eigh((scaled + scaled.T) / 2)[1][:, : place.loose.shape[1]]
    there = _fallen(model, loose, x, theta)
    if there is None:
        return place
    chance = -_BELIEVED * (there.cost - place.cost) / 2
    return there if np.log(rng.random()) < chance else place


def _mirrored(model: Model, found: Solution, rng: np.random.Generator) -> tuple[Array, Array]:
    theta, x = model.theta(found.theta), found.x
    middle, along = track_of(x[:, :2])
    kind = rng.integers(3)
    where = places_of(theta)
    x0, y0, z = where[rng.integers(len(where))]
    if kind == 0:
        apart = theta[[x0, y0]] - middle
        theta[[x0, y0]] = middle + 2 * along * (along @ apart) - apart
    elif kind == 1:
        theta[z] = 2 * model.path.height_m.mean() - theta[z]
    else:
        _, along = track_of(np.vstack([model.path.start_m, model.path.path_m]))
        start = model.path.start_m
        turn = 2 * np.outer(along, along) - np.eye(2)
        theta[where[:, :2]] = start + (theta[where[:, :2]] - start) @ turn
        theta[WIND] = turn @ theta[WIND]
        theta[HEADING_BIAS] *= -1
        x = x.copy()
        x[:, :2] = start + (x[:, :2] - start) @ turn
    return theta[model.free], x


def _fallen(model: Model, loose: Array, x: Array, theta: Array) -> _Place | None:
    """The place of the surface across from some constants, if there is one near."""
    rows = held(model, loose)
    there = minimise(across(model, rows, theta), x, theta, _PATIENT)
    if not there.converged:
        return None
    aside = rows @ (there.theta - theta)
    information = there.factored.information - rows.T @ rows
    there = there._replace(cost=there.cost - float(aside @ aside))
    return _place(model, there, information, -rows.T @ aside, loose.shape[1])


def _proposal(place: _Place, share: float) -> tuple[Array, Array]:
    """Mean (K,) and covariance (K, K) of a step."""
    return -share * place.along @ place.slope, (1 - (1 - share) ** 2) / _BELIEVED * place.along


def _log_normal(at: Array, mean: Array, covariance: Array) -> float:
    apart = at - mean
    return float(
        -0.5 * (apart @ np.linalg.solve(covariance, apart) + np.linalg.slogdet(covariance)[1])
    )
