"""Plots of the picture against the truth: GOSPA and its parts, counts, errors and NEES."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource

from crossfix.evaluation import PictureError, names_changed
from crossfix.evaluation.pictures import PLACE_DIMENSIONS
from estimation.arrays import Array

from .clock import Clock, rule
from .sources import mean_interval
from .story import Story
from .style import FAINT, FOUND, STATES, TRUTH, Figure, whole_numbers

HEIGHT = 210
USUAL_PERCENT, AIR = 98.0, 1.5
"""What almost all values lie below must fit into a plot, with as much air."""


class Curve(NamedTuple):
    """One curve of the section, as the key names it."""

    words: str
    colour: str
    dash: tuple[int, ...] = ()


TOTAL = Curve("GOSPA, tracks, their error", FOUND)
LOCALISATION = Curve("localisation", "#0288d1", (6, 3))
MISSED = Curve("missed targets", STATES["suspended"], (2, 2))
FALSE = Curve("false tracks", "#e08e0b")
TRUE = Curve("true targets, claimed error", TRUTH, (5, 4))
CURVES = (TOTAL, LOCALISATION, MISSED, FALSE, TRUE)


def picture_plots(story: Story, clock: Clock) -> list[Figure]:
    """GOSPA, numbers, errors and NEES over time; none where no truth is known or nothing is."""
    errors = story.picture_errors
    if not any(error.targets or error.tracks for error in errors):
        return []
    t_s = np.array([story.time_s(error.t_ns) for error in errors])
    draw = (_gospa, _missed_and_false, _numbers, _error, _nees, _names)
    return [plot(t_s, errors, clock) for plot in draw]


def _gospa(t_s: Array, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="GOSPA and its parts [m]")
    parts = {
        "missed": (MISSED, [e.missed_m for e in errors]),
        "false": (FALSE, [e.false_m for e in errors]),
        "total": (TOTAL, [e.gospa_m for e in errors]),
        "localisation": (LOCALISATION, [e.localisation_m for e in errors]),
    }
    source = clock.columns(t_s, **{name: np.array(values) for name, (_, values) in parts.items()})
    plot.y_range.start = 0
    plot.varea("t", 0, "total", source=source, fill_color=FOUND, fill_alpha=0.1)
    lines = [_line(plot, source, name, curve) for name, (curve, _) in parts.items()]
    shown = {name: f"@{name}{{0.0}} m" for name in parts}
    plot.add_tools(clock.hover(lines[0], **shown))
    return plot


def _missed_and_false(t_s: Array, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="missed and false [number]")
    counts = {"missed": [e.missed for e in errors], "false": [e.false for e in errors]}
    source = clock.columns(t_s, **{name: np.array(count) for name, count in counts.items()})
    whole_numbers(plot)
    for name, curve in (("missed", MISSED), ("false", FALSE)):
        line = _line(plot, source, name, curve, stepped=True)
        plot.add_tools(clock.hover(line, **{name: f"@{name}{{0}}"}))
    return plot


def _numbers(t_s: Array, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="tracks and true targets [number]")
    counts = {"tracks": [e.tracks for e in errors], "targets": [e.targets for e in errors]}
    source = clock.columns(t_s, **{name: np.array(count) for name, count in counts.items()})
    whole_numbers(plot)
    line = _line(plot, source, "tracks", TOTAL, stepped=True)
    _line(plot, source, "targets", TRUE, stepped=True)
    plot.add_tools(clock.hover(line, tracks="@tracks{0}", targets="@targets{0}"))
    return plot


def _error(t_s: Array, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="error of tracks, and as claimed [m]")
    found, claimed = np.array([e.error_m for e in errors]), np.array([e.sigma_m for e in errors])
    plot.y_range.start, plot.y_range.end = 0, _usual_end(found, claimed)
    source = clock.columns(t_s, error=found, claimed=claimed)
    line = _line(plot, source, "error", TOTAL)
    _line(plot, source, "claimed", TRUE)
    plot.add_tools(clock.hover(line, error="@error{0.0} m", claimed="@claimed{0.0} m"))
    return plot


def _nees(t_s: Array, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="NEES of tracks / dimension")
    low, high = mean_interval(PLACE_DIMENSIONS * np.array([len(e.pairs) for e in errors]))
    nees = np.array([e.nees for e in errors]) / PLACE_DIMENSIONS
    source = clock.columns(t_s, nees=nees, low=low, high=high)
    plot.y_range.start, plot.y_range.end = 0, _usual_end(nees, high)
    plot.varea("t", "low", "high", source=source, fill_color=STATES["applied"], fill_alpha=0.2)
    rule(plot, 1.0, FAINT)
    line = _line(plot, source, "nees", TOTAL)
    plot.add_tools(clock.hover(line, NEES="@nees{0.00}", honest="@low{0.00} to @high{0.00}"))
    return plot


def _names(t_s: Array, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="names changed so far [number]")
    source = clock.columns(t_s, changes=names_changed(errors))
    whole_numbers(plot)
    line = _line(plot, source, "changes", TOTAL, stepped=True)
    plot.add_tools(clock.hover(line, changes="@changes{0}"))
    return plot


def _line(
    plot: Figure, source: ColumnDataSource, column: str, curve: Curve, *, stepped: bool = False
) -> Any:
    look: dict[str, Any] = {
        "line_color": curve.colour,
        "line_dash": [*curve.dash],
        "line_width": 1.6,
    }
    if stepped:
        return plot.step("t", column, source=source, mode="after", **look)
    return plot.line("t", column, source=source, **look)


def _usual_end(*columns: Array) -> float:
    """Up to where a plot reaches: what was there before convergence may lie outside."""
    known = np.concatenate([column[np.isfinite(column)] for column in columns])
    return AIR * float(np.percentile(known, USUAL_PERCENT)) if len(known) else 1.0
