"""The tactical picture: north up, one scale, what was reported, what is corrected, what is true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from bokeh.core.properties import value
from bokeh.models import (
    BoxZoomTool,
    ColumnDataSource,
    CustomJSHover,
    DataRange1d,
    PanTool,
    ResetTool,
    WheelZoomTool,
)
from numpy.typing import NDArray

from estimation.arrays import Array

from .framing import (
    CARRIER_PX,
    HEIGHT,
    PADDING,
    TARGET_PX,
    WIDTH,
    Frame,
    Labels,
    frame_of,
    labels_of,
    reported_name,
)
from .labels import Side
from .logs import Logs
from .style import FAINT, FONT, FOUND, INK, SEA, TRUTH, Figure, TimeUnit, hover, new_figure, pale
from .tracks import (
    CarrierPicture,
    Ellipse,
    FoundLine,
    FoundTrack,
    Scene,
    Track,
    TrueTarget,
)

KM = 1e-3
Single = NDArray[np.float32]


class Layer(NamedTuple):
    """What the legend switches on and off together.

    Attributes:
        key: `name` of its renderers.
        group: carrier, truth or picture.
        look: line, dashed, dots, rings or text.
    """

    key: str
    group: str
    label: str
    colour: str
    look: str


def tactical_picture(
    scene: Scene, own: str, colours: Mapping[str, str], unit: TimeUnit
) -> tuple[Figure, list[Layer]]:
    """The picture and its legend."""
    plot, frame = _empty(), frame_of(scene)
    drawing = _Drawing(plot, scene.names, unit, labels_of(scene, own, frame))
    others = [carrier for carrier in scene.carriers if carrier.name != own]
    for carrier in others:
        drawing.reported_logs(carrier, colours[carrier.name])
    for carrier in scene.carriers:
        drawing.good_logs(carrier, carrier.name == own, colours[carrier.name])
    drawing.true_targets(scene.targets)
    drawing.found_lines(scene.lines)
    drawing.found_tracks(scene.found)
    for carrier in scene.carriers:
        drawing.tracks(carrier, carrier.name == own, colours[carrier.name])
    _fit(plot, frame)
    order = ["truth", "picture", own, *colours]
    return plot, sorted(drawing.layers, key=lambda layer: order.index(layer.group))


def _empty() -> Figure:
    wheel = WheelZoomTool(modifiers={"ctrl": True})  # the wheel alone scrolls the page
    plot = new_figure(
        HEIGHT,
        width=WIDTH,
        sizing_mode="scale_width",
        name="picture",
        match_aspect=True,
        x_range=DataRange1d(range_padding=PADDING - 1),
        y_range=DataRange1d(range_padding=PADDING - 1),
        x_axis_label="east [km]",
        y_axis_label="north [km]",
        tools=[PanTool(), wheel, BoxZoomTool(match_aspect=True), ResetTool()],
    )
    plot.toolbar.active_scroll = wheel
    plot.background_fill_color = SEA
    return plot


def _fit(plot: Figure, frame: Frame) -> None:
    extent = plot.scatter(*_km(frame.corners_m), size=0, alpha=0)
    plot.x_range.renderers = plot.y_range.renderers = [extent]


class _Drawing:
    """Draws one layer after the other and keeps the legend."""

    def __init__(self, plot: Figure, names: Sequence[str], unit: TimeUnit, labels: Labels) -> None:
        self.layers: list[Layer] = []
        self._plot, self._unit, self._labels = plot, unit, labels
        self._called = CustomJSHover(args={"names": [*names]}, code="return names[value]")

    def true_targets(self, targets: Sequence[TrueTarget]) -> None:
        """Where targets really went, and where they were at the end."""
        if not targets:
            return
        key = self._layer("truth", "targets", TRUTH, "line")
        east, north = zip(*(_km(target.track.east_north_m) for target in targets), strict=True)
        called = {"name": [t.name for t in targets], "kind": [t.kind for t in targets]}
        ways = ColumnDataSource({"x": [*east], "y": [*north], **called})
        ends = ColumnDataSource({"x": [x[-1] for x in east], "y": [y[-1] for y in north], **called})
        lines = self._plot.multi_line(
            "x", "y", source=ways, name=key, line_color=TRUTH, line_width=1.1, line_alpha=0.85
        )
        dots = self._plot.scatter(
            "x", "y", source=ends, name=key, size=5, color=TRUTH, line_color="white"
        )
        shown = _line(TRUTH, "@name", "true target, @kind")
        self._plot.add_tools(hover([lines, dots], shown))
        if self._labels.targets:
            names = self._layer("truth", "names", FAINT, "text")
            self._text(names, ends, self._labels.targets, FAINT, TARGET_PX)

    def found_lines(self, lines: Sequence[FoundLine]) -> None:
        """Bearings of targets whose range is not known yet: from the nearest place on."""
        if not lines:
            return
        key = self._layer("picture", "bearings without a range", FOUND, "dashed")
        east, north = zip(*(_km(line.ends_m) for line in lines), strict=True)
        source = ColumnDataSource({
            "x": [*east], "y": [*north], "name": [line.name for line in lines],
            "said": [line.said for line in lines],
        })  # fmt: skip
        drawn = self._plot.multi_line(
            "x", "y", source=source, name=key, line_color=FOUND, line_dash=[5, 4], line_alpha=0.7
        )
        self._plot.add_tools(hover([drawn], _line(FOUND, "@name", "@said")))

    def found_tracks(self, found: Sequence[FoundTrack]) -> None:
        """The tracks of the picture: where they went, and two sigma of where they are."""
        if not found:
            return
        key = self._layer("picture", "tracks", FOUND, "line")
        colours = [FOUND if track.sure else pale(FOUND) for track in found]
        east, north = zip(*(_km(track.way.east_north_m) for track in found), strict=True)
        ways = ColumnDataSource({
            "x": [*east], "y": [*north], "colour": colours,
            "name": [track.name for track in found], "said": [track.said for track in found],
        })  # fmt: skip
        lines = self._plot.multi_line(
            "x", "y", source=ways, name=key, line_color="colour", line_width=2, line_alpha=0.75
        )
        self._plot.add_tools(hover([lines], _line(FOUND, "@name", "@said")))
        self._found_ends([track for track in found if track.last is not None])

    def _found_ends(self, found: Sequence[FoundTrack]) -> None:
        """Two sigma of each track at the end, its place and its name."""
        ellipses = [track.last for track in found if track.last is not None]
        if not ellipses:
            return
        colours = [FOUND if track.sure else pale(FOUND) for track in found]
        key = self._layer("picture", "2 sigma of tracks", FOUND, "rings")
        source = _of_ellipses(ellipses)
        source.add(colours, "colour")
        source.add([track.name for track in found], "name")
        source.add([track.said for track in found], "said")
        rings = self._plot.ellipse(
            "x", "y", "width", "height", "angle", source=source, name=key,
            fill_color="colour", fill_alpha=0.2, line_color="colour", line_width=1.5,
        )  # fmt: skip
        marks = self._plot.scatter(
            "x", "y", source=source, name=key, size=7, marker="diamond",
            fill_color="white", line_color="colour", line_width=1.6,
        )  # fmt: skip
        self._plot.add_tools(hover([rings, marks], _line(FOUND, "@name", "@said")))
        if self._labels.found:
            names = self._layer("picture", "names", FOUND, "text")
            self._text(names, source, self._labels.found, FOUND, TARGET_PX)

    def reported_logs(self, carrier: CarrierPicture, colour: str) -> None:
        """Target logs as another carrier reports them: pale, however many lie on one spot."""
        self._logs(carrier.name, "logs as reported", carrier.reported_logs, pale(colour), 0.6)

    def good_logs(self, carrier: CarrierPicture, is_own: bool, colour: str) -> None:
        """Target logs as corrected; the own carrier's are right as they are."""
        if is_own:
            self._logs(carrier.name, "target logs", carrier.reported_logs, colour, 0.4)
        else:
            self._logs(carrier.name, "logs as corrected", carrier.corrected_logs, colour, 0.4)

    def tracks(self, carrier: CarrierPicture, is_own: bool, colour: str) -> None:
        """Where a carrier was: as it reported, as corrected, in truth."""
        name = carrier.name
        if is_own:
            self._track(name, "track", carrier.reported, colour, "line")
            self._end(name, "track", carrier.reported, colour, colour, name)
            return
        self._track("truth", f"track of {name}", carrier.true, TRUTH, "line")
        self._track(name, "track as reported", carrier.reported, colour, "dashed")
        self._end(name, "track as reported", carrier.reported, "white", colour, reported_name(name))
        self._track(name, "track as corrected", carrier.corrected, colour, "line")
        self._end(name, "track as corrected", carrier.corrected, colour, colour, name)
        self._ellipses(name, carrier.ellipses, colour)

    def _layer(self, group: str, label: str, colour: str, look: str) -> str:
        """The key of a new entry of the legend."""
        key = f"{group}: {label}"
        self.layers.append(Layer(key, group, label, colour, look))
        return key

    def _logs(self, group: str, label: str, logs: Logs, colour: str, alpha: float) -> None:
        if not len(logs.t_s):
            return
        key = self._layer(group, label, colour, "dots")
        east, north = _km(logs.east_north_m)
        t = np.float32(self._unit.of(logs.t_s))
        source = ColumnDataSource({"x": east, "y": north, "t": t, "name": logs.name})
        dots = self._plot.scatter(
            "x", "y", source=source, name=key, size=3, color=colour, line_color=None, alpha=alpha
        )
        shown = _line(colour, "@name{custom}", f"{group}, {label}, @t{{0.0}} {self._unit.name}")
        self._plot.add_tools(hover([dots], shown, formatters={"@name": self._called}))

    def _track(self, group: str, label: str, track: Track, colour: str, look: str) -> None:
        if not len(track.t_s):
            return
        key = self._layer(group, label, colour, look)
        east, north = _km(track.east_north_m)
        t = np.float32(self._unit.of(track.t_s))
        line = self._plot.line(
            "x", "y", source=ColumnDataSource({"x": east, "y": north, "t": t}), name=key,
            line_color=colour, line_width=1.5 if colour == TRUTH else 3,
            line_dash=[5, 3] if look == "dashed" else [],
        )  # fmt: skip
        shown = _line(colour, group, f"{label}, @t{{0.0}} {self._unit.name}")
        self._plot.add_tools(hover([line], shown))

    def _end(self, group: str, label: str, track: Track, fill: str, colour: str, text: str) -> None:
        """A mark and a name where a track ends; they go with it."""
        if not len(track.t_s):
            return
        key = f"{group}: {label}"
        east, north = _km(track.east_north_m)
        source = ColumnDataSource({"x": east[-1:], "y": north[-1:], "name": [text]})
        self._plot.scatter(
            "x", "y", source=source, name=key, size=12, marker="circle",
            fill_color=fill, line_color=colour, line_width=2.5,
        )  # fmt: skip
        sides = [self._labels.carriers[text]]
        self._text(key, source, sides, colour, CARRIER_PX, bold=fill == colour)

    def _text(
        self,
        key: str,
        source: ColumnDataSource,
        sides: Sequence[Side],
        colour: str,
        size_px: int,
        *,
        bold: bool = False,
    ) -> None:
        """Names beside the marks of a source, each on its side."""
        for name, column in zip(Side._fields, zip(*sides, strict=True), strict=True):
            source.add(column, name)
        self._plot.text(
            "x", "y", text="name", source=source, name=key,
            x_offset="dx", y_offset="dy", text_align="align", text_color=colour,
            text_font_size=f"{size_px}px", text_font=value(FONT),
            text_font_style="bold" if bold else "normal",
            background_fill_color="white", background_fill_alpha=0.65, padding=1, border_radius=3,
        )  # fmt: skip

    def _ellipses(self, group: str, ellipses: Sequence[Ellipse], colour: str) -> None:
        if not ellipses:
            return
        key = self._layer(group, "2 sigma of corrections", colour, "rings")
        self._plot.ellipse(
            "x", "y", "width", "height", "angle", source=_of_ellipses(ellipses), name=key,
            fill_color=colour, fill_alpha=0.25, line_color=INK, line_width=1.2,
        )  # fmt: skip


def _of_ellipses(ellipses: Sequence[Ellipse]) -> ColumnDataSource:
    places = np.array([ellipse.east_north_m for ellipse in ellipses]) * KM
    axes = np.array([ellipse.axes_m for ellipse in ellipses]) * KM
    return ColumnDataSource({
        "x": places[:, 0], "y": places[:, 1], "width": axes[:, 0], "height": axes[:, 1],
        "angle": np.array([ellipse.angle_rad for ellipse in ellipses]),
    })  # fmt: skip


def _line(colour: str, name: str, more: str) -> str:
    """A tooltip of one line; names of the data are escaped where they are filled in."""
    return f'<span style="color: {colour}"><b>{name}</b></span> {more}'


def _km(east_north_m: Array) -> tuple[Single, Single]:
    """East and north [km] (n,), in single precision: a millimetre at 10 km."""
    km = (east_north_m * KM).astype(np.float32)
    return km[:, 0], km[:, 1]
