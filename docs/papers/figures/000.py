"""Draws the figures of docs/papers/000.md: `python docs/papers/figures/000.py`, from the root.

Plain SVG, a few lines each, so that no plotting library is needed. The numbers are measured anew.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[2]))

from bench.figures import seconds  # noqa: E402
from bench.registration.adjusted import measure as adjusted  # noqa: E402
from bench.registration.published import measure as published  # noqa: E402
from bench.registration.scenes import DEG, experiment, logs_of  # noqa: E402
from estimation.relative_frame import adjustment, closed_form, closed_form_dense  # noqa: E402

RUNS = 4000
WIDTH, HEIGHT, MARGIN = 560, 360, 56
LEFT, RIGHT = MARGIN + 12, WIDTH - MARGIN - 190  # of the legend: where no curve runs


class Curve(NamedTuple):
    """One line of a plot."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    colour: str
    dashed: bool = False


def plot(
    name: str, title: str, labels: tuple[str, str], curves: Sequence[Curve], legend_x: int
) -> None:
    """Write a plot with both axes logarithmic."""
    xs = [math.log10(x) for c in curves for x in c.x]
    ys = [math.log10(y) for c in curves for y in c.y]
    low_x, high_x = min(xs), max(xs)
    low_y, high_y = math.floor(min(ys) * 2) / 2, math.ceil(max(ys) * 2) / 2

    def at(x: float, y: float) -> tuple[float, float]:
        right = (math.log10(x) - low_x) / (high_x - low_x)
        up = (math.log10(y) - low_y) / (high_y - low_y)
        return MARGIN + right * (WIDTH - 2 * MARGIN), HEIGHT - MARGIN - up * (HEIGHT - 2 * MARGIN)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        _label(WIDTH / 2, 24, title),
        _label(WIDTH / 2, HEIGHT - 12, labels[0]),
        f'<g transform="rotate(-90 16 {HEIGHT / 2})">{_label(16, HEIGHT / 2, labels[1])}</g>',
    ]
    for x in _ticks(low_x, high_x):
        foot, head = at(x, 10**low_y), at(x, 10**high_y)
        parts += [_line([foot, head], "#ddd", 1), _label(foot[0], foot[1] + 16, f"{x:g}")]
    for y in _ticks(low_y, high_y):
        left, right = at(10**low_x, y), at(10**high_x, y)
        label = _label(left[0] - 6, left[1] + 4, f"{y:g}", "end")
        parts += [_line([left, right], "#ddd", 1), label]
    for row, curve in enumerate(curves):
        points = [at(x, y) for x, y in zip(curve.x, curve.y, strict=True)]
        parts += [
            _line(points, curve.colour, 2, dashed=curve.dashed),
            *_legend(legend_x, row, curve),
        ]
        if not curve.dashed:
            parts += [_dot(point, curve.colour) for point in points]
    (HERE / name).write_text("\n".join([*parts, "</svg>"]) + "\n", encoding="utf-8")


def _legend(left: int, row: int, curve: Curve) -> list[str]:
    height = MARGIN + 12 + 17 * row
    stroke = _line([(left, height), (left + 24, height)], curve.colour, 2, dashed=curve.dashed)
    return [stroke, _label(left + 30, height + 4, curve.name, "start")]


def _label(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" text-anchor="{anchor}">{text}</text>'


def _dot(point: tuple[float, float], colour: str) -> str:
    return f'<circle cx="{point[0]:.1f}" cy="{point[1]:.1f}" r="3" fill="{colour}"/>'


def _ticks(low: float, high: float) -> list[float]:
    """1, 2, 5 of every decade between two powers of ten."""
    every = [m * 10.0**e for e in range(math.floor(low), math.ceil(high) + 1) for m in (1, 2, 5)]
    if high - low > 2.5:
        every = every[::3]
    return [t for t in every if low - 1e-9 <= math.log10(t) <= high + 1e-9]


def _line(
    points: Sequence[tuple[float, float]], colour: str, width: int, *, dashed: bool = False
) -> str:
    through = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dash = ' stroke-dasharray="6 4"' if dashed else ""
    return (
        f'<polyline points="{through}" fill="none" stroke="{colour}" stroke-width="{width}"{dash}/>'
    )


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
