"""A recording as a scene for Foxglove and Lichtblick: MCAP with JSON under their schemas."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from crossfix.evaluation import symmetric
from crossfix.export import shapes
from crossfix.export.foxglove_messages import (
    Color,
    CubePrimitive,
    FrameTransform,
    FrameTransforms,
    LinePrimitive,
    LocationFix,
    Log,
    Message,
    Pose,
    SceneEntity,
    SceneEntityDeletion,
    SceneUpdate,
    SpherePrimitive,
    TextPrimitive,
    Vector3,
    schema_name,
    schema_of,
    time_of,
)
from crossfix.export.situation import Corrected, Situation, corrected
from crossfix.making import Made, beside
from crossfix.own_frames import as_own
from crossfix.reading_progress import Show, unseen
from estimation.arrays import Array
from estimation.frames import RigidTransform, Site, rotation_clockwise
from schemas import messages as m
from schemas.errors import WireError
from schemas.recording.json_file import JsonFile
from schemas.recording.reader import Recording

PICTURE, TRUTH = "picture", "truth"
"""Frames: east-north-up at the scenario's origin as the own carrier believes it, and in truth."""
INFO, WARNING = 2, 3
KNOWN, UNKNOWN = 3, 0
DELETE_ALL = 1
SHIP_M, TARGET_M = 150.0, 60.0


class Out(NamedTuple):
    """A message for the viewer."""

    topic: str
    message: Message


def export(recording: Recording, path: Path, show: Show = unseen) -> Made:
    """Write a recording as Foxglove sees it.

    `/tf` holds where every carrier believes to be, and where the corrections in force put it
    (`NAME/corrected`); `/logs` the target logs with ellipses of two sigmas, and lines for those
    that are bearings alone, in the frames of their carriers; `/corrected` the same logs in the
    corrected frames; `/tracks`, `/truth`; `/fix` places on the map; `/log` what happened.

    Raises:
        RecordingError: damaged, or without a scenario; LaunchError: `path` exists.
    """
    with beside(path) as unfinished:
        with JsonFile(unfinished) as file:
            translator = Translator(recording.scenario)
            for count, message in enumerate(recording.messages(), start=1):
                show(count, message.log_time_ns)
                try:
                    outs = list(translator.translate(message.decode()))
                except WireError:
                    continue
                for topic, out in outs:
                    kind = type(out)
                    payload = msgspec.json.encode(out)
                    name, schema = schema_name(kind), schema_of(kind)
                    file.write(topic, name, schema, message.log_time_ns, payload)
        size = unfinished.stat().st_size
    return Made(str(path), file.messages, size)


class Translator:
    """Turns messages, in their order, into those of the viewer."""

    def __init__(self, scenario: m.DeclaredScenario) -> None:
        self._now = Situation(scenario)
        self._corrected: dict[str, Corrected] = {}
        self._states: dict[str, str] = {}
        self._flags: dict[tuple[str, str], str] = {}

    def translate(self, message: object) -> Iterator[Out]:
        """What a message shows; a carrier that applies its corrections, as if it did not."""
        message = as_own(message)
        self._now.hear(message)
        if isinstance(message, m.Navigation):
            yield from self._navigation(message)
        elif isinstance(message, m.SourceReport):
            yield from self._report(message)
        elif isinstance(message, m.Correction):
            yield from self._correction(message)
        elif isinstance(message, m.Tracks):
            yield Out("/tracks", self._tracks(message))
        elif isinstance(message, m.TruthTargets):
            yield from self._truth(message)
        else:
            yield from self._told(message)

    def _navigation(self, navigation: m.Navigation) -> Iterator[Out]:
        name, t_ns = navigation.carrier, navigation.t_ns
        view = self._now.view(name, t_ns)
        assert view is not None  # noqa: S101 (it has just been heard)
        yield Out("/tf", _transforms(t_ns, PICTURE, name, view.picture_from_carrier))
        yield Out(f"/fix/{name}", _fix(t_ns, name, view.site, _pose_covariance(navigation.pose)))
        shade = shapes.colour(self._now.number(name))
        box = CubePrimitive(Pose(), Vector3(SHIP_M / 3, SHIP_M, SHIP_M / 3), shade)
        entity = _entity(t_ns, name, name, cubes=[box], texts=[_text(name, shade)])
        yield Out(f"/carriers/{name}", SceneUpdate([], [entity]))

    def _report(self, report: m.SourceReport) -> Iterator[Out]:
        seen = self._now.seen(report)
        place = f"{report.carrier}/{report.stream}"
        if seen is None:
            return
        shade = shapes.colour(self._now.number(report.carrier), 0.35)
        located = np.isfinite(seen.east_north_m).all(axis=1)
        rays = seen.ray_m[np.isfinite(seen.ray_m).all(axis=1)]
        spheres = shapes.ellipsoids(seen.east_north_m[located], seen.covariance[located], shade)
        lines = [shapes.rays(list(rays), shade)] if len(rays) else []
        frames = [("/logs", report.carrier)]
        if report.carrier in self._corrected:
            frames.append(("/corrected", f"{report.carrier}/corrected"))
        for topic, frame in frames:
            entity = _entity(report.t_ns, frame, place, spheres=spheres, lines=lines)
            yield Out(f"{topic}/{place}", SceneUpdate([], [entity]))

    def _correction(self, correction: m.Correction) -> Iterator[Out]:
        name = correction.carrier
        if self._states.get(name) != correction.state:
            self._states[name] = correction.state
            text = f"correction of {name}: {correction.state}, {correction.reason}".rstrip(", ")
            level = WARNING if correction.state == "suspended" else INFO
            yield Out("/log", Log(time_of(correction.t_ns), level, text, correction.centre))
        found = corrected(self._now, correction)
        if found is None:
            if self._corrected.pop(name, None):
                yield from self._withdrawn(correction.t_ns, name)
            return
        self._corrected[name] = found
        yield from _in_force(correction, found, shapes.colour(self._now.number(name), 0.5))

    def _withdrawn(self, t_ns: int, name: str) -> Iterator[Out]:
        deletion = SceneEntityDeletion(time_of(t_ns), DELETE_ALL, "")
        yield Out(f"/corrections/{name}", SceneUpdate([deletion], []))
        for carrier, source in self._now.sources():
            if carrier == name:
                yield Out(f"/corrected/{name}/{source}", SceneUpdate([deletion], []))

    def _tracks(self, tracks: m.Tracks) -> SceneUpdate:
        shade = Color(0.1, 0.1, 0.1, 0.6)
        entities = []
        for track in tracks.tracks:
            place = np.array(track.position_m)
            covariance = symmetric(track.covariance)[:2, :2]
            entities.append(
                _entity(
                    tracks.t_ns,
                    PICTURE,
                    track.id,
                    spheres=[shapes.ellipsoid(place, covariance, shade)],
                    texts=[_text(track.id, shade, place)],
                )
            )
        deletion = SceneEntityDeletion(time_of(tracks.t_ns), DELETE_ALL, "")
        return SceneUpdate([deletion], entities)

    def _truth(self, truth: m.TruthTargets) -> Iterator[Out]:
        view = self._now.truth_view()
        if view is None:
            return
        turn = np.eye(3)
        turn[:2, :2] = rotation_clockwise(-view.north_error_rad)
        believed = RigidTransform(turn, np.zeros(3)) @ view.own_from_origin
        picture_from_truth = view.believed.picture_from_carrier @ believed
        yield Out("/tf", _transforms(truth.t_ns, PICTURE, TRUTH, picture_from_truth))
        names = truth.identity or [""] * len(truth.number)
        points = [np.array(point) for point in truth.position_m]
        texts = [_text(n, shapes.TRUTH, p) for n, p in zip(names, points, strict=True) if n]
        dots = [shapes.dot(point, TARGET_M, shapes.TRUTH) for point in points]
        entity = _entity(truth.t_ns, TRUTH, "targets", spheres=dots, texts=texts)
        yield Out("/truth/targets", SceneUpdate([], [entity]))

    def _told(self, message: object) -> Iterator[Out]:
        """What people should read."""
        if isinstance(message, m.Health):
            for news in message.news:
                yield Out("/log", Log(time_of(message.t_ns), INFO, news, message.centre))
        elif isinstance(message, m.Event):
            about = message.carrier or message.setting or ", ".join(message.pair)
            text = f"operator: {message.kind} {about}"
            yield Out("/log", Log(time_of(message.t_ns), INFO, text, message.centre))
        elif isinstance(message, m.Quality):
            for source in message.sources:
                place = (source.carrier, source.source)
                if source.flag and self._flags.get(place) != source.flag:
                    text = f"{source.carrier}/{source.source}: {source.flag}"
                    yield Out("/log", Log(time_of(message.t_ns), WARNING, text, message.centre))
                self._flags[place] = source.flag


def _in_force(correction: m.Correction, found: Corrected, shade: Color) -> Iterator[Out]:
    """Frame, place and ellipse of a correction that is applied."""
    name, own, t_ns = correction.carrier, correction.own_pose, correction.t_ns
    assert own is not None  # noqa: S101 (it comes with what was found)
    picture = found.own.picture_from_carrier
    frame = f"{name}/corrected"
    yield Out("/tf", _transforms(t_ns, PICTURE, frame, picture @ found.own_from_other))
    turn = picture.rotation[:2, :2]
    covariance = turn @ found.covariance @ turn.T
    yield Out(f"/fix/{frame}", _fix(t_ns, frame, found.place, covariance))
    place = picture.apply(found.own_from_other.translation_m)
    two_sigma = shapes.ellipsoid(place, covariance, shade)
    text = _text(f"{name}, corrected", shade, place)
    entity = _entity(t_ns, PICTURE, name, spheres=[two_sigma], texts=[text])
    yield Out(f"/corrections/{name}", SceneUpdate([], [entity]))


def _transforms(t_ns: int, parent: str, child: str, transform: RigidTransform) -> FrameTransforms:
    pose = shapes.pose_of(transform)
    one = FrameTransform(time_of(t_ns), parent, child, pose.position, pose.orientation)
    return FrameTransforms([one])


def _fix(t_ns: int, frame: str, place: Site, covariance: Array | None) -> LocationFix:
    full = np.zeros((3, 3))
    if covariance is not None:
        full[: len(covariance), : len(covariance)] = covariance
    return LocationFix(
        time_of(t_ns),
        frame,
        degrees(place.latitude_rad),
        degrees(place.longitude_rad),
        place.altitude_m,
        [float(value) for value in full.ravel()],
        UNKNOWN if covariance is None else KNOWN,
    )


def _pose_covariance(pose: m.Pose) -> Array | None:
    """Of east and north, or of east, north and up."""
    if pose.covariance is None:
        return None
    matrix = symmetric(pose.covariance)
    size = 2 if len(matrix) == 3 else 3
    block: Array = matrix[:size, :size]
    return block


def _entity(
    t_ns: int,
    frame: str,
    name: str,
    *,
    spheres: list[SpherePrimitive] | None = None,
    lines: list[LinePrimitive] | None = None,
    cubes: list[CubePrimitive] | None = None,
    texts: list[TextPrimitive] | None = None,
) -> SceneEntity:
    return SceneEntity(
        timestamp=time_of(t_ns),
        frame_id=frame,
        id=name,
        spheres=spheres or [],
        lines=lines or [],
        cubes=cubes or [],
        texts=texts or [],
    )


def _text(text: str, shade: Color, place: Array | None = None) -> TextPrimitive:
    above = shapes.vector(place) if place is not None else Vector3(0.0, 0.0, SHIP_M)
    return TextPrimitive(Pose(above), True, 14.0, True, shade, text)
