"""Plots of corrections: what they add and what error remains, their states, their NEES."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource, PrintfTickFormatter, Range1d
from bokeh.models.annotations.geometry import BoxAnnotation
from bokeh.models.annotations.labels import Label

from estimation.arrays import Array
from estimation.relative_frame.observability import DETERMINED, WEAK

from .clock import POINTS, Clock, rule, usual_range
from .figures import DIMENSIONS, nees_interval
from .innovations import draw_squares
from .series import FrameSeries
from .sources import squares_over_time
from .style import FAINT, STATES, TRUTH, Figure, hover, new_figure, whole_numbers
from .thinning import stride
from .tracks import SIGMAS, ellipse

HEIGHT = 210
MEAN_OF = 30
"""NEES values in the moving mean."""
LEAST_NEES = 1e-3
LEAST_RATIO = 1e-4


class Part(NamedTuple):
    """One of the three numbers of a correction, as people read it."""

    column: int
    name: str
    unit: str
    scale: float
    digits: str


PARTS = (
    Part(0, "east", "m", 1.0, "0"),
    Part(1, "north", "m", 1.0, "0"),
    Part(2, "orientation", "deg", degrees(1.0), "0.00"),
)


def correction_plots(series: FrameSeries, clock: Clock, colour: str) -> list[Figure]:
    """What the correction adds, what error remains if truth is known, and what it rests on."""
    plots = [_added(series, clock, colour, part) for part in PARTS]
    if np.isfinite(series.truth).any():
        plots += [_remaining(series, clock, colour, part) for part in PARTS]
    rests_on = (_directions, _pairs, _misclosures)
    return plots + [plot(series, clock, colour) for plot in rests_on]


def _added(series: FrameSeries, clock: Clock, colour: str, part: Part) -> Figure:
    value, half, truth = _of(part, series.estimate, SIGMAS * series.sigma, series.truth)
    plot = clock.figure(HEIGHT, title=f"{part.name}: added [{part.unit}]")
    plot.y_range = usual_range(value - half, value + half, truth)
    source = clock.columns(
        series.t_s, value=value, low=value - half, high=value + half, half=half, truth=truth
    )
    plot.varea("t", "low", "high", source=source, fill_color=colour, fill_alpha=0.18)
    line = plot.line("t", "value", source=source, line_color=colour, line_width=1.6)
    plot.line("t", "truth", source=source, line_color=TRUTH, line_dash=[5, 4], line_width=1.4)
    unit = f"{{{part.digits}}} {part.unit}"
    plot.add_tools(clock.hover(line, added=f"@value{unit}", truth=f"@truth{unit}"))
    return plot


def _remaining(series: FrameSeries, clock: Clock, colour: str, part: Part) -> Figure:
    error, half = _of(part, series.error, SIGMAS * series.sigma)
    plot = clock.figure(HEIGHT, title=f"{part.name}: error that remains [{part.unit}]")
    plot.y_range = usual_range(error, half, -half)
    rule(plot, 0.0, TRUTH)
    source = clock.columns(series.t_s, value=error, low=-half, high=half)
    plot.varea("t", "low", "high", source=source, fill_color=colour, fill_alpha=0.18)
    line = plot.line("t", "value", source=source, line_color=colour, line_width=1.1)
    unit = f"{{{part.digits}}} {part.unit}"
    plot.add_tools(clock.hover(line, error=f"@value{unit}", two_sigma=f"@high{unit}"))
    return plot


def _directions(series: FrameSeries, clock: Clock, colour: str) -> Figure:
    """How far the data inform each direction: below `DETERMINED` it is determined."""
    plot = clock.figure(HEIGHT, title="directions: posterior / prior sigma", y_axis_type="log")
    plot.y_range = Range1d(start=LEAST_RATIO, end=2.0)
    plot.yaxis.formatter = PrintfTickFormatter(format="%g")
    columns = {name: series.ratios[:, n] for n, name in enumerate(("weakest", "middle", "best"))}
    source = clock.columns(series.t_s, **columns)
    for limit in (DETERMINED, WEAK):
        rule(plot, limit, FAINT)
    plot.add_layout(Label(
        x=6, x_units="screen", y=DETERMINED, y_offset=-13, text="determined below",
        text_color=FAINT, text_font_size="11px",
    ))  # fmt: skip
    lines = [
        plot.line("t", name, source=source, line_color=colour, line_width=width, line_alpha=0.8)
        for name, width in zip(columns, (2.4, 1.2, 1.2), strict=True)
    ]
    plot.add_tools(clock.hover(lines[0], **{name: f"@{name}{{0.0000}}" for name in columns}))
    return plot


def _pairs(series: FrameSeries, clock: Clock, colour: str) -> Figure:
    plot = clock.figure(HEIGHT, title="associated pairs used [number]")
    whole_numbers(plot)
    source = clock.columns(series.t_s, pairs=series.pairs)
    line = plot.step("t", "pairs", source=source, mode="after", line_color=colour, line_width=1.4)
    plot.add_tools(clock.hover(line, pairs="@pairs{0}"))
    return plot


def _misclosures(series: FrameSeries, clock: Clock, colour: str) -> Figure:
    """The chi2 of what each correction was found with, by its degrees of freedom."""
    plot = clock.figure(HEIGHT, title="misclosures: chi2 / degree of freedom")
    found = squares_over_time(series.t_s, series.chi2, series.dof, float(series.t_s[-1]))
    plot.y_range = Range1d(start=0, end=usual_range(found.mean, found.high).end)
    draw_squares(plot, found, clock, colour, "chi2")
    return plot


def _of(part: Part, *columns: Array) -> list[Array]:
    return [column[:, part.column] * part.scale for column in columns]


def state_plot(series: Sequence[FrameSeries], clock: Clock) -> Figure:
    """One bar a carrier, coloured by the state of its correction."""
    names = [s.carrier for s in reversed(series)]
    plot = clock.figure(56 + 30 * len(names), y_range=names)
    spans = [(s.carrier, span) for s in series for span in s.states]
    source = ColumnDataSource({
        "carrier": [carrier for carrier, _ in spans],
        "left": clock.unit.of(np.array([span.from_s for _, span in spans])),
        "right": clock.unit.of(np.array([span.to_s for _, span in spans])),
        "state": [span.name for _, span in spans],
        "colour": [STATES[span.name] for _, span in spans],
    })  # fmt: skip
    bars = plot.hbar(
        y="carrier", left="left", right="right", source=source, height=0.62, color="colour"
    )
    unit = clock.unit.name
    shown = [("carrier", "@carrier"), ("state", "@state"), ("from", f"@left{{0.0}} {unit}")]
    plot.add_tools(hover([bars], [*shown, ("to", f"@right{{0.0}} {unit}")]))
    plot.ygrid.grid_line_color = None
    return plot


def nees_plot(
    series: Sequence[FrameSeries], clock: Clock, colours: Mapping[str, str]
) -> Figure | None:
    """NEES per dimension with the interval of single values; None where no truth is known."""
    if not any(s.errors for s in series):
        return None
    low, high = nees_interval()
    plot = clock.figure(300, y_axis_type="log", y_axis_label="NEES / 3")
    plot.y_range = Range1d(start=0.01, end=20.0)
    plot.yaxis.ticker = [0.01, 0.1, 1, 10]
    plot.yaxis.formatter = PrintfTickFormatter(format="%g")
    plot.add_layout(BoxAnnotation(
        bottom=low, top=high, fill_color=STATES["applied"], fill_alpha=0.12, level="underlay"
    ))  # fmt: skip
    rule(plot, 1.0, FAINT)
    for s in series:
        nees = np.maximum(s.nees / DIMENSIONS, LEAST_NEES)
        source = clock.columns(s.t_s, nees=nees, mean=_moving_mean(s.nees / DIMENSIONS))
        colour = colours[s.carrier]
        dots = plot.scatter("t", "nees", source=source, size=4, color=colour, alpha=0.35)
        plot.line("t", "mean", source=source, line_color=colour, line_width=2.2)
        plot.add_tools(hover([dots], [(s.carrier, "@nees{0.00}"), ("mean", "@mean{0.00}")]))
    return plot


def error_cloud(series: FrameSeries, colour: str) -> Figure | None:
    """Errors of the place over the second half of the run, seen from above."""
    late = series.errors[len(series.errors) // 2 :]
    if not late:
        return None
    east, north = np.array([error.after_m for error in late])[stride(len(late), POINTS)].T
    plot = new_figure(
        300,
        title=series.carrier,
        match_aspect=True,
        x_axis_label="east [m]",
        y_axis_label="north [m]",
    )
    rule(plot, 0.0, FAINT, "width")
    rule(plot, 0.0, FAINT, "height")
    two_sigma = ellipse(0.0, np.zeros(2), series.place_covariance)
    plot.ellipse(
        0, 0, *two_sigma.axes_m.tolist(), two_sigma.angle_rad,
        fill_color=colour, fill_alpha=0.12, line_color=colour, line_width=2,
    )  # fmt: skip
    plot.scatter(east, north, size=4, color=colour, alpha=0.5)
    return plot


def _moving_mean(values: Array) -> Array:
    """Mean of the last values (n,), nan before there are enough, and where one is unknown."""
    mean = np.full(len(values), np.nan)
    if len(values) >= MEAN_OF:
        kernel = np.full(MEAN_OF, 1 / MEAN_OF)
        mean[MEAN_OF - 1 :] = np.convolve(values, kernel, mode="valid")
    return mean
