"""Unknown motion: the family against the bound and both seed methods, and how often it covers."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from bench.bearings_only.scenes import (
    BENCHMARKS,
    ENSEMBLE,
    KINDS,
    NAMES,
    Drawn,
    benchmark,
    ensemble,
)
from bench.figures import Figure, at_most, between, told
from estimation.arrays import Array
from estimation.bearings_only import SeedTrack, Solution, n_bearings, n_polynomials, solve_many
from estimation.bearings_only.normal_equations import Loss

HALF = 0.6745  # median of |error| by sigma
MODELLED = tuple(kind for kind in ENSEMBLE if kind != "three legs")


class Judged(NamedTuple):
    """Solutions against the truth.

    Attributes:
        error: (B,) of the range at the last bearing [%], of the winner; 100 where there is none.
        covered: (B,) whether the 95 % interval holds the range.
        nees: by dimension, of the place where the range is determined: its median by that of
            chi-squared.
        determined, alarms: shares.
        median_bound: what the median error would be at the bound [%].
    """

    error: Array
    speed_error: Array
    covered: Array
    nees: float
    determined: float
    alarms: float
    median_bound: float

    def percentile(self, level: float) -> float:
        """Of the absolute error [%]."""
        return float(np.percentile(np.abs(self.error), level))


def judged(scene: Drawn, loss: Loss | None = None) -> Judged:
    """Solve and compare."""
    found = solve_many(scene.given, loss=loss)
    return compared(scene, found)


def compared(scene: Drawn, found: list[Solution]) -> Judged:
    """Solutions of a batch against its truth."""
    runs = len(found)
    ranges = np.array([_range(solution) for solution in found])
    speeds = np.array([_speed(solution) for solution in found])
    covered = [r in s.interval for r, s in zip(scene.range_m.tolist(), found, strict=True)]
    squared = [_nees(scene, found[i], i) for i in range(runs) if found[i].status == "determined"]
    return Judged(
        100 * (ranges / scene.range_m - 1),
        100 * (speeds / scene.speed_mps - 1),
        np.array(covered, dtype=float),
        float(np.median(squared)) / 1.386 if squared else np.nan,  # median of chi2 of 2
        len(squared) / runs,
        float(np.mean([s.alarm for s in found])),
        float(100 * HALF * np.median(scene.bound)),
    )


def _range(found: Solution) -> float:
    """The winner's range, whatever the status: for statistics of errors only."""
    return float(1 / found.mixture[0][1].inverse_range().value[0]) if found.mixture else 0.0


def _speed(found: Solution) -> float:
    if not found.mixture:
        return 0.0
    return float(np.linalg.norm(found.mixture[0][1].state(found.last_s).velocity_mps[0]))


def _nees(scene: Drawn, found: Solution, i: int) -> float:
    state = found.at(found.last_s)
    assert state is not None
    error = state.position_m - scene.place_m[i]
    return float(error @ np.linalg.solve(state.covariance[:2, :2], error))


def seed_errors(scene: Drawn, track: SeedTrack) -> tuple[Array, Array]:
    """Errors of range and speed [%] of a baseline at the last bearing."""
    last = np.broadcast_to(scene.given.t_s[..., -1], scene.range_m.shape)
    apart = track.position_m(last) - scene.given.observer_m[..., -1, :]
    speed = np.linalg.norm(track.velocity_mps(last), axis=-1)
    ranges = np.linalg.norm(apart, axis=-1)
    return 100 * (ranges / scene.range_m - 1), 100 * (speed / scene.speed_mps - 1)


@cache
def cell(seed: int, runs: int, name: str, kind: str, limit: int) -> tuple[Drawn, Judged]:
    """One of the sixteen cells."""
    rng = np.random.default_rng([seed, 3, ord(name), ord(kind), limit])
    scene = benchmark(rng, name, kind, limit, runs)
    return scene, judged(scene)


@cache
def random_cell(seed: int, runs: int, kind: str) -> tuple[Drawn, Judged]:
    """The random ensemble of one kind of motion."""
    scene = ensemble(np.random.default_rng([seed, 33, *map(ord, kind)]), kind, runs)
    return scene, judged(scene)


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The sixteen cells, then the random ensemble, then the intervals."""
    for name in BENCHMARKS:
        for limit in (10, 60):
            for kind in KINDS:
                _, found = cell(seed, runs, name, kind, limit)
                ratio = found.percentile(50) / found.median_bound
                yield at_most(f"{name} {limit}' {NAMES[kind]}: median / (.6745 bound)", ratio, 1.4)
    for kind in ENSEMBLE:
        yield from _random_figures(*random_cell(seed, -(-runs // 2), kind), kind)
    yield from _coverage(seed, runs)


def _random_figures(scene: Drawn, found: Judged, kind: str) -> Iterator[Figure]:
    name, median = f"random, {kind}", found.percentile(50)
    rivals = [
        n_bearings(scene.given),
        *(n_polynomials(scene.given, degree) for degree in (1, 2, 3)),
    ]
    medians = [float(np.median(np.abs(seed_errors(scene, rival)[0]))) for rival in rivals]
    yield told(f"{name}: median", median, "%")
    yield told(f"{name}: bound x .6745, median", found.median_bound, "%")
    yield told(f"{name}: N-bearings, median", medians[0], "%")
    yield told(f"{name}: N-polynomials of the best degree, median", min(medians[1:]), "%")
    if kind == "uniform":
        yield at_most(f"{name}: median / N-bearings", median / medians[0], 1.15)
    else:
        yield at_most(f"{name}: median / the better seed method", median / min(medians), 1)


def _coverage(seed: int, runs: int) -> Iterator[Figure]:
    """How often the 95 % intervals of unknown motion hold the truth."""
    fixed = [
        (f"{name} {limit}'", [cell(seed, runs, name, kind, limit)[1] for kind in KINDS])
        for name in BENCHMARKS
        for limit in (10, 60)
    ]
    for name, cells in fixed:
        for kind, one in zip(KINDS, cells, strict=True):
            yield told(f"{name} {NAMES[kind]}: 95 % intervals cover", float(one.covered.mean()))
        share = float(np.mean([c.covered.mean() for c in cells]))
        yield between(f"{name}: 95 % intervals cover, four motions", share, 0.92, 0.97)
    found = {kind: random_cell(seed, -(-runs // 2), kind)[1] for kind in ENSEMBLE}
    for kind, result in found.items():
        yield told(f"random, {kind}: 95 % intervals cover", float(result.covered.mean()))
        yield told(f"random, {kind}: NEES of determined places, median / chi2's", result.nees)
    share = float(np.mean([found[kind].covered.mean() for kind in MODELLED]))
    yield between("random, all motions of the family: 95 % intervals cover", share, 0.92, 0.97)
