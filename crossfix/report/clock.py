"""Plots over scenario time: one axis for all of them, and the marks they share."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from bokeh.models import ColumnDataSource, Range1d
from bokeh.models.annotations.geometry import Span as Rule

from estimation.arrays import Array

from .style import Figure, TimeUnit, hover, new_figure
from .thinning import stride

AIR = 0.01
"""Share of the time axis left free at its ends, for marks that stand there."""
POINTS = 1_200
"""Of one curve; a screen shows no more."""
USUAL = (2.0, 98.0)
"""Percentiles that must fit into a plot: what was there before convergence may be anywhere."""


class Clock:
    """The time axis that all plots over scenario time share: zooming one zooms them all."""

    def __init__(self, unit: TimeUnit, duration_s: float) -> None:
        self.unit = unit
        end = float(unit.of(max(duration_s, 1.0)))
        self._range = Range1d(start=-AIR * end, end=(1 + AIR) * end)

    def figure(self, height: int, **options: Any) -> Figure:
        """An empty plot over it."""
        label = f"scenario time [{self.unit.name}]"
        return new_figure(height, x_range=self._range, x_axis_label=label, **options)

    def columns(self, t_s: Array, **columns: Array) -> ColumnDataSource:
        """Some values of each column over time `t`, evenly, in single precision."""
        some = stride(len(t_s), POINTS)
        data = {name: np.float32(column[some]) for name, column in columns.items()}
        return ColumnDataSource({"t": np.float32(self.unit.of(t_s[some])), **data})

    def hover(self, renderer: Any, **shown: str) -> Any:
        """What a curve tells where the pointer is over its time: label -> format."""
        rows = [("time", f"@t{{0.0}} {self.unit.name}"), *shown.items()]
        return hover([renderer], rows, mode="vline")


def rule(
    plot: Figure, at: float, colour: str, dimension: Literal["width", "height"] = "width"
) -> None:
    """A thin line across a plot."""
    plot.add_layout(
        Rule(location=at, dimension=dimension, line_color=colour, line_width=1, level="underlay")
    )


def usual_range(*columns: Array) -> Range1d:
    """A range in which all columns usually lie, with some air."""
    known = [column[np.isfinite(column)] for column in columns]
    ends = np.array([np.percentile(column, USUAL) for column in known if len(column)])
    low, high = (float(ends.min()), float(ends.max())) if len(ends) else (0.0, 1.0)
    air = 0.15 * (high - low) or max(abs(high), 1.0) * 0.1
    return Range1d(start=low - air, end=high + air)
