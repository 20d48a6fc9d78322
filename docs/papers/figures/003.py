"""Draws the figures of docs/papers/003.md: `python docs/papers/figures/003.py`, from the root.

As the paper's figures 1 to 3: the trajectory, and errors as the interval of observation grows. The
numbers are measured anew, on benchmark G, variant F.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[2]))

from bench.navigation.circling import (  # noqa: E402
    BEACONS_M,
    Score,
    aligned,
    flight,
    papers,
    score,
)
from bench.svg import RIGHT, TOP, Curve, linear, logarithmic, plot  # noqa: E402
from estimation.arrays import Array  # noqa: E402

RUNS, SEED = 60, 1
CEILING_M = 1000.0  # what is above it is drawn there
COUNTS = {
    False: (40, 60, 80, 100, 120, 160, 200, 300, 400),
    True: (100, 150, 200, 250, 300, 350, 400, 500),
}
NAMES = {"xy": "planar", "z": "height"}
COLOURS = {"xy": "#26a", "z": "#283"}


def trajectory() -> None:
    """The path as dead-reckoned without wind, and as flown."""
    one = flight(np.random.default_rng(SEED), 210, fixed=True)
    curves = [
        _track("planned", one.path.path_m[::5], "#26a", dashed=True),
        _track("flown", one.truth.path_m[::15], "#c44"),
        *(_track(f"beacon {i + 1}", b[None, :2], "#283") for i, b in enumerate(BEACONS_M)),
    ]
    axes = linear("x, m", -7000, 6000, 2000), linear("y, m", -4000, 4000, 1000)
    plot(HERE / "003-path.svg", "Trajectory and beacons", axes, curves, (RIGHT, TOP))


def _track(name: str, places: Array, colour: str, *, dashed: bool = False) -> Curve:
    return Curve(name, places[:, 0].tolist(), places[:, 1].tolist(), colour, dashed)


def errors_against_count(name: str, title: str, *, differences: bool) -> None:
    """Median errors of the paper's method (dashed) and of the most probable solution."""
    counts = COUNTS[differences]
    both = {
        method: [_scored(n, method is papers, differences=differences) for n in counts]
        for method in (papers, aligned)
    }
    curves = [
        Curve(
            f"{NAMES[what]}, {'LS' if method is papers else 'MAP'}",
            counts,
            [min(_median(result, what), CEILING_M) for result in results],
            COLOURS[what],
            dashed=method is papers,
        )
        for method, results in both.items()
        for what in NAMES
    ]
    axes = linear("n, epochs", 0, 500, 100), logarithmic("median error, m", [1, CEILING_M])
    plot(HERE / name, title, axes, curves, (RIGHT, TOP))


def diverged() -> None:
    """Share of runs in which the paper's iteration does not settle."""
    curves = [
        Curve(
            "differences" if differences else "ranges",
            counts,
            [
                100 * float((~_scored(n, True, differences=differences).solved).mean())
                for n in counts
            ],
            "#c44" if differences else "#26a",
        )
        for differences, counts in COUNTS.items()
    ]
    axes = linear("n, epochs", 0, 500, 100), linear("diverged, %", 0, 100, 20)
    plot(HERE / "003-diverged.svg", "The paper's LS, variant F", axes, curves, (RIGHT, TOP))


def _scored(epochs: int, baseline: bool, *, differences: bool) -> Score:
    rng = np.random.default_rng([SEED, epochs])
    flights = [flight(rng, epochs, differences=differences, fixed=True) for _ in range(RUNS)]
    return score(flights, papers if baseline else aligned)


def _median(result: Score, what: str) -> float:
    columns = {"xy": [7, 8, 10, 11], "z": [9, 12]}[what]
    return float(np.median(np.abs(result.errors[:, columns])))


if __name__ == "__main__":
    trajectory()
    errors_against_count("003-ranges.svg", "Ranges, variant F", differences=False)
    errors_against_count("003-differences.svg", "Range differences, variant F", differences=True)
    diverged()
