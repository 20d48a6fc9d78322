"""How figures look: one colour a carrier in every plot, one time axis, one frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from bokeh.models import BasicTicker, BoxZoomTool, HoverTool, PanTool, ResetTool, WheelZoomTool
from bokeh.plotting import figure

from estimation.arrays import Array

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"
INK, FAINT, GRID, PAPER, SEA = "#1f2a37", "#66758a", "#e3e8ee", "#ffffff", "#f4f8fb"
TRUTH, FOUND = "#111827", "#b5179e"
"""What is true, and the tracks that were found."""
CARRIERS = (
    "#3b4cc0", "#d7301f", "#08a671", "#594128", "#cc79a7", "#78a64b", "#80395c", "#7a1fe0",
    "#5c81cc", "#e08e0b",
)  # fmt: skip
"""Of carriers in their order, the own one first; told apart by the colour-blind, too."""
PALE = 0.36
"""What is left of a colour that stands for something to be corrected."""
STATES = {
    "off": "#c3cad4",
    "observing": "#f2c14e",
    "candidate": "#7fb7e6",
    "applied": "#3a9d6e",
    "suspended": "#d64545",
}
Figure = Any
"""A `bokeh.plotting.figure`; its attributes are made at run time."""


def colours(carriers: Sequence[str]) -> dict[str, str]:
    """A colour for every carrier, the same on the whole page."""
    return {name: CARRIERS[n % len(CARRIERS)] for n, name in enumerate(carriers)}


def mixed(colour: str, ground: str, share: float) -> str:
    """A colour `#rrggbb`, so much of it, on a ground."""
    pairs = (int(c[n : n + 2], 16) for n in (1, 3, 5) for c in (colour, ground))
    return "#" + "".join(
        f"{round(share * over + (1 - share) * under):02x}"
        for over, under in zip(pairs, pairs, strict=True)
    )


def pale(colour: str) -> str:
    """A colour `#rrggbb` mixed with white."""
    return mixed(colour, PAPER, PALE)


_DARK_PAPER, _LIGHTER = "#17212d", 0.72
DARK = {
    INK: "#e6edf5", FAINT: "#9aabbd", GRID: "#2c3a4b", PAPER: _DARK_PAPER, SEA: "#121b26",
    TRUTH: "#f1f5f9", "white": _DARK_PAPER, "#b6c0cc": "#4a5a6c",
    **{colour: mixed(colour, PAPER, _LIGHTER) for colour in (*CARRIERS, FOUND)},
    **{pale(colour): mixed(colour, _DARK_PAPER, 0.6) for colour in (*CARRIERS, FOUND)},
}  # fmt: skip
"""Where a reader wants a dark page: a colour -> what stands for it there."""


class TimeUnit(NamedTuple):
    """What time axes are in."""

    name: str
    seconds: float

    def of(self, t_s: Array | float) -> Any:
        """Seconds in this unit."""
        return t_s / self.seconds


def time_unit(duration_s: float) -> TimeUnit:
    """A unit in which a run's length has two or three digits."""
    if duration_s <= 1200:
        return TimeUnit("s", 1.0)
    return TimeUnit("min", 60.0) if duration_s <= 3 * 3600 else TimeUnit("h", 3600.0)


def new_figure(height: int, **options: Any) -> Figure:
    """An empty figure as wide as its place on the page."""
    tools = [PanTool(), BoxZoomTool(), WheelZoomTool(), ResetTool()]
    plot: Figure = figure(
        height=height,
        sizing_mode=options.pop("sizing_mode", "stretch_width"),
        tools=options.pop("tools", tools),
        toolbar_location="right",
        output_backend="canvas",
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=GRID,
        min_border_left=62,
        min_border_right=16,
        **options,
    )
    plot.toolbar.logo = None
    plot.toolbar.autohide, plot.toolbar_inner = True, True
    plot.grid.grid_line_color = GRID
    for axis in plot.axis:
        axis.axis_line_color = axis.major_tick_line_color = "#b6c0cc"
        axis.minor_tick_line_color = None
        axis.major_label_text_color = axis.axis_label_text_color = FAINT
        axis.major_label_text_font_size, axis.axis_label_text_font_size = "12px", "12px"
        axis.major_label_text_font = axis.axis_label_text_font = FONT
        axis.axis_label_text_font_style = "normal"
    if plot.title:
        plot.title.text_color, plot.title.text_font = INK, FONT
        plot.title.text_font_size, plot.title.text_font_style = "13px", "bold"
    return plot


def whole_numbers(plot: Figure) -> None:
    """A y axis of counts: from 0, and no halves."""
    plot.y_range.start = 0
    plot.yaxis.ticker = BasicTicker(min_interval=1)


def hover(renderers: Sequence[Any], tooltips: Any, **options: Any) -> Any:
    """A hover tool for some renderers: of each the nearest; it has no button of its own."""
    return HoverTool(renderers=[*renderers], tooltips=tooltips, visible=False, limit=1, **options)
