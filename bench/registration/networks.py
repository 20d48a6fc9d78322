"""Carriers registered jointly against pairs with the own one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.figures import Figure, at_least, between, scaled_seconds, told
from bench.registration.scenes import (
    SIDE_M,
    SIGMA_BEARING_RAD,
    SIGMA_C_RAD,
    SIGMA_OFFSET_M,
    SIGMA_RANGE_M,
)
from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.frames import polar_from_east_north, rotation_clockwise, wrap_pi
from estimation.relative_frame import (
    NetworkFrames,
    NetworkLogs,
    NetworkPrior,
    PolarLogs,
    RelativeFramePrior,
    adjustment,
    network_adjustment,
)
from estimation.relative_frame.gauge import root_of


class Scene(NamedTuple):
    """N carriers, their logs and the true frames in own axes."""

    logs: NetworkLogs
    prior: NetworkPrior
    q_m: Array  # (N, 2)
    D_rad: Array  # (N,)


class Means(NamedTuple):
    """Of many scenes; all but the last over those that converged: only they are results."""

    nees: float  # of all (q, D) together, by dimension
    chi2: float  # by degree of freedom
    star_by_joint: float  # RMS error of location
    converged: float


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The demand on networks: honest, better than the star; triangle; bearing-only mixed in."""
    m = measure(seed, max(runs // 80, 10), 8, 40, 0.3)
    yield between("network N = 8, 40 targets, Pd .3: NEES by dimension", m.nees, 0.95, 1.05)
    yield told("network N = 8, 40 targets, Pd .3: chi2/dof", m.chi2)
    yield at_least("network N = 8, 40 targets, Pd .3: star/joint error", m.star_by_joint, 1.5)
    yield at_least("network N = 8, 40 targets, Pd .3: share converged", m.converged, 1)
    mixed = measure(seed, max(runs // 80, 10), 8, 40, 0.3, bearing_only=3)
    yield between("network, 3 of 8 bearing-only: NEES by dimension", mixed.nees, 0.95, 1.05)
    yield at_least("network, 3 of 8 bearing-only: share converged", mixed.converged, 0.97)
    three = triangle_nees(seed, max(runs // 40, 20))
    yield between("triangle of single shared targets: NEES by dimension", three[0], 0.9, 1.1)
    yield told("triangle of single shared targets: D error / prior", three[1])
    yield at_least("triangle of single shared targets: rank of 6", three[2], 6)
    scene = drawn(np.random.default_rng([seed, 0]), 8, 40, 0.3)
    once = scaled_seconds(lambda: network_adjustment(scene.logs, scene.prior))
    yield told("network N = 8, 40 targets, Pd .3: time, scaled", once * 1e3, "ms")


def measure(
    seed: int, runs: int, carriers: int, targets: int, pd: float, bearing_only: int = 0
) -> Means:
    """Joint and star registration of many scenes."""
    squares, honest, chi2, converged = [], [], [], []
    for run in range(runs):
        rng = np.random.default_rng([seed, run, carriers])
        scene = drawn(rng, carriers, targets, pd, bearing_only)
        joint = network_adjustment(scene.logs, scene.prior)
        errors = error(joint, scene)
        converged.append(joint.converged)
        if not joint.converged:
            continue
        honest.append(float(nees(errors.ravel()[3:], joint.covariance[3:, 3:])))
        chi2.append(joint.chi2 / max(joint.dof, 1))
        if not bearing_only:
            squares.append((np.square(errors[1:, :2]).mean(), np.square(star(scene)).mean()))
    ratio = np.sqrt(np.mean(squares, axis=0)) if squares else np.ones(2)
    return Means(
        float(np.mean(honest)) / (3 * (carriers - 1)),
        float(np.mean(chi2)),
        float(ratio[1] / ratio[0]),
        float(np.mean(converged)),
    )


def drawn(
    rng: np.random.Generator, carriers: int, targets: int, pd: float, bearing_only: int = 0
) -> Scene:
    """Carriers and targets uniform in the square, each target seen by each carrier with pd.

    The last `bearing_only` carriers measure no ranges.
    """
    places = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (targets, 2))
    stations = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (carriers, 2))
    stations[0] = 0
    seen = rng.random((carriers, targets)) < pd
    return observed(rng, places, stations, seen, bearing_only)


def observed(
    rng: np.random.Generator,
    places: Array,
    stations: Array,
    seen: NDArray[np.bool_],
    bearing_only: int = 0,
) -> Scene:
    """What carriers at `stations` log of targets at `places` where `seen` (N, T) says so."""
    count = len(stations)
    carrier, target = np.nonzero(seen)
    sigmas = np.array([SIGMA_OFFSET_M, SIGMA_OFFSET_M, SIGMA_C_RAD])
    wrong = sigmas * rng.standard_normal((count, 3))
    bearing, ranges = polar_from_east_north(places[target] - stations[carrier])
    noise = rng.standard_normal((2, len(bearing)))
    ranges = ranges + SIGMA_RANGE_M * noise[0]
    ranges[carrier >= count - bearing_only] = np.nan
    covariance = np.diag([SIGMA_BEARING_RAD**2, SIGMA_RANGE_M**2])
    return Scene(
        NetworkLogs(
            carrier,
            target,
            bearing - wrong[carrier, 2] + SIGMA_BEARING_RAD * noise[1],
            ranges,
            np.broadcast_to(covariance, (len(bearing), 2, 2)),
        ),
        NetworkPrior(
            stations - wrong[:, :2],
            np.broadcast_to(np.diag(sigmas[:2] ** 2), (count, 2, 2)),
            np.full(count, SIGMA_C_RAD),
        ),
        stations @ rotation_clockwise(-wrong[0, 2]).T,
        wrong[:, 2] - wrong[0, 2],
    )


def error(found: NetworkFrames, scene: Scene) -> Array:
    """Errors (N, 3) of (q, D) of every carrier."""
    turn = wrap_pi(found.D_rad - scene.D_rad)
    return np.concatenate([found.q_m - scene.q_m, turn[:, None]], axis=1)


def star(scene: Scene) -> Array:
    """Errors (N - 1, 2) of location from pairs with the own carrier alone."""
    logs, errors = scene.logs, []
    for other in range(1, len(scene.q_m)):
        mine, theirs = (np.flatnonzero(logs.carrier == c) for c in (0, other))
        _, i, j = np.intersect1d(logs.target[mine], logs.target[theirs], return_indices=True)
        own, there = (
            PolarLogs(logs.bearing_rad[k], logs.range_m[k], logs.covariance[k])
            for k in (mine[i], theirs[j])
        )
        prior = RelativeFramePrior(
            scene.prior.offset_m[other],
            scene.prior.offset_covariance[other],
            float(scene.prior.sigma_c_rad[0]),
            float(scene.prior.sigma_c_rad[other]),
        )
        errors.append(adjustment(own, there, prior).own_axes.q_m - scene.q_m[other])
    return np.array(errors)


def triangle_nees(seed: int, runs: int) -> tuple[float, float, int]:
    """Three carriers, each two of which share one target.

    Returns:
        NEES by dimension, RMS error of D / prior, smallest rank of the targets' information.
    """
    seen = np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1]], dtype=bool)
    honest, turns, ranks = [], [], []
    for run in range(runs):
        rng = np.random.default_rng([seed, run, 3])
        scene = observed(rng, *_triangle(rng), seen)
        found = network_adjustment(scene.logs, scene.prior)
        errors = error(found, scene)
        honest.append(float(nees(errors.ravel()[3:], found.covariance[3:, 3:])))
        turns.append(errors[1:, 2])
        root = root_of(found.prior_covariance[3:, 3:])
        gained = np.linalg.eigvalsh(root.T @ found.information[3:, 3:] @ root)
        ranks.append(int((gained > 1e-6).sum()))
    turn = float(rms(turns)) / (np.sqrt(2) * SIGMA_C_RAD)
    return float(np.mean(honest)) / 6, turn, min(ranks)


def _triangle(rng: np.random.Generator) -> tuple[Array, Array]:
    """Three targets about the corners and three carriers about them."""
    corners = 12e3 * np.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]])
    middles = (corners[[0, 0, 1]] + corners[[1, 2, 2]]) / 2
    outward = 1.5 * (middles - corners.mean(axis=0))
    targets = middles + outward + rng.normal(0, 1e3, (3, 2))
    return targets, corners + np.concatenate([[[0.0, 0.0]], rng.normal(0, 1e3, (2, 2))])
