"""Who was where: carriers as reported, as corrected and in truth, and the true targets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from crossfix.evaluation import symmetric
from estimation.arrays import Array
from schemas import messages
from schemas.messages import Correction, OwnAxes, Pose, TruthTargets

from .axes import Axes
from .logs import Logs, Names, logs_of
from .story import Story
from .thinning import stride

TRACK_POINTS = 400
ELLIPSES = 8
SIGMAS = 2.0
"""How many sigmas an ellipse or a band shows."""
OPEN_M = 1e6
"""Length of a line to a range of which nobody knows how far it may be."""
SURE = 0.9
"""A track that exists with less is drawn pale."""
SILENT_S = 10.0
"""A track is broken where nothing is known for longer than this and five usual intervals."""
T = TypeVar("T")


class Track(NamedTuple):
    """Points (n,) and (n, 2) of one thing over time; nan where the line is broken."""

    t_s: Array
    east_north_m: Array


class Ellipse(NamedTuple):
    """Two sigmas around where a correction puts a carrier.

    Attributes:
        axes_m: (2,) full lengths.
        angle_rad: of the first axis, from east to north.
    """

    t_s: float
    east_north_m: Array
    axes_m: Array
    angle_rad: float


class CarrierPicture(NamedTuple):
    """One carrier; what is not known is empty."""

    name: str
    reported: Track
    corrected: Track
    true: Track
    reported_logs: Logs
    corrected_logs: Logs
    ellipses: Sequence[Ellipse]


class TrueTarget(NamedTuple):
    """One target of the truth."""

    name: str
    kind: str
    track: Track


class FoundTrack(NamedTuple):
    """One track of the picture.

    Attributes:
        said: what hovering tells of it.
        sure: it is there at the end, and confirmed.
        last: two sigma of its place at the end; None if it ended before.
    """

    name: str
    said: str
    way: Track
    sure: bool
    last: Ellipse | None


class FoundLine(NamedTuple):
    """Where a target lies whose bearings do not tell its range yet.

    Attributes:
        said: what hovering tells of it.
        ends_m: (2, 2) the nearest and the farthest place, two sigma of the range; an open end is
            `OPEN_M` away.
    """

    name: str
    said: str
    ends_m: Array


class Scene(NamedTuple):
    """Everything in the tactical picture.

    Attributes:
        found: tracks of the picture.
        names: of target logs, by the index they carry.
        lines: of bearings without a range, at the end.
    """

    carriers: Sequence[CarrierPicture]
    targets: Sequence[TrueTarget]
    found: Sequence[FoundTrack]
    names: Sequence[str]
    lines: Sequence[FoundLine] = ()


def scene(story: Story) -> Scene:
    """The tactical picture of a story, in the axes the own carrier believes in."""
    axes, names = Axes(story), Names()
    carriers = [_carrier(story, axes, name, names) for name in story.carriers]
    true, found = _true_targets(story, axes), found_tracks(story)
    return Scene(carriers, true, found, tuple(names.index), found_lines(story))


def _carrier(story: Story, axes: Axes, name: str, names: Names) -> CarrierPicture:
    reported_logs, corrected_logs = logs_of(story, axes, name, names)
    applied = _applied(story.corrections.get(name, ()))
    return CarrierPicture(
        name=name,
        reported=_reported(story, axes, name),
        corrected=_corrected(story, axes, applied),
        true=_true_carrier(story, axes, name),
        reported_logs=reported_logs,
        corrected_logs=corrected_logs,
        ellipses=[_ellipse(story, axes, a) for a in _evenly(applied[::-1], ELLIPSES)],
    )


def _reported(story: Story, axes: Axes, carrier: str) -> Track:
    messages = _evenly(story.navigation.get(carrier, ()), TRACK_POINTS)
    points = [axes.view_of(message.pose).picture_from_carrier.translation_m for message in messages]
    return _track(story, [message.t_ns for message in messages], [p[:2] for p in points])


class _Applied(NamedTuple):
    """What a correction in force says."""

    t_ns: int
    own_pose: Pose
    axes: OwnAxes


def _applied(corrections: Iterable[Correction]) -> list[_Applied]:
    """Corrections in force, each instant once."""
    said = {
        c.valid_t_ns: _Applied(c.valid_t_ns, c.own_pose, c.own_axes)
        for c in corrections
        if c.state == "applied" and c.own_axes is not None and c.own_pose is not None
    }
    return list(said.values())


def _corrected(story: Story, axes: Axes, applied: Sequence[_Applied]) -> Track:
    some = _evenly(applied, TRACK_POINTS)
    return _track(story, [a.t_ns for a in some], [_place(axes, a) for a in some])


def _place(axes: Axes, applied: _Applied) -> Array:
    """Where a correction puts its carrier (2,)."""
    q = np.array([[applied.axes.east_m, applied.axes.north_m]])
    placed: Array = axes.view_of(applied.own_pose).placed(q)[0]
    return placed


def _ellipse(story: Story, axes: Axes, applied: _Applied) -> Ellipse:
    covariance = symmetric(applied.axes.covariance)[:2, :2]
    turn = axes.view_of(applied.own_pose).picture_from_carrier.rotation[:2, :2]
    return ellipse(story.time_s(applied.t_ns), _place(axes, applied), turn @ covariance @ turn.T)


def ellipse(t_s: float, east_north_m: Array, covariance: Array) -> Ellipse:
    """Two sigmas of a place by its covariance (2, 2) [m^2]."""
    variances, directions = np.linalg.eigh(covariance)
    angle_rad = float(np.arctan2(directions[1, 0], directions[0, 0]))
    return Ellipse(t_s, east_north_m, 2 * SIGMAS * np.sqrt(variances), angle_rad)


def _true_carrier(story: Story, axes: Axes, carrier: str) -> Track:
    times, points = [], []
    for truth in _evenly(story.truth_carriers, TRACK_POINTS):
        view = axes.truth_view(truth)
        if view is not None and carrier in truth.carrier:
            there = truth.position_m[truth.carrier.index(carrier)]
            times.append(truth.t_ns)
            points.append(view.placed(np.array([there]))[0])
    return _track(story, times, points)


def _true_targets(story: Story, axes: Axes) -> list[TrueTarget]:
    truths = {truth.step: truth for truth in story.truth_carriers}
    points: dict[int, list[tuple[int, Array]]] = {}
    called: dict[int, tuple[str, str]] = {}
    for targets in story.truth_targets:
        truth = truths.get(targets.step)
        view = axes.truth_view(truth) if truth is not None else None
        if view is None or not targets.number:
            continue
        called.update(_called(targets))
        for number, point in zip(
            targets.number, view.placed(np.array(targets.position_m)), strict=True
        ):
            points.setdefault(number, []).append((targets.t_ns, point))
    return [
        TrueTarget(*called[number], _track(story, [t for t, _ in way], [p for _, p in way]))
        for number, way in sorted(points.items())
    ]


def found_tracks(story: Story) -> list[FoundTrack]:
    """Every track of the picture, surely there or not, in the order they were begun."""
    last = {track.id for track in story.last_picture.tracks} if story.last_picture else set()
    points: dict[str, list[tuple[int, list[float]]]] = {}
    newest: dict[str, messages.Track] = {}
    for picture in _with_last(story):
        for track in picture.tracks:
            points.setdefault(track.id, []).append((picture.t_ns, track.position_m[:2]))
            newest[track.id] = track
    return [
        _found(story, newest[name], points[name], at_end=name in last)
        for name in sorted(points, key=lambda name: (len(name), name))
    ]


def found_lines(story: Story) -> list[FoundLine]:
    """What bearings alone said at the end of targets whose range they had not determined."""
    last = story.last_picture.lines if story.last_picture else ()
    return [_line(line) for line in last if line.status != "determined"]


def _line(line: messages.BearingLine) -> FoundLine:
    along = np.array([np.sin(line.bearing_rad), np.cos(line.bearing_rad)])
    open_ended = line.range_high_m is None
    ranges_m = np.array([line.range_low_m, OPEN_M if open_ended else line.range_high_m])
    farthest = "any farther" if open_ended else f"{ranges_m[1] / 1000:.3g} km"
    likely = f", likely {line.motion}" if line.motion else ""
    said = f"from {ranges_m[0] / 1000:.3g} km to {farthest}{likely}, {line.bearings} bearings"
    return FoundLine(line.id, said, np.array(line.observer_m) + ranges_m[:, None] * along)


def _with_last(story: Story) -> list[messages.Tracks]:
    pictures = list(story.pictures)
    if story.last_picture is not None and pictures[-1] is not story.last_picture:
        pictures.append(story.last_picture)
    return pictures


def _found(
    story: Story, track: messages.Track, points: list[tuple[int, list[float]]], *, at_end: bool
) -> FoundTrack:
    some = [*_evenly(points[::-1], TRACK_POINTS)][::-1]
    way = _track(story, [t for t, _ in some], [np.array(place) for _, place in some])
    covariance = symmetric(track.covariance)[:2, :2]
    last = ellipse(story.time_s(points[-1][0]), np.array(points[-1][1]), covariance)
    sure = at_end and track.status == "confirmed" and track.existence >= SURE
    return FoundTrack(track.id, _said(track), way, sure, last if at_end else None)


def _said(track: messages.Track) -> str:
    """Likeliest class, existence and who contributes."""
    likely = max(track.classes.items(), key=lambda item: item[1], default=None)
    kind = [f"{likely[0]} {100 * likely[1]:.0f} %"] if likely else []
    there = f"exists {100 * track.existence:.3g} %"
    return ", ".join([*kind, there, f"seen by {' '.join(track.carriers) or 'nobody'}"])


def _called(targets: TruthTargets) -> dict[int, tuple[str, str]]:
    """Number -> name and class."""
    n = len(targets.number)
    identities = targets.identity or [""] * n
    classes = targets.classes or [""] * n
    return {
        number: (identity or f"unnamed {kind or 'target'}", kind)
        for number, identity, kind in zip(targets.number, identities, classes, strict=True)
    }


def _track(story: Story, t_ns: Sequence[int], points: Sequence[Array]) -> Track:
    """A line through points, broken where nothing is known for long."""
    t_s = np.array([story.time_s(t) for t in t_ns])
    places = np.reshape(np.array(points, dtype=float), (-1, 2))
    if len(t_s) < 2:
        return Track(t_s, places)
    steps_s = np.diff(t_s)
    after = np.flatnonzero(steps_s > max(SILENT_S, 5 * float(np.median(steps_s)))) + 1
    return Track(np.insert(t_s, after, np.nan), np.insert(places, after, np.nan, axis=0))


def _evenly(items: Sequence[T], limit: int) -> Sequence[T]:
    return items[stride(len(items), limit)]
