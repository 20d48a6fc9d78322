"""Time of the metrics and of an association against the number of objects."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from bench.figures import Figure, scale, seconds, told
from estimation.arrays import Array
from estimation.association import Side, associate, candidates, population
from estimation.metrics import gospa

CUT_OFF_M = 1000.0
SIZES = ((1000, 1e5), (10_000, 3.16e5), (10_000, 1e5), (100_000, 1e6))
"""Objects, and the side of their square [m]: those of the tracking scenes."""


def picture(seed: int, objects: int, side_m: float) -> tuple[Array, Array]:
    """Objects, and estimates 300 m off of which one in ten is false."""
    rng = np.random.default_rng([seed, objects])
    truth = rng.uniform(0.0, side_m, (objects, 2))
    estimate = truth + rng.normal(0.0, 300.0, truth.shape)
    estimate[::10] = rng.uniform(0.0, side_m, estimate[::10].shape)
    return truth, estimate


def associated(truth: Array, estimate: Array, side_m: float) -> int:
    """Number of pairs of two sides with a common error of two coordinates."""
    spread = np.broadcast_to(np.square(300.0) * np.eye(2), (len(truth), 2, 2))
    one_for_all = np.broadcast_to(np.eye(2), (len(truth), 2, 2))
    own, other = Side(truth, spread), Side(estimate, spread, one_for_all)
    common = 100.0**2 * np.eye(2)
    near = candidates(own, other, common)
    of = population(len(truth), len(estimate), side_m**2, 0.9)
    return len(associate(near, common, of, np.zeros(len(near.own))).own)


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Milliseconds, as on the machine of the demands."""
    del runs
    faster = 1e3 * scale()
    for objects, side_m in SIZES:
        truth, estimate = picture(seed, objects, side_m)
        name = f"{objects} objects in {side_m / 1000:g} km"
        spent = seconds(partial(gospa, truth, estimate, CUT_OFF_M), repeats=3)
        yield told(f"GOSPA, {name}", faster * spent, "ms")
        if objects <= 10_000 and side_m / objects > 20:
            spent = seconds(partial(associated, truth, estimate, side_m), repeats=3)
            yield told(f"association of two sides, {name}", faster * spent, "ms")
