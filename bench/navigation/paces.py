"""Under which conditions any estimator can hold the relative position of the system demand to 6 m.

    python -m bench.navigation.paces [--seed N] [--runs N] [--json]

The demand states sigmas and how often targets are logged, but neither speeds nor how often carriers
range. Here the posterior bound in the random geometries of `together` for some of both; it follows
from the factors alone, nothing is solved.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from bench.figures import Figure, options, report, told
from bench.navigation.together import OURS, Pace, bound_of, random_scenes, scene

SPEEDS_MPS, INTERVALS_S = (15.0, 30.0, 60.0), (1.0, 2.5, 5.0)
LIMIT_M = 6.0


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Bounds of as many geometries as `together` has, for every pace."""
    places = [where for where, *_ in random_scenes(seed, max(runs // 5, 5))]
    for speed_mps, interval_s in product(SPEEDS_MPS, INTERVALS_S):
        pace = Pace(speed_mps, interval_s)
        name = f"bound of the relative position at {speed_mps:g} m/s, ranges every {interval_s:g} s"
        bounds = np.array(
            [
                bound_of(*scene(np.random.default_rng([seed, 23, i]), where=where, pace=pace))
                for i, where in enumerate(places)
            ]
        )
        yield told(f"{name}: median", float(np.median(bounds)), "m")
        yield told(f"{name}: share of at most {LIMIT_M:g} m", float(np.mean(bounds <= LIMIT_M)))
        ours = bound_of(*scene(np.random.default_rng([seed, 24]), where=OURS, pace=pace))
        yield told(f"{name}: our geometry", ours, "m")


def main() -> None:
    """Measure, print."""
    given = options("Posterior bound of the relative position by speed and interval.", runs=200)
    report(figures(given.seed, given.runs), given)


if __name__ == "__main__":
    main()
