"""Plots of curves as plain SVG, a few lines each, so that no plotting library is needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

WIDTH, HEIGHT, MARGIN = 560, 360, 56
LEFT, RIGHT = MARGIN + 12, WIDTH - MARGIN - 190
TOP, BOTTOM = MARGIN + 12, HEIGHT - MARGIN - 80
"""Of the legend: where no curve runs."""


class Curve(NamedTuple):
    """One line of a plot."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    colour: str
    dashed: bool = False


class Axis(NamedTuple):
    """How values lie along an axis: from `low` to `high`, where `ticks` are written.

    Attributes:
        scale: of a value, such as its logarithm; `low` and `high` are scaled already.
    """

    label: str
    low: float
    high: float
    ticks: Sequence[float]
    scale: Callable[[float], float]

    def share(self, value: float) -> float:
        """How far along the axis a value lies, 0 to 1."""
        return (self.scale(value) - self.low) / (self.high - self.low)


def logarithmic(label: str, values: Sequence[float], *, padded: bool = False) -> Axis:
    """An axis by decades, ticks at 1, 2, 5; padded to half decades."""
    low, high = (math.log10(value) for value in (min(values), max(values)))
    if padded:
        low, high = math.floor(low * 2) / 2, math.ceil(high * 2) / 2
    every = [m * 10.0**e for e in range(math.floor(low), math.ceil(high) + 1) for m in (1, 2, 5)]
    if high - low > 2.5:
        every = every[::3]
    return Axis(label, low, high, _between(every, low, high, math.log10), math.log10)


def linear(label: str, low: float, high: float, step: float) -> Axis:
    """An axis with a tick at every multiple of a step."""
    count = math.floor((high - low) / step + 1e-9) + 1
    return Axis(label, low, high, [low + step * i for i in range(count)], float)


def plot(
    path: Path,
    title: str,
    axes: tuple[Axis, Axis],
    curves: Sequence[Curve],
    legend: tuple[float, float],
) -> None:
    """Write a plot: curves over grid lines, dots where they were measured.

    Args:
        legend: where its first line begins, right and down from the corner.
    """
    x_axis, y_axis = axes

    def at(x: float, y: float) -> tuple[float, float]:
        right, up = x_axis.share(x), y_axis.share(y)
        return MARGIN + right * (WIDTH - 2 * MARGIN), HEIGHT - MARGIN - up * (HEIGHT - 2 * MARGIN)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        _label(WIDTH / 2, 24, title),
        _label(WIDTH / 2, HEIGHT - 12, x_axis.label),
        f'<g transform="rotate(-90 16 {HEIGHT / 2})">{_label(16, HEIGHT / 2, y_axis.label)}</g>',
        *_grid(x_axis, y_axis),
    ]
    for row, curve in enumerate(curves):
        points = [at(x, y) for x, y in zip(curve.x, curve.y, strict=True)]
        parts += [_line(points, curve.colour, 2, dashed=curve.dashed)]
        parts += _legend(legend[0], legend[1] + 17 * row, curve)
        parts += [] if curve.dashed else [_dot(point, curve.colour) for point in points]
    path.write_text("\n".join([*parts, "</svg>"]) + "\n", encoding="utf-8")


def _between(
    ticks: Sequence[float], low: float, high: float, scale: Callable[[float], float]
) -> list[float]:
    return [tick for tick in ticks if low - 1e-9 <= scale(tick) <= high + 1e-9]


def _grid(x_axis: Axis, y_axis: Axis) -> list[str]:
    left, right, foot, head = MARGIN, WIDTH - MARGIN, HEIGHT - MARGIN, MARGIN
    parts = []
    for tick in x_axis.ticks:
        x = left + x_axis.share(tick) * (right - left)
        parts += [_line([(x, foot), (x, head)], "#ddd", 1), _label(x, foot + 16, f"{tick:g}")]
    for tick in y_axis.ticks:
        y = foot - y_axis.share(tick) * (foot - head)
        label = _label(left - 6, y + 4, f"{tick:g}", "end")
        parts += [_line([(left, y), (right, y)], "#ddd", 1), label]
    return parts


def _legend(left: float, height: float, curve: Curve) -> list[str]:
    stroke = _line([(left, height), (left + 24, height)], curve.colour, 2, dashed=curve.dashed)
    return [stroke, _label(left + 30, height + 4, curve.name, "start")]


def _label(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" text-anchor="{anchor}">{text}</text>'


def _dot(point: tuple[float, float], colour: str) -> str:
    return f'<circle cx="{point[0]:.1f}" cy="{point[1]:.1f}" r="3" fill="{colour}"/>'


def _line(
    points: Sequence[tuple[float, float]], colour: str, width: int, *, dashed: bool = False
) -> str:
    through = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dash = ' stroke-dasharray="6 4"' if dashed else ""
    return (
        f'<polyline points="{through}" fill="none" stroke="{colour}" stroke-width="{width}"{dash}/>'
    )
