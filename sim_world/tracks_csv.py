"""Recorded tracks from CSV files, resampled so that they can be asked for at any instant."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from datetime import UTC, datetime
from itertools import groupby
from math import isfinite, radians
from operator import attrgetter
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import Site, enu_from_geodetic, on_surface
from schemas.errors import ScenarioError

from .motion import Kinematics, curved
from .scenario.motions import Columns, TrackFile

KNOT_MPS = 1852 / 3600
CONTRADICTION_MPS = 5.0
"""A reported velocity further from the places' own is not used (102.3 knots is AIS for unknown)."""


class Report(NamedTuple):
    """One line of a file: an id, a time [Unix s] and what was reported, NaN where nothing."""

    id: str
    time_s: float
    latitude_rad: float
    longitude_rad: float
    altitude_m: float
    speed_mps: float
    course_rad: float


class Recording(NamedTuple):
    """One track: times [s of the scenario], positions (K, 3) [m], level velocities (K, 2)."""

    id: str
    t_s: Array
    position_m: Array
    velocity_mps: Array


def read_reports(path: Path, columns: Columns) -> list[Report]:
    """All reports of a file; lines without a place or a time are left out.

    Raises:
        ScenarioError: it is no CSV, a column is missing, or a cell is no number.
    """
    try:
        with _opened(path) as stream:
            lines = csv.DictReader(stream)
            _require_columns(path, lines.fieldnames or (), columns)
            numbered = (_Line(path.name, n, line) for n, line in enumerate(lines, start=2))
            return [report for line in numbered if (report := _report(line, columns))]
    except (OSError, EOFError, UnicodeDecodeError, csv.Error) as error:
        raise ScenarioError("unreadable", where=path.name, got=str(error)) from None


def recordings(
    reports: Sequence[Report], tracks: TrackFile, origin: Site, min_reports: int = 2
) -> Iterator[Recording]:
    """The tracks of a file by id, thinned to `min_interval_s`, in the axes at `origin`."""
    start_s = tracks.start.timestamp()
    for name, group in groupby(sorted(reports, key=attrgetter("id", "time_s")), attrgetter("id")):
        of_one = np.array([r[1:] for r in group])
        kept = of_one[_spaced(of_one[:, 0], tracks.min_interval_s)]
        if len(of_one) >= min_reports and len(kept) >= 2:
            yield _recording(name, kept, tracks, origin, start_s)


class Recordings:
    """Many recorded tracks as arrays: kinematics of all of them at once, where they exist."""

    def __init__(self, origin: Site, tracks: Sequence[tuple[Recording, TrackFile]]) -> None:
        self.origin = origin
        ends = np.cumsum([0, *(len(recording.t_s) for recording, _ in tracks)])
        self._first, self._last = ends[:-1], ends[1:] - 1
        self._t_s = np.concatenate([np.empty(0), *(r.t_s for r, _ in tracks)])
        self._position_m = np.concatenate([np.empty((0, 3)), *(r.position_m for r, _ in tracks)])
        velocities = (r.velocity_mps for r, _ in tracks)
        self._velocity_mps = np.concatenate([np.empty((0, 2)), *velocities])
        self._max_gap_s = np.array([file.max_gap_s for _, file in tracks])
        self._linear = np.array([file.resample == "linear" for _, file in tracks], dtype=bool)

    def at(self, t_s: float) -> tuple[Kinematics, np.ndarray]:
        """Kinematics of all tracks at an instant, and which of them exist (N,) then."""
        here = np.clip(self._before(t_s), self._first, self._last - 1)
        h = self._t_s[here + 1] - self._t_s[here]
        s = (t_s - self._t_s[here]) / h
        exists = (s >= 0) & (s <= 1) & (h <= self._max_gap_s)
        return self._between(here, h[:, None], np.clip(s, 0, 1)[:, None]), exists

    def _before(self, t_s: float) -> np.ndarray:
        """Index of each track's last report at or before `t_s`."""
        passed = np.concatenate([[0], np.cumsum(self._t_s <= t_s)])
        here: np.ndarray = self._first + passed[self._last + 1] - passed[self._first] - 1
        return here

    def _between(self, here: np.ndarray, h: Array, s: Array) -> Kinematics:
        """Cubic Hermite between two reports, h seconds apart, at the share s of the way."""
        a, b = self._position_m[here, :2], self._position_m[here + 1, :2]
        chord = (b - a) / h
        straight = self._linear[:, None]
        u = np.where(straight, chord, self._velocity_mps[here])
        v = np.where(straight, chord, self._velocity_mps[here + 1])
        bend, twist = 3 * chord - 2 * u - v, u + v - 2 * chord  # of s^2 and s^3, per h
        level = a + h * s * (u + s * (bend + s * twist))
        velocity = u + s * (2 * bend + 3 * s * twist)
        acceleration = (2 * bend + 6 * s * twist) / h
        up = self._position_m[here, 2:]
        altitude = up + s * (self._position_m[here + 1, 2:] - up)
        position = on_surface(self.origin, level[:, 0], level[:, 1], altitude[:, 0])
        return curved(position, velocity, acceleration)


def _recording(
    name: str, reports: Array, tracks: TrackFile, origin: Site, start_s: float
) -> Recording:
    """Of reports (K, 6), in the order of `Report`; the third coordinate is the altitude."""
    time, latitude, longitude, altitude, speed, course = reports.T
    altitude = np.where(np.isnan(altitude), tracks.altitude_m, altitude)
    position = enu_from_geodetic(origin, latitude, longitude, altitude)
    position[:, 2] = altitude
    t = time - start_s
    reported = speed[:, None] * np.column_stack([np.sin(course), np.cos(course)])
    return Recording(name, t, position, _trusted(reported, _slopes(t, position[:, :2])))


def _trusted(reported: Array, slopes: Array) -> Array:
    """Reported velocities (K, 2), but where absent or contradicted by the places, the slopes."""
    difference = np.linalg.norm(reported - slopes, axis=1)
    agrees = difference <= np.maximum(np.linalg.norm(slopes, axis=1), CONTRADICTION_MPS)
    return np.where(agrees[:, None], reported, slopes)


def _slopes(t: Array, x: Array) -> Array:
    """Derivatives (K, 2) at each report, of the parabola through it and its neighbours."""
    h = np.diff(t)[:, None]
    chords = np.diff(x, axis=0) / h
    inner = (h[1:] * chords[:-1] + h[:-1] * chords[1:]) / (h[1:] + h[:-1])
    return np.concatenate([chords[:1], inner, chords[-1:]])


def _spaced(t: Array, min_interval_s: float) -> list[int]:
    """Indices of reports, each later than the one before by at least the interval."""
    kept = [0]
    for n, time in enumerate(t):
        if time - t[kept[-1]] >= max(min_interval_s, 1e-3):
            kept.append(n)
    return kept


def _opened(path: Path) -> AbstractContextManager[IO[str]]:
    if path.suffix == ".gz":
        return gzip.open(path, "rt", encoding="utf-8-sig", newline="")
    return path.open(encoding="utf-8-sig", newline="")


def _require_columns(path: Path, names: Sequence[str], columns: Columns) -> None:
    for field in columns.__struct_fields__:
        name = getattr(columns, field)
        if name and name not in names:
            raise ScenarioError(
                "no such column",
                where=f"{path.name}: columns.{field}",
                got=name,
                expected="one of " + ", ".join(names),
            )


class _Line(NamedTuple):
    """One line of a file, to say where a cell is wrong."""

    file: str
    number: int
    cells: dict[str, str]

    def text(self, column: str) -> str:
        """A cell; empty where there is no such column or the line is too short."""
        return (self.cells.get(column) or "").strip()

    def value(self, column: str) -> float:
        """A cell as a number, NaN where it is empty."""
        try:
            return float(self.text(column) or "nan")
        except ValueError:
            raise self._error(column, "a number") from None

    def time_s(self, column: str) -> float:
        """Unix seconds of a time, which is UTC where it names no zone; NaN where it is empty."""
        text = self.text(column)
        with suppress(ValueError):
            return float(text or "nan")
        try:
            time = datetime.fromisoformat(text)
        except ValueError:
            raise self._error(column, "ISO 8601 or Unix seconds") from None
        return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()

    def _error(self, column: str, expected: str) -> ScenarioError:
        where = f"{self.file} line {self.number}: {column}"
        return ScenarioError("unreadable", where=where, got=self.text(column), expected=expected)


def _report(line: _Line, columns: Columns) -> Report | None:
    """One line understood; None where it holds no place or time."""
    knots = line.value(columns.speed_knots) * KNOT_MPS
    report = Report(
        id=line.text(columns.id),
        time_s=line.time_s(columns.time),
        latitude_rad=radians(line.value(columns.latitude_deg)),
        longitude_rad=radians(line.value(columns.longitude_deg)),
        altitude_m=line.value(columns.altitude_m),
        speed_mps=knots if columns.speed_knots else line.value(columns.speed_mps),
        course_rad=radians(line.value(columns.course_deg)),
    )
    placed = isfinite(report.time_s + report.latitude_rad + report.longitude_rad)
    return report if placed else None
