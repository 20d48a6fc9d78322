"""What one Gaussian about the most probable constants leaves out: ridges that bend.

A straight track, or a few ranges, leave a beacon free along an arc. The curvature of the cost at
the mode knows the tangent of that arc and not the arc. Along every axis that the data leave loose,
the cost is compared with its parabola; where they differ, the ridge is walked to both sides, and
its mean square distance from the mode takes the place of the parabola's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.bordered import Linearised, Solution, inverse, minimise
from estimation.system_alignment.losses import squares
from estimation.system_alignment.model import Model

LOOSE = 0.2  # posterior over prior sigma from which an axis is looked at
_TRIED, _STRAIGHT = 1.5, 0.6  # sigmas to both sides; chi2 by which the parabola may be wrong there
_STRIDE, _TURN = (
    0.75,
    0.3,
)  # of the sigma along the ridge; of the stride, by which it may bend aside
_PINNED = 0.01  # prior sigmas
_END, _MOST = 9.0, 40  # chi2 above the mode at which a walk ends; points of one side
_PATIENT, _HALVED = 8, 5
_TURNS = 20  # of axes towards plain ones
_BELIEVED = 1e-3  # weight below which a range is left out
_LEAST = 0.1  # of the parabola's variances
_FAR = 5.0  # sigmas by the curvature at the mode
_ROOT = np.sqrt(2 * np.pi)


class _Point(NamedTuple):
    """A point of a ridge.

    Attributes:
        solution: the most probable constants and path of those that lie across from it.
        loose: (T, K) axes that the data leave loose there, in prior sigmas.
        along: (T,) the one of them that is walked.
        sigma: along it, prior sigmas.
        cost: chi2 above the mode, the ridge's width included.
        across: (T, T) covariance with all loose axes held.
        length: from the point before.
    """

    solution: Solution
    loose: Array
    along: Array
    sigma: float
    cost: float
    across: Array
    length: float


class Spread(NamedTuple):
    """How the free constants lie about one mode.

    Attributes:
        square: (T, T) mean square distance from it.
        shift: (T,) mean distance.
        log_mass: logarithm of the probability, up to what all modes have in common.
        far: whether several ridges leave their tangents by many sigmas, so that they bend each
            other too.
    """

    square: Array
    shift: Array
    log_mass: float
    far: bool = False


def tangent(found: Solution) -> Spread:
    """Moments about the mode by the curvature there alone."""
    mass = -0.5 * (found.cost + width(found))
    return Spread(found.covariance, np.zeros(len(found.theta)), mass)


def spread(model: Model, found: Solution) -> Spread:
    """Moments about the mode by the ridges through it.

    Loose axes are taken one by one: what bends along one is added to what bends along the others.
    """
    straight = tangent(found)
    model = settled(model, found)
    found = found._replace(cost=model(found.x, found.theta).cost)
    covariance, whitener = straight.square, model.whitener
    values, axes = np.linalg.eigh(whitener @ covariance @ whitener.T)
    loose = _plain(axes[:, values >= LOOSE**2])
    bent = [axis for axis in loose.T if _bends(model, found, axis)]
    if not bent:
        return straight
    whole, shift, mass = covariance.copy(), straight.shift.copy(), straight.log_mass
    rows = held(model, loose)
    pinned = found._replace(
        factored=found.factored._replace(information=found.factored.information + rows.T @ rows)
    )
    for axis in bent:
        start = _point(model, pinned, pinned, loose, axis, 0.0)
        step = start.sigma * np.linalg.solve(whitener, axis)
        mean, square, length = _moments(model, start)
        mass += np.log(length / (_ROOT * start.sigma))
        whole += square - np.outer(mean, mean) - np.outer(step, step) - start.across
        shift += mean
    square = _at_least(_LEAST * covariance, whole + np.outer(shift, shift))
    return Spread(square, shift, float(mass), far=len(bent) > 1 and _reach(found, square) > _FAR)


def _reach(found: Solution, square: Array) -> float:
    """The largest root mean square distance (T, T) in sigmas by the curvature at the mode."""
    return float(np.sqrt(np.linalg.eigvals(found.factored.information @ square).real.max()))


def width(found: Solution) -> float:
    """Logarithm of the determinant of the information of path and constants."""
    path = 2 * np.log(found.factored.root[0]).sum()
    return float(path + np.linalg.slogdet(found.factored.information)[1])


def settled(model: Model, found: Solution) -> Model:
    """The problem with every range believed as at the mode: along a ridge none is doubted anew."""
    weight = model.loss(model.residuals(found.x, found.theta))[1]
    logs = model.logs.of(weight > _BELIEVED)
    sigma = logs.sigma_m / np.sqrt(weight[weight > _BELIEVED])
    return replace(model, logs=logs._replace(sigma_m=sigma), loss=squares)


def _plain(axes: Array) -> Array:
    """The same plane (T, K) by axes of few constants each (Kaiser's varimax, 1958).

    Equally loose axes are any mixture; what bends is one beacon's place and not a mixture.
    """
    turn = np.eye(axes.shape[1])
    for _ in range(_TURNS):
        turned = axes @ turn
        pull = axes.T @ (turned**3 - turned * np.mean(turned**2, axis=0))
        left, _, right = np.linalg.svd(pull)
        turn = left @ right
    return np.asarray(axes @ turn)


def _bends(model: Model, found: Solution, axis: Array) -> bool:
    """Whether the cost beside the mode is another than its parabola."""
    step = np.linalg.solve(model.whitener, axis)
    sigma = 1 / np.sqrt(step @ found.factored.information @ step)
    for side in (-_TRIED, _TRIED):
        moved = side * sigma * step
        cost = model(found.x + path_after(found, moved), found.theta + moved).cost
        if abs(cost - found.cost - _TRIED**2) > _STRAIGHT:
            return True
    return False


def path_after(found: Solution, moved: Array) -> Array:
    """How the path follows the constants."""
    followed: Array = -(found.factored.shadow @ moved).reshape(found.x.shape)
    return followed


def _moments(model: Model, start: _Point) -> tuple[Array, Array, float]:
    """Mean (T,), mean square (T, T) of the distance from the mode along one ridge; its length.

    The length counts every part by its probability against the mode's.
    """
    after = list(_walk(model, start))
    before = list(_walk(model, start._replace(along=-start.along)))
    points = [*before[::-1], start, *after]
    gaps = np.array([0.0, *(p.length for p in (*before[::-1], *after)), 0.0])
    share = (gaps[:-1] + gaps[1:]) / 2 * np.exp(-0.5 * np.array([p.cost for p in points]))
    length = float(share.sum()) if len(points) > 1 else _ROOT * start.sigma
    share = share / share.sum() if len(points) > 1 else np.ones(1)
    away = np.array([p.solution.theta - start.solution.theta for p in points])
    across = np.array([p.across for p in points])
    square = (share * away.T) @ away + np.einsum("k,kij->ij", share, across)
    return share @ away, square, length


def _walk(model: Model, start: _Point) -> Iterator[_Point]:
    """Points of a ridge to one side, until it is improbable or comes back to where it began."""
    point, stride, least = start, _STRIDE * start.sigma, start.cost
    for count in range(_MOST):
        reached = _next(model, start, point, stride)
        if reached is None:
            return
        point, least = reached, min(least, reached.cost)
        yield point
        back = model.whitener @ (point.solution.theta - start.solution.theta)
        if point.cost - least > _END or (count > 1 and np.linalg.norm(back) < point.length):
            return
        stride = min(_STRIDE * point.sigma, 2 * point.length)


def _next(model: Model, start: _Point, point: _Point, stride: float) -> _Point | None:
    """The next point; a stride that leads aside is halved."""
    for _ in range(_HALVED):
        moved = np.asarray(stride * np.linalg.solve(model.whitener, point.along), dtype=float)
        theta = point.solution.theta + moved
        x = point.solution.x + path_after(point.solution, moved)
        there = minimise(across(model, held(model, point.loose), theta), x, theta, _PATIENT)
        aside = model.whitener @ (there.theta - theta)
        if there.converged and np.linalg.norm(aside) < _TURN * stride:
            return _point(model, start.solution, there, point.loose, point.along, stride)
        stride /= 2
    return None


def held(model: Model, loose: Array) -> Array:
    """Rows (K, T) that hold the constants along some axes."""
    rows: Array = loose.T @ model.whitener / _PINNED
    return rows


def across(model: Model, held: Array, theta: Array) -> Callable[[Array, Array], Linearised]:
    """The problem with some axes held at a place."""

    def pinned(x: Array, free: Array) -> Linearised:
        at, aside = model(x, free), held @ (free - theta)
        return at._replace(
            known_residual=np.append(at.known_residual, aside),
            known_by_theta=np.vstack([at.known_by_theta, held]),
            cost=at.cost + float(aside @ aside),
        )

    return pinned


def _point(
    model: Model, mode: Solution, there: Solution, loose: Array, along: Array, length: float
) -> _Point:
    """A point of the ridge `along` which the loose axes of the last one were held."""
    rows, back = held(model, loose), np.linalg.inv(model.whitener)
    pinned = there.factored.information
    scaled = back.T @ (pinned - rows.T @ rows) @ back
    if length:
        loose = np.linalg.eigh((scaled + scaled.T) / 2)[1][:, : loose.shape[1]]
        along = loose @ (loose.T @ along)
        along = along / np.linalg.norm(along)
    sigma = 1 / np.sqrt(max(float(along @ scaled @ along), 1.0))
    cost = there.cost - mode.cost + width(there) - width(mode)
    return _Point(there, loose, along, sigma, cost, inverse(pinned), length)


def _at_least(least: Array, matrix: Array) -> Array:
    """A matrix with what is too small by the measure of another made as large as that."""
    root = np.linalg.cholesky(least)
    whitened = np.linalg.solve(root, np.linalg.solve(root, matrix).T)
    values, axes = np.linalg.eigh((whitened + whitened.T) / 2)
    grown = root @ axes
    return np.asarray((grown * np.maximum(values, 1.0)) @ grown.T)
