"""Other places where the constants may as well lie: modes of the posterior beside the best one.

A beacon may lie on either side of a straight track and of the plane of a level one; a drift of
unknown direction may go either way. From such mates of every mode found, and from draws of the
prior, the most probable constants are sought anew. What is found shares the probability.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from estimation.arrays import Array
from estimation.bordered import Solution
from estimation.system_alignment.bends import Spread, settled, spread, tangent
from estimation.system_alignment.model import Model
from estimation.system_alignment.parameters import places_of
from estimation.system_alignment.ridges import Sample, sampled
from estimation.system_alignment.sides import difference, track_of

Solve = Callable[[Array, Array], Solution]
Start = tuple[Array, Array]

_DRAWS = 8  # starts from the prior
_ROOTED = 40  # iterations to the root of x^(d + 1) = x + 1
_WALKED = 4  # modes whose ridges are walked
_IMPROBABLE = 10.0  # chi2 above the best from which a mode is none
_RARE = 0.05  # probability of all others below which there is no choice
_SAME = 0.1  # prior sigmas between solutions that are one
_NEAR, _ASIDE = 1 / 3, 1 / 2  # of the distance from path, from track: a prior that tells no side
_SURPRISE = 4.0  # sigmas by which the ranges' chi2 may be larger than their number


class Mode(NamedTuple):
    """Another place where the constants may lie.

    Attributes:
        theta: (7 + 4 J,).
        probability: its share among all modes.
        name: how it differs from the best, in words.
    """

    theta: Array
    probability: float
    name: str

    @property
    def beacons_m(self) -> Array:
        """(J, 3)."""
        return self.theta[places_of(self.theta)]


class Mixture(NamedTuple):
    """Modes together.

    Attributes:
        best: the most probable constants of all.
        others: the other modes, the more probable first.
        square: (T, T) mean square distance of the free constants from the best.
        ambiguous: whether others share the probability, or ridges had to be sampled.
    """

    best: Solution
    others: tuple[Mode, ...]
    square: Array
    ambiguous: bool


def doubtful(model: Model, found: Solution) -> bool:
    """Whether there may be other modes, or a better one, for all that one solution tells."""
    return not found.converged or _open(model, found) or _surprising(model, found)


def _open(model: Model, found: Solution) -> bool:
    """Whether the prior leaves open on which side of the path some beacon lies.

    Above or below is asked for every beacon anyway.
    """
    where = places_of(model.prior.mean)
    sigma = np.sqrt(np.diag(model.prior.covariance)[where[:, :2]].max(axis=1))
    places = np.column_stack([found.x[:, :2], model.path.height_m])
    beacons = model.theta(found.theta)[where]
    nearest = np.sqrt(np.sum((places[:, None] - beacons) ** 2, axis=2)).min(axis=0)
    middle, along = track_of(found.x[:, :2])
    across = np.array([-along[1], along[0]])
    way, apart = found.x[:, :2] - middle, beacons[:, :2] - middle
    aside = np.maximum(np.abs(apart @ across), np.sqrt(np.mean((way @ across) ** 2)))
    aside = np.where(np.ptp(way @ along) > sigma, aside, np.sqrt(np.sum(apart**2, axis=1)))
    return bool(np.any((sigma > _NEAR * nearest) | (sigma > _ASIDE * aside)))


def _surprising(model: Model, found: Solution) -> bool:
    """Whether the ranges that are believed fit worse than noise does."""
    residuals = model.residuals(found.x, found.theta)
    cost, weight = model.loss(residuals)
    count = int(np.sum(weight == 1))
    believed = found.cost - float(np.sum(cost[weight < 1]))
    return bool(believed > count + _SURPRISE * np.sqrt(2 * count))


def mixture(
    model: Model, first: Solution, solve: Solve, draw: Callable[[Array], Start], most: int
) -> Mixture:
    """All modes that are found, and the second moment of all together.

    Args:
        first: a mode.
        solve: the most probable path and constants near a start.
        draw: a start from free constants (T,).
        most: starts.
    """
    modes = sorted(_modes(model, first, solve, draw, most), key=lambda mode: mode.cost)
    told = [tangent(mode) for mode in modes]
    likely = np.argsort([-part.log_mass for part in told])[:_WALKED]
    for i in likely:
        if not modes[i].converged:
            return _by_sample(model, modes, told)
        told[i] = spread(model, modes[i])
        if told[i].far:
            return _by_sample(model, modes, told)
    share = _share(told)
    best = modes[0].theta
    apart = [_about(p, m.theta - best) for p, m in zip(told, modes, strict=True)]
    mixed = _mixture(model, modes, share, np.einsum("k,kij->ij", share, apart))
    return mixed._replace(ambiguous=sum(m.probability for m in mixed.others) > _RARE)


def _by_sample(model: Model, modes: list[Solution], told: list[Spread]) -> Mixture:
    """The same where ridges bend each other."""
    sample = sampled(settled(model, modes[0]), modes, _share(told))
    return _mixture(model, modes, _shares(model, modes, sample), sample.about(modes[0].theta))


def _mixture(model: Model, modes: list[Solution], share: Array, square: Array) -> Mixture:
    """The best mode, and the others by their shares (M,)."""
    order = [i for i in np.argsort(-share) if i and share[i] > 0]
    best = model.theta(modes[0].theta)
    way, height = modes[0].x[:, :2], float(model.path.height_m.mean())
    others = []
    for i in order:
        theta = model.theta(modes[i].theta)
        name = difference(model.prior, way, height, best, theta)
        others.append(Mode(theta, float(share[i]), name))
    return Mixture(modes[0], tuple(others), square, ambiguous=True)


def _share(told: list[Spread]) -> Array:
    """(M,) probabilities by the masses."""
    mass = np.array([part.log_mass for part in told])
    weight = np.exp(mass - mass.max())
    share: Array = weight / weight.sum()
    return share


def _about(part: Spread, apart: Array) -> Array:
    """(T, T) mean square of one mode about a point `apart` from it."""
    cross = np.outer(part.shift, apart)
    square: Array = part.square + cross + cross.T + np.outer(apart, apart)
    return square


def _shares(model: Model, modes: list[Solution], sample: Sample) -> Array:
    """(M,) of the sample that lies nearest to each mode."""
    places = sample.mean.reshape(-1, len(modes[0].theta)) @ model.whitener.T
    centres = np.array([model.whitener @ mode.theta for mode in modes])
    nearest = np.argmin(np.linalg.norm(places[:, None] - centres, axis=2), axis=1)
    count: Array = np.bincount(nearest, minlength=len(modes)) / len(places)
    return count


def _modes(
    model: Model, first: Solution, solve: Solve, draw: Callable[[Array], Start], most: int
) -> list[Solution]:
    """Modes not much worse than the best, each once."""
    modes, least = [first], first.cost
    waiting = list(_mates(model, first))
    draws = _evenly(_DRAWS, len(first.theta))
    root = np.linalg.inv(model.whitener)
    mean = model.prior.mean[model.free]
    for count in range(most):
        if count < _DRAWS:
            start = draw(mean + root @ draws[count])
        elif waiting:
            start = waiting.pop(0)
        else:
            break
        there = solve(*start)
        if there.cost > least + _IMPROBABLE or any(_same(model, there, m) for m in modes):
            continue
        least = min(least, there.cost)
        modes.append(there)
        waiting.extend(_mates(model, there))
    return [mode for mode in modes if mode.cost < least + _IMPROBABLE]


def _evenly(count: int, dimensions: int) -> Array:
    """Points (count, dimensions) that fill the standard normal evenly (Roberts's R sequence)."""
    root = 2.0
    for _ in range(_ROOTED):
        root = (1 + root) ** (1 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    uniform = (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
    return np.asarray(ndtri(uniform), dtype=float)


def _same(model: Model, one: Solution, other: Solution) -> bool:
    return bool(np.linalg.norm(model.whitener @ (one.theta - other.theta)) < _SAME)


def _mates(model: Model, mode: Solution) -> Iterator[Start]:
    """Each beacon put on the other side of the track, and of the level of the path."""
    theta = model.theta(mode.theta)
    middle, along = track_of(mode.x[:, :2])
    height = model.path.height_m.mean()
    for x, y, z in places_of(theta):
        aside = theta.copy()
        apart = theta[[x, y]] - middle
        aside[[x, y]] = middle + 2 * along * (along @ apart) - apart
        below = theta.copy()
        below[z] = 2 * height - below[z]
        for mate in (aside, below):
            free = mate[model.free]
            if not np.array_equal(free, mode.theta) and np.array_equal(model.theta(free), mate):
                yield mode.x, free
