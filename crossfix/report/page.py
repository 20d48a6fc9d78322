"""The report as one HTML file that holds everything it needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from bokeh.document import Document
from bokeh.embed import components
from bokeh.resources import Resources
from jinja2 import Environment, StrictUndefined
from msgspec.structs import astuple

from crossfix import __version__
from crossfix.quantities import degrees, metres, quantity, seconds
from crossfix.table import (
    ALIGNMENT_NOTE,
    NOTE,
    PICTURE_HEADINGS,
    PICTURE_NOTE,
    alignment_rows,
    applies,
    picture_cells,
)

from . import words
from .alignment import alignment_map, alignment_plots
from .clock import Clock
from .corrections import MEAN_OF, correction_plots, error_cloud, nees_plot, state_plot
from .errors import CURVES, picture_plots
from .figures import Figures, alignment_of, nees_interval
from .health import (
    FUSED,
    GRANTED,
    LOSSES,
    load_plot,
    loss_plot,
    losses_over_time,
    pace_plot,
    presence_plot,
)
from .innovations import nis_plots
from .series import FrameSeries, presence
from .story import Story
from .style import DARK, FONT, FOUND, STATES, Figure, colours, time_unit
from .tactical import Layer, tactical_picture
from .tracks import scene

TEMPLATE = Path(__file__).with_name("page.html")


def html_page(story: Story, series: Sequence[FrameSeries], figures: Figures) -> str:
    """The whole page."""
    plots, layers = _plots(story, series, figures)
    script, places = _embedded(plots)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.globals.update(_WORDS)
    page = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    return page.render(
        **_texts(story, figures),
        **_places(places, figures),
        f=figures,
        bokeh=Resources(mode="inline", components=["bokeh"]).render_js(),
        script=script,
        legend=[(group, [*found]) for group, found in groupby(layers, lambda layer: layer.group)],
        colours=colours(story.carriers),
        used_states=_used_states(series),
        lost_words=words.losses(figures.losses),
    )


def _plots(
    story: Story, series: Sequence[FrameSeries], figures: Figures
) -> tuple[dict[str, Figure], list[Layer]]:
    """Every plot by its place on the page, and the legend of the tactical picture."""
    unit, palette = time_unit(figures.duration_s), colours(story.carriers)
    clock = Clock(unit, figures.duration_s)
    drawn = scene(story)
    picture, layers = tactical_picture(drawn, story.own, palette, unit)
    plots: dict[str, Figure | None] = {"picture": picture if layers else None}
    for s in series:
        for number, plot in enumerate(correction_plots(s, clock, palette[s.carrier])):
            plots[f"correction/{s.carrier}/{number}"] = plot
        plots[f"cloud/{s.carrier}"] = error_cloud(s, palette[s.carrier])
    for number, plot in enumerate(picture_plots(story, clock)):
        plots[f"error/{number}"] = plot
    for number, plot in enumerate(nis_plots(story, clock, palette)):
        plots[f"nis/{number}"] = plot
    for name, errors in alignment_of(story).items():
        for number, plot in enumerate(alignment_plots(story, errors, clock, palette[name])):
            plots[f"alignment/{name}/{number}"] = plot
    plots |= {
        "map": alignment_map(story, palette),
        "states": state_plot(series, clock) if series else None,
        "nees": nees_plot(series, clock, palette),
        "presence": presence_plot(presence(story), figures.news, clock, palette),
        "losses": loss_plot(story, clock),
        "pace": pace_plot(story),
        "load": load_plot(story),
    }
    return {name: plot for name, plot in plots.items() if plot is not None}, layers


def _embedded(plots: Mapping[str, Figure]) -> tuple[str, dict[str, str]]:
    """The script that draws the plots, and the place of each."""
    if not plots:
        return "", {}
    document = Document()
    with document.models.freeze():  # else all models are counted again for each plot
        for plot in plots.values():
            document.add_root(plot)
    script, places = components(dict(plots))
    return script, places


def _places(places: Mapping[str, str], figures: Figures) -> dict[str, Any]:
    """Where the plots go in the template."""

    def under(prefix: str) -> list[str]:
        return [place for name, place in places.items() if name.startswith(prefix)]

    return {
        "picture": places.get("picture"),
        "corrections": [(c, under(f"correction/{c.name}/")) for c in figures.carriers],
        "state_plot": places.get("states"),
        "nees": places.get("nees"),
        "clouds": under("cloud/"),
        "picture_errors": under("error/"),
        "nis": under("nis/"),
        "alignment": [(c, under(f"alignment/{c.carrier}/")) for c in figures.alignment],
        "map": places.get("map"),
        "presence": places.get("presence"),
        "losses": places.get("losses"),
        "timing": [places[name] for name in ("pace", "load") if name in places],
    }


def _texts(story: Story, figures: Figures) -> dict[str, Any]:
    """What the template says in words."""
    scenario, carriers = story.scenario, len(story.carriers)
    targets = {number for truth in story.truth_targets for number in truth.number}
    return {
        "duration": words.duration(figures.duration_s),
        "carriers": f"{carriers} carriers" if carriers != 1 else "1 carrier",
        "targets": len(targets),
        "recorded": words.instant(figures.recorded_ns) if figures.recorded_ns else "some day",
        "step": seconds(scenario.step_ns * 1e-9),
        "step_s": scenario.step_ns * 1e-9,
        "epoch": words.instant(scenario.epoch_ns),
        "origin": words.place(scenario.origin.latitude_rad, scenario.origin.longitude_rad),
        "counted_at": story.health[-1].step if story.health else 0,
        "loss_key": [LOSSES[name] for name in losses_over_time(story)],
        "pace_key": [GRANTED, FUSED],
        "declared": [*words.declared_rows(scenario)],
        "settings": [*words.settings(scenario.fusion)],
        "size": words.size(figures.bytes),
        "fingerprint": ", ".join(filter(None, astuple(figures.fingerprint))),
        "versions": ", ".join(f"{name} {number}" for name, number in figures.versions.items()),
    }


def _used_states(series: Sequence[FrameSeries]) -> list[tuple[str, str]]:
    used = {span.name for s in series for span in s.states}
    return [(name, colour) for name, colour in STATES.items() if name in used]


_WORDS = {
    "applying": applies,
    "metres": metres,
    "degrees": degrees,
    "seconds": seconds,
    "quantity": quantity,
    "counted": [*words.COUNTED.items()],
    "states": STATES,
    "interval": nees_interval(),
    "mean_of": MEAN_OF,
    "note": NOTE,
    "picture_note": PICTURE_NOTE,
    "picture_headings": PICTURE_HEADINGS,
    "picture_cells": picture_cells,
    "picture_key": CURVES,
    "alignment_note": ALIGNMENT_NOTE,
    "alignment_rows": alignment_rows,
    "source_headings": words.SOURCE_HEADINGS,
    "sources_note": words.SOURCES_NOTE,
    "source_cells": words.source_cells,
    "dark": DARK,
    "found": FOUND,
    "font": FONT,
    "version": __version__,
}
