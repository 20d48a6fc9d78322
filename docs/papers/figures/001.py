"""Draws the figures of docs/papers/001.md: `python docs/papers/figures/001.py`, from the root.

As the paper's figures 2 to 5, which are surfaces over the number of bearings and the noise: here
each is cut along both axes. The numbers are measured anew, on benchmark S.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[3]), str(Path(__file__).parent)]

from bench.bearings_only.scenes import KINDS, NAMES, Drawn, benchmark  # noqa: E402
from bench.bearings_only.unknown import HALF, judged, seed_errors  # noqa: E402
from estimation.bearings_only import (  # noqa: E402
    CONSTANT_VELOCITY,
    maximum_likelihood,
    n_bearings,
    n_polynomials,
)

common = importlib.import_module("000")  # the plots of paper 000

RUNS, SOLVED = 200, 40
COUNTS = (12, 16, 20, 24, 28, 32, 36, 41)
LIMITS = (3, 6, 10, 20, 40, 60)
CEILING = 300.0  # [%] what is above it is drawn there
COLOURS = {
    "N-bearings": "#c44",
    "N-polynomials, n = 2": "#d80",
    "N-polynomials, n = 3": "#a6a",
    "known motion": "#26a",
    "unknown motion": "#283",
}


def medians(scene: Drawn) -> Iterator[float]:
    """Median error [%] of every method, then that of the bound."""
    for track in (n_bearings, lambda g: n_polynomials(g, 2), lambda g: n_polynomials(g, 3)):
        yield float(np.median(np.abs(seed_errors(scene, track(scene.given))[0])))
    inverse = (
        maximum_likelihood(scene.given, scene.motion or CONSTANT_VELOCITY).inverse_range().value
    )
    yield float(np.median(np.abs(100 / inverse / scene.range_m - 100)))
    few = scene.given._replace(bearing_rad=scene.given.bearing_rad[:SOLVED])
    part = scene._replace(
        given=few,
        range_m=scene.range_m[:SOLVED],
        speed_mps=scene.speed_mps[:SOLVED],
        bound=scene.bound[:SOLVED],
        place_m=scene.place_m[:SOLVED],
    )
    yield judged(part).percentile(50)
    yield float(100 * HALF * scene.bound[0])


def draw(name: str, title: str, label: str, x: tuple[int, ...], scenes: list[Drawn]) -> None:
    """One plot: a curve a method, and the bound dashed."""
    columns = np.clip([list(medians(scene)) for scene in scenes], 1e-3, CEILING).T.tolist()
    curves = [
        common.Curve(method, x, column, colour)
        for (method, colour), column in zip(COLOURS.items(), columns, strict=False)
    ]
    curves.append(common.Curve("bound x .6745", x, columns[-1], "#555", dashed=True))
    common.plot(name, title, (label, "median error of range, %"), curves, common.LEFT)


def main() -> None:
    """Eight plots: four motions against the number of bearings and against the noise."""
    for kind in KINDS:
        rng = np.random.default_rng([1, ord(kind)])
        draw(
            f"001-{kind.lower()}-count.svg",
            f"{NAMES[kind]}, limit 60'",
            "bearings",
            COUNTS,
            [benchmark(rng, "S", kind, 60, RUNS, count) for count in COUNTS],
        )
        draw(
            f"001-{kind.lower()}-noise.svg",
            f"{NAMES[kind]}, 41 bearings",
            "limit of the noise, arc minutes",
            LIMITS,
            [benchmark(rng, "S", kind, limit, RUNS) for limit in LIMITS],
        )


if __name__ == "__main__":
    main()
