"""Plots of NIS: how far the plots of each source lie from what their tracks had foretold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .clock import Clock, rule
from .sources import SquaresOverTime, nis_over_time, told_of
from .story import Story
from .style import FAINT, STATES, Figure

HEIGHT = 210


def nis_plots(story: Story, clock: Clock, colours: Mapping[str, str]) -> list[Figure]:
    """One plot a source whose plots were held against tracks."""
    end_s = story.time_s(story.end_ns)
    every = {source: nis_over_time(told, end_s) for source, told in told_of(story).items()}
    return [
        _plot(" ".join(source), found, clock, colours.get(source[0], FAINT))
        for source, found in every.items()
        if np.isfinite(found.mean).any()
    ]


def _plot(name: str, found: SquaresOverTime, clock: Clock, colour: str) -> Figure:
    plot = clock.figure(HEIGHT, title=f"{name}: NIS / degree of freedom")
    plot.y_range.start = 0
    draw_squares(plot, found, clock, colour, "NIS")
    return plot


def draw_squares(
    plot: Figure, found: SquaresOverTime, clock: Clock, colour: str, name: str
) -> None:
    """A line of averaged squares in the band where honest sigmas put it."""
    source = clock.columns(found.t_s, mean=found.mean, low=found.low, high=found.high)
    plot.varea("t", "low", "high", source=source, fill_color=STATES["applied"], fill_alpha=0.2)
    rule(plot, 1.0, FAINT)
    line = plot.line("t", "mean", source=source, line_color=colour, line_width=1.8)
    told = {name: "@mean{0.00}", "honest": "@low{0.00} to @high{0.00}"}
    plot.add_tools(clock.hover(line, **told))
