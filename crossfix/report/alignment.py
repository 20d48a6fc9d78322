"""Plots of system alignment: where ranges put carriers and beacons, and by how much they err."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource

from crossfix.evaluation import AlignmentError, symmetric
from estimation.arrays import Array
from estimation.frames import Site, target_from_source
from schemas.messages import AlignedCarrier, DeclaredBeacon, Origin, Pose

from .clock import Clock, rule, usual_range
from .story import Story
from .style import FAINT, FOUND, TRUTH, Figure, hover, new_figure
from .thinning import stride
from .tracks import SIGMAS, ellipse

HEIGHT, MAP_HEIGHT = 210, 480
POINTS = 400
KM = 1e-3
Geodetic = Pose | DeclaredBeacon | Origin


class Constant(NamedTuple):
    """One number that ranges tell of a carrier: its errors and sigmas (n,) over time."""

    title: str
    error: Array
    sigma: Array
    digits: str


def alignment_plots(
    story: Story, errors: Sequence[AlignmentError], clock: Clock, colour: str
) -> list[Figure]:
    """The error of each number that is not declared to be known, in its two sigma."""
    t_s = np.array([story.time_s(error.t_ns) for error in errors])
    return [
        _remaining(t_s, constant, clock, colour)
        for constant in _constants(errors)
        if (constant.sigma > 0).any()
    ]


def _constants(errors: Sequence[AlignmentError]) -> list[Constant]:
    places = np.array([(*e.found_m, *e.sigma_m) for e in errors]).T
    return [
        Constant("east: error [m]", places[0], places[2], "0.0"),
        Constant("north: error [m]", places[1], places[3], "0.0"),
        Constant(
            "own north: error [deg]",
            degrees(1.0) * np.array([e.found_rad for e in errors]),
            degrees(1.0) * np.array([e.sigma_rad for e in errors]),
            "0.000",
        ),
        Constant(
            "clock against the own one: error [s]",
            np.array([e.found_s for e in errors]),
            np.array([e.sigma_s for e in errors]),
            "0.000",
        ),
    ]


def _remaining(t_s: Array, constant: Constant, clock: Clock, colour: str) -> Figure:
    error, half = constant.error, SIGMAS * constant.sigma
    plot = clock.figure(HEIGHT, title=constant.title)
    plot.y_range = usual_range(error, half, -half)
    rule(plot, 0.0, TRUTH)
    source = clock.columns(t_s, error=error, low=-half, high=half)
    plot.varea("t", "low", "high", source=source, fill_color=colour, fill_alpha=0.18)
    line = plot.line("t", "error", source=source, line_color=colour, line_width=1.4)
    shown = {"error": f"@error{{{constant.digits}}}", "two_sigma": f"@high{{{constant.digits}}}"}
    plot.add_tools(clock.hover(line, **shown))
    return plot


def alignment_map(story: Story, colours: Mapping[str, str]) -> Figure | None:
    """Carriers and beacons to true north: reported, found, true; None where ranges tell nothing."""
    if not story.alignments:
        return None
    plot = new_figure(
        MAP_HEIGHT, match_aspect=True, x_axis_label="east [km]", y_axis_label="north [km]"
    )
    found: dict[str, list[AlignedCarrier]] = {}
    for alignment in story.alignments:
        for told in alignment.carriers:
            found.setdefault(told.carrier, []).append(told)
    for name, told_of_it in found.items():
        _carrier(plot, story, told_of_it, colours.get(name, FAINT))
    _beacons(plot, story)
    return plot


def _carrier(plot: Figure, story: Story, told: Sequence[AlignedCarrier], colour: str) -> None:
    name = told[0].carrier
    true = [
        truth.position_m[truth.carrier.index(name)][:2]
        for truth in story.truth_carriers
        if name in truth.carrier
    ]
    reported = [_true_axes_m(story, m.pose) for m in story.navigation.get(name, ())]
    _way(plot, true, TRUTH, 1.2, [])
    _way(plot, reported, colour, 1.6, [5, 3])
    way = _way(plot, [c.position_m for c in told], colour, 2.6, [])
    plot.add_tools(hover([way], [("carrier", name), ("place", "@x, @y km")]))
    last = told[-1]
    _place(plot, name, np.array(last.position_m), symmetric(last.covariance), colour, "circle")


def _beacons(plot: Figure, story: Story) -> None:
    declared = {beacon.name: beacon for beacon in story.scenario.beacons}
    for told in story.alignments[-1].beacons:
        if (true := story.true_beacons_m.get(told.beacon)) is not None:
            _mark(plot, true[:2], TRUTH, "x")
        before = _true_axes_m(story, declared[told.beacon])
        _mark(plot, before, FAINT, "triangle")
        covariance = symmetric(told.covariance)[:2, :2]
        _place(plot, told.beacon, np.array(told.position_m[:2]), covariance, FOUND, "triangle")


def _true_axes_m(story: Story, place: Geodetic) -> Array:
    """A geodetic place along the axes of the scenario's origin (2,)."""
    origin = _site(story.scenario.origin)
    there: Array = target_from_source(origin, _site(place)).translation_m[:2]
    return there


def _site(place: Geodetic) -> Site:
    return Site(place.latitude_rad, place.longitude_rad, place.altitude_m)


def _way(
    plot: Figure,
    places: Sequence[Array | Sequence[float]],
    colour: str,
    width: float,
    dash: list[int],
) -> Any:
    some = np.reshape(np.array(places, dtype=float), (-1, 2))[stride(len(places), POINTS)] * KM
    east, north = some.astype(np.float32).T
    return plot.line(east, north, line_color=colour, line_width=width, line_dash=dash)


def _mark(plot: Figure, place_m: Array, colour: str, marker: str) -> None:
    east, north = place_m * KM
    plot.scatter(
        [east], [north], size=10, marker=marker, line_color=colour, fill_color=None, line_width=2
    )


def _place(
    plot: Figure, name: str, place_m: Array, covariance: Array, colour: str, marker: str
) -> None:
    """A mark with a name, and two sigma around it."""
    two_sigma = ellipse(0.0, place_m, covariance)
    width, height = two_sigma.axes_m * KM
    source = ColumnDataSource({
        "x": [place_m[0] * KM], "y": [place_m[1] * KM], "name": [name],
        "width": [width], "height": [height], "angle": [two_sigma.angle_rad],
    })  # fmt: skip
    plot.ellipse(
        "x", "y", "width", "height", "angle", source=source,
        fill_color=colour, fill_alpha=0.2, line_color=colour, line_width=1.5,
    )  # fmt: skip
    plot.scatter("x", "y", source=source, size=9, marker=marker, color=colour)
    plot.text(
        "x", "y", text="name", source=source, x_offset=8, y_offset=-4, text_color=colour,
        text_font_size="12px",
    )  # fmt: skip
