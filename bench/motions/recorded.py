"""Recorded motions of ships, aircraft, gliders and calibration flights, cut into pieces.

Where the files are: `CROSSFIX_DATA`, as of scenarios. A piece moves with the speeds and courses
that were reported, even between two reports: these are smooth, while stamps of the places are wrong
by seconds, so that a flight along the places would leap.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import groupby
from math import nan, radians
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.motions.worlds import STEP_S, World, laid
from estimation.arrays import Array
from estimation.frames import Site, wrap_pi
from sim_world.scenario.motions import Columns, TrackFile
from sim_world.tracks_csv import KNOT_MPS, Recordings, Report, read_reports, recordings

LEAST_S = 150.0  # of a piece
_LOOK_S = 10.0  # before and after an instant
_TURNS_RAD, _HASTENS = np.radians(3.0), 0.03  # an angle, a share of the speed
_HARBOUR_FROM, _HARBOUR_M = datetime(2016, 1, 12, 13, 20, tzinfo=UTC), 15e3
_LEAST_M = 5.0  # that a manoeuvre pushes aside; less is the noise of reports


class Source(NamedTuple):
    """Files of one kind of target.

    Attributes:
        gap_s: silence at which a track is cut.
        moving_mps: mean speed from which a piece is taken; fastest_mps: beyond it is no speed.
        columns: of the files, CSV or JSON.
    """

    kind: str
    files: tuple[str, ...]
    gap_s: float
    moving_mps: float
    fastest_mps: float
    columns: Columns


_FLIGHT = Columns(
    time="timestamp",
    id="icao24",
    latitude_deg="latitude",
    longitude_deg="longitude",
    speed_knots="groundspeed",
    course_deg="track",
)
SOURCES = (
    Source(
        "ships of the Solent",
        ("solent_ais_20160112.csv.gz",),
        gap_s=20.0,
        moving_mps=1.0,
        fastest_mps=40.0,
        columns=Columns(
            time="Time",
            id="MMSI",
            latitude_deg="Latitude_degrees",
            longitude_deg="Longitude_degrees",
            speed_knots="SOG_knots",
            course_deg="COG_degrees",
        ),
    ),
    Source(
        "aircraft over Britain",
        ("opensky_states_20210712.csv.gz",),
        gap_s=25.0,
        moving_mps=30.0,
        fastest_mps=400.0,
        columns=Columns(
            time="time",
            id="icao24",
            latitude_deg="lat",
            longitude_deg="lon",
            speed_mps="velocity",
            course_deg="heading",
        ),
    ),
    Source(
        "calibration flights", ("toulouse.json.gz", "munich.json.gz"), 15.0, 30.0, 400.0, _FLIGHT
    ),
    Source("gliders", ("luberon.json.gz", "franconia.json.gz"), 30.0, 10.0, 100.0, _FLIGHT),
)


def recorded(
    rng: np.random.Generator, source: Source, folder: Path, most: int, seconds: float, half_m: float
) -> World:
    """Pieces of the files at random, each turned and laid at random: `most` of them, or all."""
    pieces = [
        piece
        for name in source.files
        for track in _tracks(folder / name, source)
        for piece in _pieces(track, source.gap_s, seconds)
        if np.mean([report.speed_mps for report in piece]) >= source.moving_mps
    ]
    times = np.arange(round(seconds / STEP_S)) * STEP_S
    chosen = rng.permutation(len(pieces))[:most]
    velocity, alive = (
        np.stack(part, axis=1)
        for part in zip(*(_way(rng, pieces[k], times) for k in chosen), strict=True)
    )
    place = laid(rng, velocity, half_m)
    rows = np.zeros(len(chosen), dtype=np.intp)
    return World(
        half_m, (source.kind,), rows, place, velocity, alive, *_manoeuvres(place, velocity)
    )


def harbour(folder: Path, seconds: float) -> World:
    """All ships of the Solent where they were, by the distance to the nearest other."""
    source = SOURCES[0]
    file = TrackFile(
        file=source.files[0], columns=source.columns, start=_HARBOUR_FROM, max_gap_s=400.0
    )
    reports = read_reports(folder / source.files[0], source.columns)
    origin = Site(radians(50.76), radians(-1.12))
    paths = Recordings(origin, [(each, file) for each in recordings(reports, file, origin, 5)])
    times = np.arange(round(seconds / STEP_S)) * STEP_S
    moves, exists = zip(*(paths.at(float(t)) for t in times), strict=True)
    place = np.array([each.position_m[:, :2] for each in moves])
    velocity = np.array([each.velocity_mps[:, :2] for each in moves])
    alive, place, velocity = _near(np.array(exists), place, velocity)
    apart = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1)[:: round(10 / STEP_S)]
    apart[:, range(apart.shape[1]), range(apart.shape[1])] = np.inf
    nearest = np.median(apart.min(axis=2), axis=0)
    names = ("within 20 m of another", "20 to 40 m", "40 to 80 m", "farther from any other")
    kind = np.searchsorted([20.0, 40.0, 80.0], nearest)
    half_m = float(np.abs(place).max())
    return World(half_m, names, kind, place, velocity, alive, *_manoeuvres(place, velocity))


def _near(
    alive: NDArray[np.bool_], place_m: Array, velocity_mps: Array
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Those that are there all the time, within the radars' reach."""
    rows = np.flatnonzero(alive.all(axis=0) & (np.abs(place_m).max(axis=(0, 2)) < _HARBOUR_M))
    return alive[:, rows], place_m[:, rows], velocity_mps[:, rows]


def _tracks(path: Path, source: Source) -> Iterator[list[Report]]:
    """Reports of one target each, in the order of the file."""
    flights = path.name.endswith(".json.gz")
    reports = _flights(path, source.columns) if flights else read_reports(path, source.columns)
    for _, group in groupby(sorted(reports, key=attrgetter("id")), attrgetter("id")):
        moving = (r for r in group if r.speed_mps <= source.fastest_mps)  # nan neither
        yield [report for report in moving if not np.isnan(report.course_rad)]


def _flights(path: Path, columns: Columns) -> list[Report]:
    """A list of states in JSON, times in milliseconds."""
    with gzip.open(path, "rt", encoding="utf-8") as stream:
        states = json.load(stream)
    return [
        Report(
            id=state[columns.id],
            time_s=state[columns.time] / 1000,
            latitude_rad=radians(state[columns.latitude_deg]),
            longitude_rad=radians(state[columns.longitude_deg]),
            altitude_m=nan,
            speed_mps=state[columns.speed_knots] * KNOT_MPS,
            course_rad=radians(state[columns.course_deg]),
        )
        for state in states
    ]


def _pieces(track: Sequence[Report], gap_s: float, seconds: float) -> Iterator[list[Report]]:
    """Stretches without a gap or a step back, about as long as asked for, none too short."""
    piece: list[Report] = []
    for report in track:
        if piece and not 0 <= report.time_s - piece[-1].time_s <= gap_s:
            yield from _long_enough(piece)
            piece = []
        piece.append(report)
        if report.time_s - piece[0].time_s >= seconds:
            yield from _long_enough(piece)
            piece = [report]
    yield from _long_enough(piece)


def _long_enough(piece: list[Report]) -> Iterator[list[Report]]:
    if piece and piece[-1].time_s - piece[0].time_s >= LEAST_S:
        yield piece


def _way(
    rng: np.random.Generator, piece: Sequence[Report], times: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Velocities (S, 2), turned as a whole by an angle at random, and when (S,) there are any."""
    t_s = np.array([report.time_s for report in piece]) - piece[0].time_s
    course = np.array([report.course_rad for report in piece])
    course = course[0] + np.cumsum(np.append(0.0, wrap_pi(np.diff(course))))
    speeds = np.interp(times, t_s, [report.speed_mps for report in piece])
    courses = np.interp(times, t_s, course) + rng.uniform(0, 2 * np.pi)
    velocity = speeds[:, None] * np.column_stack([np.sin(courses), np.cos(courses)])
    return velocity, times <= t_s[-1]


def _manoeuvres(place_m: Array, velocity_mps: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """When ways (S, N, 2) turn, and when they change speed: by ten seconds before and after."""
    look = round(_LOOK_S / STEP_S)
    reach = look * STEP_S * velocity_mps
    ahead = np.concatenate([place_m[look:], place_m[-look:] + reach[-look:]])
    behind = np.concatenate([place_m[:look] - reach[:look], place_m[:-look]])
    before, after = (place_m - behind) / _LOOK_S, (ahead - place_m) / _LOOK_S
    slow, fast = np.linalg.norm(before, axis=-1), np.linalg.norm(after, axis=-1)
    crossed = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    angle = np.abs(np.arctan2(crossed, (before * after).sum(axis=-1)))
    change, faster = np.abs(fast - slow), np.maximum(slow, fast)
    turns = (angle > _TURNS_RAD) & (angle * faster * _LOOK_S > _LEAST_M)
    hastens = (change > _HASTENS * faster) & (change * _LOOK_S > _LEAST_M)
    return turns, hastens & ~turns
