"""Plots of the picture against the truth: GOSPA, what is missed or false, errors of tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crossfix.tracking_errors import PictureError

from .clock import Clock
from .story import Story
from .style import FAINT, FOUND, STATES, TRUTH, Figure

HEIGHT = 210
MISSED, FALSE = ("missed targets", STATES["suspended"]), ("false tracks", STATES["observing"])


def picture_plots(story: Story, clock: Clock) -> list[Figure]:
    """GOSPA, numbers and errors over time; none where no truth is known."""
    errors = story.picture_errors
    if not errors:
        return []
    t_s = np.array([story.time_s(error.t_ns) for error in errors])
    return [_gospa(t_s, errors, clock), _numbers(t_s, errors, clock), _error(t_s, errors, clock)]


def _gospa(t_s: np.ndarray, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="GOSPA [m]")
    plot.y_range.start = 0
    source = clock.columns(t_s, gospa=np.array([error.gospa_m for error in errors]))
    plot.varea("t", 0, "gospa", source=source, fill_color=FOUND, fill_alpha=0.12)
    line = plot.line("t", "gospa", source=source, line_color=FOUND, line_width=1.6)
    plot.add_tools(clock.hover(line, GOSPA="@gospa{0} m"))
    return plot


def _numbers(t_s: np.ndarray, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="missed and false")
    plot.y_range.start = 0
    source = clock.columns(
        t_s,
        missed=np.array([error.missed for error in errors]),
        false=np.array([error.false for error in errors]),
    )
    for column, (_, colour) in (("missed", MISSED), ("false", FALSE)):
        line = plot.step("t", column, source=source, line_color=colour, line_width=2, mode="after")
        plot.add_tools(clock.hover(line, **{column: f"@{column}{{0}}"}))
    return plot


def _error(t_s: np.ndarray, errors: Sequence[PictureError], clock: Clock) -> Figure:
    plot = clock.figure(HEIGHT, title="error of tracks [m]")
    plot.y_range.start = 0
    claimed = np.array([error.sigma_m for error in errors])
    source = clock.columns(t_s, error=np.array([e.error_m for e in errors]), claimed=claimed)
    line = plot.line("t", "error", source=source, line_color=FOUND, line_width=1.6)
    plot.line("t", "claimed", source=source, line_color=TRUTH, line_dash=[5, 4], line_width=1.3)
    plot.add_tools(clock.hover(line, error="@error{0.0} m", claimed="@claimed{0.0} m"))
    return plot


KEY = (MISSED, FALSE, ("claimed, dashed", FAINT))
"""What the colours mean."""
