"""How many solutions a second: one thread, 41 bearings, benchmark S.

Processor time, not the clock: a batch takes long enough to meet the neighbours of the machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from bench.bearings_only.scenes import benchmark
from bench.figures import Figure, at_least, at_most, cpu_scale, seconds, told
from estimation.bearings_only import maximum_likelihood, polynomial, solve, solve_many

BATCH = 2048
TARGETS = 64


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Known degree, batched and alone; the whole family, batched and alone."""
    rng = np.random.default_rng([seed, 6])
    repeats = 3 if runs < 100 else 7
    for degree, kind, demand in ((1, "A", 30_000), (2, "C", 15_000), (3, "C", 0)):
        many = benchmark(rng, "S", kind, 10, BATCH).given
        spent = _processor_seconds(
            lambda g=many, n=degree: maximum_likelihood(g, polynomial(n)), repeats
        )
        name = f"degree {degree}: solutions a second, batched, scaled"
        yield at_least(name, BATCH / spent, demand) if demand else told(name, BATCH / spent)
        one = many._replace(bearing_rad=many.bearing_rad[0])
        spent = _processor_seconds(
            lambda g=one, n=degree: maximum_likelihood(g, polynomial(n)), repeats
        )
        yield at_most(f"degree {degree}: one solution, scaled", 1e3 * spent, 3, "ms")
    for kind in "ABCD":
        given = benchmark(rng, "S", kind, 10, TARGETS).given
        spent = _processor_seconds(lambda g=given: solve_many(g), min(repeats, 3)) / TARGETS
        yield at_most(f"unknown motion, {kind}: a target, batched, scaled", 1e3 * spent, 15, "ms")
    alone = given._replace(bearing_rad=given.bearing_rad[0])
    yield told(
        "unknown motion: one target alone, scaled",
        1e3 * _processor_seconds(lambda: solve(alone), 2),
        "ms",
    )


def _processor_seconds(function: Callable[[], object], repeats: int) -> float:
    """The least processor time of some calls, as on the machine of the demands."""
    return seconds(function, repeats, time.process_time) * cpu_scale(9)
