"""Draws the figures of docs/papers/000.md: `python docs/papers/figures/000.py`, from the root.

The numbers are measured anew.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[2]))

from bench import svg  # noqa: E402
from bench.figures import seconds  # noqa: E402
from bench.registration.adjusted import measure as adjusted  # noqa: E402
from bench.registration.published import measure as published  # noqa: E402
from bench.registration.scenes import DEG, experiment, logs_of  # noqa: E402
from bench.svg import LEFT, RIGHT, Curve, logarithmic  # noqa: E402
from estimation.relative_frame import adjustment, closed_form, closed_form_dense  # noqa: E402

RUNS = 4000


def plot(
    name: str, title: str, labels: tuple[str, str], curves: Sequence[Curve], legend_x: int
) -> None:
    """Write a plot with both axes logarithmic."""
    x = logarithmic(labels[0], [x for c in curves for x in c.x])
    y = logarithmic(labels[1], [y for c in curves for y in c.y], padded=True)
    svg.plot(HERE / name, title, (x, y), curves, (legend_x, svg.TOP))


def ratio_against_length() -> None:
    """RMS error after / before, own axes, with the bound."""
    lengths = (1, 2, 3, 4, 7, 10, 20, 50, 100)
    means = [published(1, RUNS, pairs) for pairs in lengths]
    after = np.array([np.sqrt(m.after / m.prior) for m in means])
    bound = np.array([np.sqrt(m.bound / m.prior) for m in means])
    curves = []
    for column, name, colour in (
        (0, "location, fixed axes", "#c44"),
        (1, "location, own axes", "#26a"),
        (2, "orientation", "#283"),
    ):
        curves.append(Curve(name, lengths, after[:, column].tolist(), colour))
        curves.append(Curve("its bound", lengths, bound[:, column].tolist(), colour, dashed=True))
    labels = "L, common targets", "ratio"
    plot("000-ratio.svg", "RMS error after / before", labels, curves, RIGHT)


def error_against_heading() -> None:
    """RMSE / bound of the location at L = 7, own axes, as headings get worse."""
    sigmas = (1, 2, 3, 5, 10, 20, 30)
    once, exact = [], []
    for sigma in sigmas:
        m = published(1, RUNS, 7, sigma * DEG)
        once.append(float(np.sqrt(m.after / m.bound)[1]))
        exact.append(adjusted(1, RUNS, 7, sigma * DEG).location)
    curves = [
        Curve("one linearisation", sigmas, once, "#c44"),
        Curve("exact adjustment", sigmas, exact, "#26a"),
    ]
    title = "Location error / bound, L = 7, own axes"
    plot("000-heading.svg", title, ("heading sigma, deg", "RMSE / bound"), curves, LEFT)


def time_against_length() -> None:
    """Seconds of the three methods."""
    rng = np.random.default_rng(1)
    curves = []
    for name, method, lengths, colour in (
        ("dense, O(L^3)", closed_form_dense, (1, 10, 100, 300, 1000), "#c44"),
        ("closed form, O(L)", closed_form, (1, 10, 100, 1000, 10_000, 100_000), "#283"),
        ("exact adjustment, O(L)", adjustment, (1, 10, 100, 1000, 10_000, 100_000), "#26a"),
    ):
        times = []
        for pairs in lengths:
            logs = logs_of(experiment(rng, (), pairs))
            times.append(seconds(lambda m=method, a=logs: m(*a)) * 1e3)
        curves.append(Curve(name, lengths, times, colour))
    plot("000-time.svg", "Time of one registration", ("L, common targets", "ms"), curves, LEFT)


if __name__ == "__main__":
    ratio_against_length()
    error_against_heading()
    time_against_length()
