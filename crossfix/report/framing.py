"""What the tactical picture shows at first, and on which side of its mark each name stands."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array

from .labels import Box, Mark, Side, sides
from .tracks import CarrierPicture, Scene, Track

WIDTH, HEIGHT = 1000, 680
PLOT_PX = (910.0, 620.0)
"""Of the picture what its axes leave."""
PADDING = 1.09
NAMED_TARGETS = 40
"""More names than this would hide the picture; hovering shows them all the same."""
STRAY_PERCENT = 5.0
"""Of many targets so many on each side may lie outside, lest the others become dots."""
CARRIER_PX, TARGET_PX = 13, 10
SPACING_PX = 4.0
"""Between the points that stand for a line."""


_SHOWN = Box(-PLOT_PX[0] / 2, -PLOT_PX[1] / 2, PLOT_PX[0] / 2, PLOT_PX[1] / 2)


class Frame(NamedTuple):
    """South-west and north-east corner (2, 2) [m] of what is shown."""

    corners_m: Array

    def on_screen(self, east_north_m: Array) -> Array:
        """Points (n, 2) as (n, 2) [px], right and down from the middle."""
        south_west, north_east = self.corners_m
        span_m = np.maximum(north_east - south_west, 1.0) * PADDING
        scale = float(np.min(np.array(PLOT_PX) / span_m))
        points: Array = (east_north_m - (south_west + north_east) / 2) * (scale, -scale)
        return points


class Labels(NamedTuple):
    """Sides of the names: of carriers by what is written there, of others in their order.

    Attributes:
        found: of the tracks of the picture that are there at the end.
    """

    carriers: dict[str, Side]
    targets: list[Side]
    found: list[Side]


def frame_of(scene: Scene) -> Frame:
    """Carriers and targets, or carriers and most logs where no target is known to be true.

    Neither single logs that went astray nor one ship at the horizon make all others small.
    """
    tracks = [track for c in scene.carriers for track in (c.reported, c.corrected, c.true)]
    corners = [_corners(track.east_north_m, 0.0) for track in tracks]
    if scene.targets:
        stray = STRAY_PERCENT if len(scene.targets) > NAMED_TARGETS else 0.0
        corners.append(_corners(np.concatenate([_known(t.track) for t in scene.targets]), stray))
    else:
        corners += [_corners(c.reported_logs.east_north_m, 2.0) for c in scene.carriers]
    points = np.concatenate([np.zeros((0, 2)), *corners])
    if not len(points):
        return Frame(np.zeros((2, 2)))
    return Frame(np.array([points.min(axis=0), points.max(axis=0)]))


def reported_name(carrier: str) -> str:
    """What stands where a carrier reports to be."""
    return f"{carrier}, reported"


def labels_of(scene: Scene, own: str, frame: Frame) -> Labels:
    """Where the names go, carriers first."""
    carriers = [mark for c in scene.carriers for mark in _carrier_marks(c, c.name == own, frame)]
    named = scene.targets if len(scene.targets) <= NAMED_TARGETS else ()
    targets = [_mark(frame, target.track, target.name, TARGET_PX) for target in named]
    here = [track for track in scene.found if track.last is not None]
    few = here if len(here) <= NAMED_TARGETS else ()
    found = [_mark(frame, track.way, track.name, TARGET_PX) for track in few]
    chosen = sides([*carriers, *targets, *found], frame.on_screen(_lines(scene, frame)), _SHOWN)
    return Labels(
        {m.text: chosen[m] for m in carriers},
        [chosen[m] for m in targets],
        [chosen[m] for m in found],
    )


def _carrier_marks(carrier: CarrierPicture, is_own: bool, frame: Frame) -> Iterator[Mark]:
    ends = [(carrier.reported, carrier.name if is_own else reported_name(carrier.name))]
    ends += [] if is_own else [(carrier.corrected, carrier.name)]
    for track, text in ends:
        if len(track.t_s):
            yield _mark(frame, track, text, CARRIER_PX)


def _mark(frame: Frame, track: Track, text: str, size_px: int) -> Mark:
    x, y = frame.on_screen(track.east_north_m[-1:])[0]
    return Mark(float(x), float(y), text, size_px)


def _lines(scene: Scene, frame: Frame) -> Array:
    """Points (n, 2) [m] along everything that is drawn as a line."""
    tracks = [track for c in scene.carriers for track in (c.reported, c.corrected)]
    tracks += [target.track for target in scene.targets]
    return np.concatenate([np.zeros((0, 2)), *(_filled(_known(t), frame) for t in tracks)])


def _filled(points: Array, frame: Frame) -> Array:
    """A line (n, 2) with points every `SPACING_PX`, so that long steps hide nothing."""
    if len(points) < 2:
        return points
    steps = np.diff(frame.on_screen(points), axis=0)
    way_px = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    wanted = np.arange(0.0, way_px[-1], SPACING_PX)
    filled: Array = np.stack([np.interp(wanted, way_px, column) for column in points.T], axis=1)
    return filled


def _known(track: Track) -> Array:
    known: Array = track.east_north_m[np.isfinite(track.east_north_m[:, 0])]
    return known


def _corners(east_north_m: Array, rest: float) -> Array:
    """South-west and north-east (2, 2) of points but for some per cent; none of no points."""
    known = east_north_m[np.isfinite(east_north_m[:, 0])]
    corners: Array = np.percentile(known, (rest, 100 - rest), axis=0) if len(known) else known
    return corners
