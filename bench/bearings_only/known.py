"""Maximum likelihood when the motion is known: against the bound, and its intervals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.bearings_only.scenes import (
    BENCHMARKS,
    ENSEMBLE,
    MOTIONS,
    NAMES,
    Drawn,
    benchmark,
    ensemble,
)
from bench.figures import Figure, at_most, between, told
from estimation.arrays import Array
from estimation.bearings_only import (
    Estimate,
    Motion,
    likely_ranges,
    maximum_likelihood,
    polynomial,
)
from estimation.bearings_only.solution import DETERMINED
from estimation.consistency import rms

CELLS = [
    (name, kind, limit) for name in BENCHMARKS for kind in ("A", "B", "C") for limit in (10, 60)
]
DEGREES = {"uniform": 1, "constant acceleration": 2, "constant jerk": 3}


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The cells of S and M, then polynomials of known degree in random geometries."""
    for name, kind, limit in CELLS:
        rng = np.random.default_rng([seed, 2, ord(name), ord(kind), limit])
        scene = benchmark(rng, name, kind, limit, runs)
        found = maximum_likelihood(scene.given, MOTIONS[kind])
        ratio = np.abs(_relative_error(found, scene)) / scene.bound
        what = f"{name} {limit}' {NAMES[kind]}, known"
        if (name, kind, limit) == ("S", "C", 60):
            yield at_most(f"{what}: 68th percentile / bound", np.percentile(ratio, 68.27), 1.1)
            yield told(f"{what}: RMS / bound", rms(ratio))
        elif (name, kind) == ("S", "C"):
            yield told(f"{what}: RMS / bound", rms(ratio))
        else:
            yield at_most(f"{what}: RMS / bound", rms(ratio), 1.05)
        yield between(f"{what}: 95 % intervals cover", _covered(found, scene), 0.92, 0.97)
    for kind, degree in DEGREES.items():
        yield from _random(seed, runs, kind, polynomial(degree))
    for kind, motion in ENSEMBLE.items():
        if kind not in DEGREES:
            yield from _random(seed, -(-runs // 4), kind, motion, judge=False)


def _random(
    seed: int, runs: int, kind: str, motion: Motion, *, judge: bool = True
) -> Iterator[Figure]:
    """Error by bound, in 1/range over all geometries, in range where the bound allows a range."""
    scene = ensemble(np.random.default_rng([seed, 2, *map(ord, kind)]), kind, runs)
    found = maximum_likelihood(scene.given, motion)
    inverse = (found.inverse_range().value * scene.range_m - 1) / scene.bound
    seen = scene.bound < DETERMINED
    in_range = (_relative_error(found, scene) / scene.bound)[seen]
    name = f"random, {kind}, known: rms(e / bound)"
    if judge:
        yield at_most(f"{name}, range, where the bound is below 10 %", rms(in_range), 1.1)
        yield told(f"{name}, 1 / range, all", rms(inverse))
    else:
        yield told(f"{name}, range, where the bound is below 10 %", rms(in_range))
    yield told(f"random, {kind}: share with a bound below 10 %", float(seen.mean()))


def _relative_error(found: Estimate, scene: Drawn) -> Array:
    error: Array = 1 / found.inverse_range().value / scene.range_m - 1
    return error


def _covered(found: Estimate, scene: Drawn) -> float:
    ranges = likely_ranges(found)
    inside = (ranges.low_m <= scene.range_m) & (scene.range_m <= ranges.high_m)
    return float(inside.mean())
