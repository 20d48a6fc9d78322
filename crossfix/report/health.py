"""Plots of a run's health: who took part, what went wrong when, what was lost, how fast it was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from bokeh.models import ColumnDataSource

from schemas import keys
from schemas.messages import ProcessState

from .accounts import News, centre_of, paces_of
from .clock import Clock
from .series import Span
from .story import Story
from .style import FAINT, INK, STATES, Figure, hover, new_figure

NEWS = "news"
LOSSES = {
    "gaps": ("fetched again", STATES["candidate"]),
    "duplicates": ("duplicates", STATES["off"]),
    "late": ("late", STATES["observing"]),
    "gave_up": ("never had", STATES["suspended"]),
    "rejected": ("refused", "#8e44ad"),
    "unclaimed": ("never claimed", "#6d4c41"),
    "queue_drops": ("dropped in a queue", "#c2185b"),
}
"""What is counted -> in words, and its colour."""
FUSED, GRANTED = ("fused", STATES["applied"]), ("granted by the world", INK)
"""Curves of the pace, and their colours."""


def presence_plot(
    presence: Mapping[str, Sequence[Span]],
    news: Sequence[News],
    clock: Clock,
    colours: Mapping[str, str],
) -> Figure | None:
    """One bar a carrier while it took part, and a mark for each thing that happened."""
    if not news and not any(presence.values()):
        return None
    rows = ([NEWS] if news else []) + [*presence][::-1]
    plot = clock.figure(56 + 30 * len(rows), y_range=rows)
    spans = [(name, span) for name, found in presence.items() for span in found]
    source = ColumnDataSource({
        "carrier": [name for name, _ in spans],
        "left": clock.unit.of(np.array([span.from_s for _, span in spans])),
        "right": clock.unit.of(np.array([span.to_s for _, span in spans])),
        "colour": [colours.get(name, FAINT) for name, _ in spans],
    })  # fmt: skip
    bars = plot.hbar(
        y="carrier", left="left", right="right", source=source, height=0.5, color="colour"
    )
    unit = clock.unit.name
    plot.add_tools(hover([bars], [
        ("carrier", "@carrier"), ("from", f"@left{{0.0}} {unit}"), ("to", f"@right{{0.0}} {unit}"),
    ]))  # fmt: skip
    if news:
        _mark_news(plot, news, clock)
    plot.ygrid.grid_line_color = None
    return plot


def _mark_news(plot: Figure, news: Sequence[News], clock: Clock) -> None:
    times = clock.unit.of(np.array([item.t_s for item in news]))
    texts = [item.text for item in news]
    source = ColumnDataSource({"t": times, "row": [NEWS] * len(news), "text": texts})
    marks = plot.scatter(
        "t", "row", source=source, size=10, marker="diamond", color=INK, line_color="white"
    )
    plot.add_tools(hover([marks], [("", "@text")]))


def losses_over_time(story: Story) -> dict[str, np.ndarray]:
    """Count after each word of the fusion centre, of what was ever counted."""
    counted = {
        name: np.array([
            sum(health.queue_drops.values()) if name == "queue_drops"
            else sum(getattr(stream, name) for stream in health.streams)
            for health in story.health
        ])
        for name in LOSSES
    }  # fmt: skip
    return {name: counts for name, counts in counted.items() if counts.any()}


def loss_plot(story: Story, clock: Clock) -> Figure | None:
    """Everything that was not simply received, counted up; None where there is nothing."""
    losses = losses_over_time(story)
    if not losses:
        return None
    plot = clock.figure(240, y_axis_label="messages so far")
    known_s = [story.step_s(health.step) for health in story.health]
    t_s = np.array([0.0, *known_s, story.time_s(story.end_ns)])
    for name, counts in losses.items():
        words, colour = LOSSES[name]
        source = clock.columns(t_s, count=np.array([0, *counts, counts[-1]]))
        line = plot.step(
            "t", "count", source=source, mode="after", line_color=colour, line_width=2.2
        )
        plot.add_tools(clock.hover(line, **{words: "@count{0}"}))
    return plot


def pace_plot(story: Story) -> Figure | None:
    """Steps per second of wall time, of the world and of the fusion centre."""
    centre = centre_of(story)
    paces = {
        name: paces_of(beats)
        for name, beats in story.states.items()
        if name in (keys.WORLD, centre) and len(paces_of(beats)) > 1
    }
    if not paces:
        return None
    zero_ns = _first_beat_ns(story.states)
    plot = new_figure(230, x_axis_label="wall time [s]", y_axis_label="steps per second")
    plot.y_range.start = 0
    for name, found in paces.items():
        t = np.array([(t_ns - zero_ns) * 1e-9 for t_ns, _ in found])
        source = ColumnDataSource({"t": t, "pace": np.array([pace for _, pace in found])})
        words, colour = FUSED if name == centre else GRANTED
        line = plot.line("t", "pace", source=source, line_color=colour, line_width=2)
        plot.add_tools(hover([line], [(words, "@pace{0.0} steps/s")], mode="vline"))
    return plot


def load_plot(story: Story) -> Figure | None:
    """Share of the wall time that the fusion centre spends in fusing."""
    if len(story.health) < 3:
        return None
    zero_ns = _first_beat_ns(story.states) or story.health[0].t_ns
    some = story.health[1:]
    source = ColumnDataSource({
        "t": np.array([(health.t_ns - zero_ns) * 1e-9 for health in some]),
        "load": np.array([100 * health.load for health in some]),
    })  # fmt: skip
    plot = new_figure(230, x_axis_label="wall time [s]", y_axis_label="busy fusing [%]")
    plot.y_range.start, plot.y_range.end = 0, 100
    plot.varea("t", 0, "load", source=source, fill_color=STATES["applied"], fill_alpha=0.2)
    line = plot.line("t", "load", source=source, line_color=STATES["applied"], line_width=2)
    plot.add_tools(hover([line], [("busy fusing", "@load{0} %")], mode="vline"))
    return plot


def _first_beat_ns(states: Mapping[str, Sequence[ProcessState]]) -> int:
    return min((beat.t_ns for beats in states.values() for beat in beats[:1]), default=0)
