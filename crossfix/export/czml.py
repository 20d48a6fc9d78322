"""A recording as CZML: carriers, corrections, tracks and truth over time, for a Cesium globe."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from math import degrees, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crossfix.evaluation import symmetric
from crossfix.export.shapes import COLOURS
from crossfix.export.situation import Situation, corrected
from crossfix.making import Made, beside
from crossfix.own_frames import as_own
from crossfix.reading_progress import Show, unseen
from crossfix.report.tracks import SIGMAS
from estimation.arrays import Array
from estimation.frames import Site, on_surface, site_at
from schemas import messages as m
from schemas.errors import RecordingError, WireError
from schemas.recording.reader import Recording

Packet = dict[str, Any]
BEARINGS = 3000
"""Lines of bearing that are drawn; of more, an even share."""
GREY = (0.6, 0.6, 0.6)


class Sample(NamedTuple):
    """Where something was, and its ellipse: full half axes [m] and their turn [rad]."""

    t_ns: int
    place: Site
    axes_m: tuple[float, float] | None = None
    turn_rad: float = 0.0


class Ray(NamedTuple):
    """A bearing without a range, from when it was measured."""

    t_ns: int
    ends: tuple[Site, Site]
    until_ns: int


class Found(NamedTuple):
    """Everything that is drawn: ways by their names."""

    reported: dict[str, list[Sample]]
    corrected: dict[str, list[Sample]]
    tracks: dict[str, list[Sample]]
    truth: dict[str, list[Sample]]
    rays: dict[str, list[Ray]]


def export(recording: Recording, path: Path, show: Show = unseen) -> Made:
    """Write a recording as a CZML document.

    Raises:
        RecordingError: damaged, without a scenario, or nobody in it says where it is.
        LaunchError: `path` exists.
    """
    found = _found(recording, show)
    packets = list(packets_of(recording.scenario, found))
    with beside(path) as unfinished:
        unfinished.write_text(json.dumps(packets, allow_nan=False), encoding="utf-8")
        size = unfinished.stat().st_size
    return Made(str(path), len(packets), size)


def packets_of(scenario: m.DeclaredScenario, found: Found) -> Iterator[Packet]:
    """The packets of a document, itself first.

    Raises:
        RecordingError: there is nothing to draw.
    """
    ways = [way for group in found[:4] for way in group.values()]
    times = [sample.t_ns for way in ways for sample in way]
    if not times:
        raise RecordingError("nothing to draw", where=scenario.name, got="no navigation")
    yield _document(scenario.title or scenario.name, min(times), max(times))
    order = {carrier.name: n for n, carrier in enumerate(scenario.carriers)}
    for name, way in found.reported.items():
        shade = COLOURS[order.setdefault(name, len(order)) % len(COLOURS)]
        yield _moving(f"reported/{name}", name, way, shade, 10)
    for name, way in found.corrected.items():
        shade = COLOURS[order.get(name, 0) % len(COLOURS)]
        yield _moving(f"corrected/{name}", f"{name}, corrected", way, shade, 10)
    for name, way in found.tracks.items():
        yield _moving(f"track/{name}", name, way, (0.1, 0.1, 0.1), 6)
    for name, way in found.truth.items():
        yield _moving(f"truth/{name}", name, way, GREY, 4)
    for name, rays in found.rays.items():
        shade = COLOURS[order.get(name.split("/")[0], 0) % len(COLOURS)]
        yield from _lines(name, rays, shade)


def _found(recording: Recording, show: Show) -> Found:
    now = Situation(recording.scenario)
    ways: list[dict[str, list[Sample]]] = [defaultdict(list) for _ in range(4)]
    found = Found(ways[0], ways[1], ways[2], ways[3], defaultdict(list))
    for count, recorded in enumerate(recording.messages(), start=1):
        show(count, recorded.log_time_ns)
        try:
            message = as_own(recorded.decode())
        except WireError:
            continue
        now.hear(message)
        _note(now, message, found)
    return found


def _note(now: Situation, message: object, found: Found) -> None:
    """What one message adds."""
    if isinstance(message, m.Navigation):
        view = now.view(message.carrier, message.t_ns)
        if view is not None:
            found.reported[message.carrier].append(Sample(message.t_ns, view.site))
    elif isinstance(message, m.Correction):
        if (applied := corrected(now, message)) is not None:
            sample = _sample(message.t_ns, applied.place, applied.covariance)
            found.corrected[message.carrier].append(sample)
    elif isinstance(message, m.Tracks):
        for track in message.tracks:
            place = site_at(now.origin, _on_surface(now, track.position_m))
            sample = _sample(message.t_ns, place, symmetric(track.covariance)[:2, :2])
            found.tracks[track.id].append(sample)
    elif isinstance(message, m.TruthTargets):
        names = message.identity or [""] * len(message.number)
        for number, name, point in zip(message.number, names, message.position_m, strict=True):
            place = site_at(now.origin, np.array(point))
            found.truth[name or f"target {number}"].append(Sample(message.t_ns, place))
    elif isinstance(message, m.SourceReport):
        found.rays[f"{message.carrier}/{message.stream}"].extend(_rays(now, message))


def _rays(now: Situation, report: m.SourceReport) -> Iterator[Ray]:
    """Bearings of a report that have no range."""
    seen, view = now.seen(report), now.view(report.carrier, report.t_ns)
    if seen is None or view is None:
        return
    period_s = now.properties(report.carrier, report.stream).period_s
    for end in seen.ray_m[np.isfinite(seen.ray_m).all(axis=1)]:
        there = site_at(view.site, on_surface(view.site, end[0], end[1]))
        yield Ray(report.t_ns, (view.site, there), report.t_ns + round(period_s * 1e9))


def _on_surface(now: Situation, position_m: Sequence[float]) -> Array:
    if len(position_m) == 3:
        return np.array(position_m)
    return on_surface(now.origin, position_m[0], position_m[1])


def _sample(t_ns: int, place: Site, covariance: Array) -> Sample:
    """A place with the ellipse of two sigmas."""
    variances, directions = np.linalg.eigh(np.nan_to_num(covariance))
    minor, major = (float(v) for v in SIGMAS * np.sqrt(np.maximum(variances, 1.0)))
    east, north = directions[:, 1]
    return Sample(t_ns, place, (major, minor), float(np.arctan2(north, east)) - pi / 2)


def _document(name: str, start_ns: int, end_ns: int) -> Packet:
    span = f"{_iso(start_ns)}/{_iso(end_ns)}"
    clock = {
        "interval": span,
        "currentTime": _iso(start_ns),
        "multiplier": 10,
        "range": "LOOP_STOP",
        "step": "SYSTEM_CLOCK_MULTIPLIER",
    }
    return {"id": "document", "name": name, "version": "1.0", "clock": clock}


def _moving(
    id_: str, name: str, way: Sequence[Sample], shade: tuple[float, float, float], pixels: int
) -> Packet:
    """A point with its name, its way behind it, and its ellipse where it has one."""
    epoch_ns = way[0].t_ns
    packet: Packet = {
        "id": id_,
        "name": name,
        "availability": f"{_iso(epoch_ns)}/{_iso(way[-1].t_ns + 1)}",
        "position": {
            "epoch": _iso(epoch_ns),
            "interpolationAlgorithm": "LINEAR",
            "cartographicDegrees": [
                value for s in way for value in (_seconds(s, epoch_ns), *_degrees(s.place))
            ],
        },
        "point": {"pixelSize": pixels, "color": _rgba(shade)},
        "path": {"width": 1, "leadTime": 0, "material": _solid(shade, 0.7)},
        "label": {
            "text": name,
            "font": "12px sans-serif",
            "fillColor": _rgba(shade),
            "horizontalOrigin": "LEFT",
            "pixelOffset": {"cartesian2": [8, 0]},
        },
    }
    if all(sample.axes_m is not None for sample in way):
        packet["ellipse"] = _ellipse(way, epoch_ns, shade)
    return packet


def _ellipse(way: Sequence[Sample], epoch_ns: int, shade: tuple[float, float, float]) -> Packet:
    def sampled(values: Sequence[float]) -> Packet:
        pairs = zip(way, values, strict=True)
        return {
            "epoch": _iso(epoch_ns),
            "number": [x for s, value in pairs for x in (_seconds(s, epoch_ns), value)],
        }

    axes = [sample.axes_m or (0.0, 0.0) for sample in way]
    return {
        "semiMajorAxis": sampled([major for major, _ in axes]),
        "semiMinorAxis": sampled([minor for _, minor in axes]),
        "rotation": sampled([sample.turn_rad for sample in way]),
        "height": 0,
        "material": _solid(shade, 0.3),
    }


def _lines(name: str, rays: Sequence[Ray], shade: tuple[float, float, float]) -> Iterator[Packet]:
    every = max(1, -(-len(rays) // BEARINGS))
    for n, ray in enumerate(rays[::every]):
        yield {
            "id": f"bearing/{name}/{n}",
            "name": name,
            "availability": f"{_iso(ray.t_ns)}/{_iso(ray.until_ns)}",
            "polyline": {
                "positions": {"cartographicDegrees": [v for e in ray.ends for v in _degrees(e)]},
                "width": 1,
                "material": _solid(shade, 0.6),
            },
        }


def _degrees(place: Site) -> tuple[float, float, float]:
    longitude, latitude = degrees(place.longitude_rad), degrees(place.latitude_rad)
    return round(longitude, 9), round(latitude, 9), round(place.altitude_m, 3)


def _seconds(sample: Sample, epoch_ns: int) -> float:
    return (sample.t_ns - epoch_ns) * 1e-9


def _iso(t_ns: int) -> str:
    """UTC to the microsecond, as ISO 8601 has it."""
    at = datetime.fromtimestamp(t_ns // 10**9, UTC).replace(microsecond=t_ns % 10**9 // 1000)
    return at.isoformat().replace("+00:00", "Z")


def _rgba(shade: tuple[float, float, float], opacity: float = 1.0) -> Packet:
    return {"rgba": [round(255 * part) for part in (*shade, opacity)]}


def _solid(shade: tuple[float, float, float], opacity: float) -> Packet:
    return {"solidColor": {"color": _rgba(shade, opacity)}}
