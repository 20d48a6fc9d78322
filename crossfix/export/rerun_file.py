"""A recording for the Rerun viewer, in its own archetypes; needs the package `rerun-sdk`."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from crossfix.evaluation import symmetric
from crossfix.export.shapes import COLOURS
from crossfix.export.situation import Situation, corrected
from crossfix.making import Made, beside
from crossfix.own_frames import as_own
from crossfix.reading_progress import Show, unseen
from crossfix.report.tracks import SIGMAS
from estimation.arrays import Array
from schemas import messages as m
from schemas.errors import CrossfixError, WireError
from schemas.recording.reader import Recording

TIMELINE = "scenario"
LEAST_M = 5.0


def export(recording: Recording, path: Path, show: Show = unseen) -> Made:
    """Write a recording as Rerun sees it: points, ellipses, lines, figures over time, a log.

    All points are in the axes of the picture: east and north at the scenario's origin as the own
    carrier believes it.

    Raises:
        CrossfixError: rerun-sdk is not installed.
        RecordingError: damaged, or without a scenario; LaunchError: `path` exists.
    """
    rerun = _library()
    with beside(path) as unfinished:
        stream = rerun.RecordingStream("crossfix", recording_id=recording.header.run)
        stream.save(str(unfinished))
        drawing = _Drawing(rerun, stream, Situation(recording.scenario))
        for count, recorded in enumerate(recording.messages(), start=1):
            show(count, recorded.log_time_ns)
            try:
                drawing.take(recorded.decode())
            except WireError:
                continue
        stream.flush()
        stream.disconnect()
        size = unfinished.stat().st_size
    return Made(str(path), drawing.count, size)


def _library() -> ModuleType:
    try:
        import rerun  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError:
        raise CrossfixError(
            "rerun-sdk is not installed",
            expected="pip install 'crossfix[rerun]', or export foxglove",
        ) from None
    module: ModuleType = rerun
    return module


class _Drawing:
    """Logs one message after the other."""

    def __init__(self, rerun: ModuleType, stream: Any, now: Situation) -> None:
        self.count = 0
        self._rerun, self._stream, self._now = rerun, stream, now
        self._states: dict[str, str] = {}

    def take(self, message: object) -> None:
        """What a message shows; a carrier that applies its corrections, as if it did not."""
        message = as_own(message)
        self._now.hear(message)
        t_ns = getattr(message, "t_ns", None)
        if t_ns is None:
            return
        self._stream.set_time(TIMELINE, timestamp=np.datetime64(t_ns, "ns"))
        if isinstance(message, m.Navigation):
            self._navigation(message)
        elif isinstance(message, m.SourceReport):
            self._report(message)
        elif isinstance(message, m.Correction):
            self._correction(message)
        elif isinstance(message, m.Tracks):
            self._tracks(message)
        elif isinstance(message, m.TruthTargets):
            self._truth(message)
        elif isinstance(message, m.Health):
            for news in message.news:
                self._log("log", self._rerun.TextLog(news, level="INFO"))

    def _log(self, entity: str, what: Any) -> None:
        self._stream.log(entity, what)
        self.count += 1

    def _shade(self, carrier: str) -> list[int]:
        part = COLOURS[self._now.number(carrier) % len(COLOURS)]
        return [round(255 * value) for value in part]

    def _navigation(self, navigation: m.Navigation) -> None:
        view = self._now.view(navigation.carrier, navigation.t_ns)
        if view is not None:
            place = view.picture_from_carrier.translation_m
            self._points(f"carriers/{navigation.carrier}", place[None], navigation.carrier, 75.0)

    def _report(self, report: m.SourceReport) -> None:
        seen, view = self._now.seen(report), self._now.view(report.carrier, report.t_ns)
        if seen is None or view is None:
            return
        located = np.isfinite(seen.east_north_m).all(axis=1)
        entity = f"logs/{report.carrier}/{report.stream}"
        if located.any():
            turn = view.picture_from_carrier.rotation[:2, :2]
            places = view.placed(seen.east_north_m[located])
            self._ellipses(entity, places, turn @ seen.covariance[located] @ turn.T, report.carrier)
        rays = seen.ray_m[np.isfinite(seen.ray_m).all(axis=1)]
        if len(rays):
            start = view.picture_from_carrier.translation_m[:2]
            strips = [_down(np.array([start, end])) for end in view.placed(rays)]
            shade = self._shade(report.carrier)
            self._log(f"{entity}/bearings", self._rerun.LineStrips2D(strips, colors=shade))

    def _correction(self, correction: m.Correction) -> None:
        name = correction.carrier
        if self._states.get(name) != correction.state:
            self._states[name] = correction.state
            text = f"correction of {name}: {correction.state} {correction.reason}"
            self._log("log", self._rerun.TextLog(text, level="INFO"))
        axes, found = correction.own_axes, corrected(self._now, correction)
        if axes is not None:
            for field in ("east_m", "north_m", "rotation_rad"):
                figure = self._rerun.Scalars(getattr(axes, field))
                self._log(f"corrections/{name}/{field}", figure)
        if found is not None:
            picture = found.own.picture_from_carrier
            place = picture.apply(found.own_from_other.translation_m)
            turn = picture.rotation[:2, :2]
            covariance = turn @ found.covariance @ turn.T
            self._ellipses(f"carriers/{name}/corrected", place[None, :2], covariance[None], name)

    def _tracks(self, tracks: m.Tracks) -> None:
        if tracks.tracks:
            places = np.array([track.position_m[:2] for track in tracks.tracks])
            boxes = np.array([symmetric(track.covariance)[:2, :2] for track in tracks.tracks])
            self._ellipses("tracks", places, boxes, self._now.own)

    def _truth(self, truth: m.TruthTargets) -> None:
        view = self._now.truth_view()
        if view is not None and truth.number:
            places = view.placed(np.array(truth.position_m))
            grey = [90, 90, 90]
            self._log("truth", self._rerun.Points2D(_down(places), colors=grey, radii=30.0))

    def _points(self, entity: str, places: Array, carrier: str, radius_m: float) -> None:
        points = self._rerun.Points2D(
            _down(places[:, :2]), colors=self._shade(carrier), radii=radius_m, labels=[carrier]
        )
        self._log(entity, points)

    def _ellipses(self, entity: str, places: Array, covariances: Array, carrier: str) -> None:
        """Outlines of two sigmas."""
        variances, directions = np.linalg.eigh(np.nan_to_num(covariances))
        axes = np.maximum(SIGMAS * np.sqrt(np.maximum(variances, 0.0)), LEAST_M)
        angle = np.linspace(0.0, 2 * np.pi, 25)
        circle = np.stack([np.cos(angle), np.sin(angle)])
        outlines = places[:, None] + ((directions * axes[:, None]) @ circle).transpose(0, 2, 1)
        strips = [_down(outline) for outline in outlines]
        self._log(entity, self._rerun.LineStrips2D(strips, colors=self._shade(carrier)))


def _down(east_north_m: Array) -> Array:
    """Points (n, 2) with north up, where the viewer's second axis points down."""
    flipped: Array = east_north_m * [1.0, -1.0]
    return flipped
