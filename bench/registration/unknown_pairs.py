"""Scenes in which no log says whose it is, and the methods that acquisition is to beat."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bench.registration.scenes import (
    DEG,
    SIDE_M,
    SIGMA_BEARING_RAD,
    SIGMA_C_RAD,
    SIGMA_OFFSET_M,
    SIGMA_RANGE_M,
)
from estimation.acquisition.innovation import (
    Frames,
    fitted,
    log_likelihood,
    with_covariance_along_own,
)
from estimation.acquisition.matching import Pairs, best_assignment
from estimation.acquisition.problem import (
    Clues,
    Constraints,
    Problem,
    Side,
    problem,
)
from estimation.acquisition.sharing import Sharing
from estimation.arrays import Array, Indices
from estimation.frames import polar_from_east_north, rotation_clockwise
from estimation.relative_frame import PolarLogs, RelativeFramePrior, prior_in_own_axes

NOBODY = -1
Place = Callable[[np.random.Generator, int], Array]


def square(rng: np.random.Generator, count: int) -> Array:
    """Uniform in the paper's square about the own carrier."""
    return rng.uniform(-SIDE_M / 2, SIDE_M / 2, (count, 2))


def lane(rng: np.random.Generator, count: int) -> Array:
    """Ships in a lane of 25 by 3 km, 8 km from the own carrier, off every axis of symmetry."""
    along, across = rng.uniform(-12.5e3, 12.5e3, count), rng.uniform(6.5e3, 9.5e3, count)
    return np.stack([along, across], axis=1) @ rotation_clockwise(0.6).T


def cluster(rng: np.random.Generator, count: int) -> Array:
    """A fishing fleet: Gaussian of 1.5 km, 12 km away."""
    return np.array([9e3, 8e3]) + rng.normal(0, 1500, (count, 2))


class Layout(NamedTuple):
    """Of what kind a scene is; each carrier has `targets` and clutter beside."""

    targets: int
    shared: int
    clutter: int = 0
    sigma_offset_m: float = SIGMA_OFFSET_M
    sigma_c_rad: float = SIGMA_C_RAD
    place: Place = square
    other_sigmas: float = 1.0  # of the other's sensor, in those of the own
    any_heading: bool = False


class Scene(NamedTuple):
    """What two carriers report, in any order, and the truth."""

    own: PolarLogs
    other: PolarLogs
    prior: RelativeFramePrior
    partner: Indices  # (N1,) the other's log of the same target, or NOBODY
    t: Array  # (3,) the true q and D


def scene(rng: np.random.Generator, layout: Layout) -> Scene:
    """One draw of a layout; the other carrier anywhere in the square."""
    alone, shared = layout.targets - layout.shared, layout.place(rng, layout.shared)
    offset = square(rng, 1)[0]
    s_q, s_c = layout.sigma_offset_m, layout.sigma_c_rad
    x, y, c1, c2 = np.array([s_q, s_q, s_c, s_c]) * rng.standard_normal(4)
    if layout.any_heading:
        c2 += rng.uniform(-np.pi, np.pi)
    seen = [
        np.concatenate([shared, layout.place(rng, alone), square(rng, layout.clutter)])
        for _ in range(2)
    ]
    order = [rng.permutation(len(each)) for each in seen]
    place = np.argsort(order[1])
    partner = np.where(order[0] < layout.shared, place[order[0]], NOBODY)
    return Scene(
        own=_measured(rng, seen[0][order[0]], c1, 1.0),
        other=_measured(rng, seen[1][order[1]] - offset, c2, layout.other_sigmas),
        prior=RelativeFramePrior.from_sigmas(offset - [x, y], s_q, s_q, s_c, s_c),
        partner=partner,
        t=np.array([*(rotation_clockwise(-c1) @ offset), c2 - c1]),
    )


def _measured(rng: np.random.Generator, place: Array, c_rad: float, sigmas: float) -> PolarLogs:
    bearing, ranges = polar_from_east_north(place)
    sigma_b, sigma_d = SIGMA_BEARING_RAD * sigmas, SIGMA_RANGE_M * sigmas
    return PolarLogs.from_sigmas(
        bearing - c_rad + sigma_b * rng.standard_normal(bearing.shape),
        np.maximum(ranges + sigma_d * rng.standard_normal(bearing.shape), 1.0),
        sigma_b,
        sigma_d,
    )


def any_share(rng: np.random.Generator, most: int, sigma_offset_m: float, c_deg: float) -> Layout:
    """Few targets and any number of them shared, none as well: where it is easy to be wrong."""
    count = int(rng.integers(2, most + 1))
    shared = int(rng.integers(0, count + 1))
    return Layout(count, shared, 0, sigma_offset_m, c_deg * DEG)


def gnn_ignoring(given: Scene) -> Pairs:
    """Nearest neighbours, globally, as if the prior frame had no error."""
    logs, prior = _arrays(given)
    return _nearest(logs, Frames(prior.t, np.zeros((1, 3, 3))))


def gnn_iterated(given: Scene) -> Pairs:
    """Nearest neighbours under the prior's error, fit, and again until nothing changes."""
    logs, prior = _arrays(given)
    pairs = _nearest(logs, prior)
    for _ in range(20):
        frame = fitted(prior, prior.t[0], logs.own.take(pairs.own), logs.other.take(pairs.other))
        before, pairs = pairs, _nearest(logs, frame)
        if all(np.array_equal(a, b) for a, b in zip(before, pairs, strict=True)):
            break
    return pairs


def fit_of(given: Scene, pairs: Pairs) -> Frames:
    """The frame by given pairs."""
    logs, prior = _arrays(given)
    return fitted(prior, prior.t[0], logs.own.take(pairs.own), logs.other.take(pairs.other))


def _arrays(given: Scene) -> tuple[Problem, Frames]:
    logs = problem(given.own, given.other, Clues(), Constraints(), None)
    prior = prior_in_own_axes(given.prior)
    return logs, Frames(np.array([[*prior.q_m, prior.D_rad]]), prior.covariance[None])


def _nearest(logs: Problem, frame: Frames) -> Pairs:
    other = with_covariance_along_own(logs.other, float(frame.t[0, 2]))
    own = Side(logs.own.state[:, None], logs.own.covariance[:, None], logs.own.moving[:, None])
    worth = Sharing.of(own.count, other.count, logs.area_m2).worth_at_first
    density = log_likelihood(frame, own, other, logs.sigma_speed_mps)
    return best_assignment(worth + density, logs.bound)
