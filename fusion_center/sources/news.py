"""What sources that track by themselves say anew: as plots, each measurement once.

An increment, or a track whose filter is sent, is turned into the plot that says what the source has
learnt since its last report of that track. Of a track without a filter, or of which a report is
missing, the place is taken whole, with a covariance so much larger as most of it has been said
before. What was used of which track, and when, is remembered, by each user of the reports for
itself: the picture begins to hear a carrier when its frame is known, its frame is sought before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.relative_frame.tracks import (
    Increment,
    MotionModel,
    TrackLog,
    as_plots,
    equivalent_measurement,
    reuse,
)
from estimation.tracking.bank import Bank, carried
from schemas.messages import SourceProperties, SourceReport, TrackFilter

from ..navigation import NS
from ..state import Told
from .coordinates import Places, instants_ns

SAME_NS = 1_000_000
"""Two stamps nearer to each other than this are of one report."""
UNKNOWN_MEMORY_S = 10.0
"""Of the filters of a source that does not say."""
KEPT_NS = 600_000_000_000
"""Of tracks that are silent."""
MOST_TRACKS = 10_000
"""Of one source, remembered."""
NEVER = -(2**60)
MODEL = "constant_velocity"
Flags = NDArray[np.bool_]
Stamps = NDArray[np.int64]


class News(NamedTuple):
    """Logs of a report as plots.

    Attributes:
        found: places from where the carrier was at each log; nan where that brings nothing new.
        told: what is to be remembered of the source.
    """

    found: Places
    told: Told


class _Logs(NamedTuple):
    """The logs (n,) of a report: kinds, names, times, rows in memory or -1."""

    kind: NDArray[np.str_]
    name: list[str]
    at_ns: NDArray[np.int64]
    row: NDArray[np.intp]


NOTHING_TOLD = Told(
    names=(),
    t_ns=np.zeros(0, dtype=np.int64),
    used_ns=np.zeros(0, dtype=np.int64),
    state=np.zeros((0, 4)),
    covariance=np.zeros((0, 4, 4)),
)


def memory_s(properties: SourceProperties) -> float:
    """Time in which the filters of a source forget an error to 1/e."""
    return properties.filter_memory_s or UNKNOWN_MEMORY_S


def has_tracks(report: SourceReport, properties: SourceProperties) -> bool:
    """Whether any of its logs is more than a plot; if it does not say, by what its source sends."""
    return any(kind != "plot" for kind in _kinds(report, properties))


def _kinds(report: SourceReport, properties: SourceProperties) -> list[str]:
    unsaid = "track" if properties.sends_tracks else "plot"
    return [kind or unsaid for kind in report.kind] if report.kind else [unsaid] * len(report)


def news(
    before: Told,
    report: SourceReport,
    properties: SourceProperties,
    found: Places,
    ways_m: Array,
) -> News:
    """What is new in a report, and what to remember of it.

    Args:
        before: what is remembered of its source.
        found: places of the logs, from where the carrier was at each.
        ways_m: (n, 2) its dead-reckoned way at each: places plus it stand still.
    """
    logs = _logs(before, report, properties)
    said = found._replace(
        covariance=found.covariance.copy(), east_north_m=found.east_north_m.copy()
    )
    filters = _filters(report, ways_m)
    is_increment = np.array([k == "increment" for k in logs.kind.tolist()], dtype=np.bool_)
    is_track = np.array([k == "track" for k in logs.kind.tolist()], dtype=np.bool_)
    since = np.where(logs.row >= 0, logs.at_ns - _at(before.t_ns, logs.row), 1)
    waited = logs.at_ns - np.where(logs.row >= 0, _at(before.used_ns, logs.row), NEVER)
    named = np.array([bool(name) for name in logs.name], dtype=np.bool_)
    exact = is_track & (since > 0) & _continued(before, logs, filters)
    whole = is_track & ~exact & named & (since > 0)
    fresh = (is_increment & (since > 0)) | exact | whole
    _put_increments(said, report, np.flatnonzero(is_increment & fresh))
    _put_equivalents(said, before, logs, filters, np.flatnonzero(exact), ways_m)
    _thinned(said, whole, waited, memory_s(properties))
    useful = fresh & _definite(said.covariance)
    silent = (is_increment | is_track) & ~useful
    said.east_north_m[silent & found.usable] = np.nan
    said.covariance[silent] = np.nan
    return News(said, _remembered(before, logs, filters, named & (since > 0), useful))


def _logs(before: Told, report: SourceReport, properties: SourceProperties) -> _Logs:
    n = len(report)
    rows = {name: row for row, name in enumerate(before.names)}
    nobody: list[str | None] = [None] * n
    named = zip(report.track_id or nobody, report.identity or nobody, strict=True)
    names = [track or (f"/{identity}" if identity else "") for track, identity in named]
    return _Logs(
        np.array(_kinds(report, properties)),
        names,
        instants_ns(report),
        np.array([rows.get(name, -1) for name in names], dtype=np.intp),
    )


class _Filters(NamedTuple):
    """Filters (n,) behind logs: state over ground, nan where none that is known."""

    bank: Bank
    noise: Array
    since_ns: NDArray[np.int64]


def _filters(report: SourceReport, ways_m: Array) -> _Filters:
    n = len(report)
    state, covariance = np.full((n, 4), np.nan), np.full((n, 4, 4), np.nan)
    noise, since_ns = np.zeros(n), np.full(n, -1, dtype=np.int64)
    upper = np.triu_indices(4)
    for i, sent in enumerate(report.filter or ()):
        if isinstance(sent, TrackFilter) and sent.model == MODEL and len(sent.state) == 4:
            state[i], noise[i], since_ns[i] = sent.state, sent.q, sent.previous_t_ns
            covariance[i][upper] = covariance[i].T[upper] = sent.covariance
    state[:, :2] += ways_m
    return _Filters(Bank(state, covariance), noise, since_ns)


def _continued(before: Told, logs: _Logs, filters: _Filters) -> Flags:
    """(n,) whether a filter goes on from the report of its track that is remembered."""
    if not before.names:
        return np.zeros(len(logs.row), dtype=np.bool_)
    known = np.isfinite(filters.bank.state[:, 0]) & np.isfinite(before.state[logs.row, 0])
    same = np.abs(filters.since_ns - before.t_ns[logs.row]) < SAME_NS
    return np.asarray((logs.row >= 0) & known & same, dtype=np.bool_)


def _thinned(places: Places, which: Flags, waited_ns: Stamps, memory_s: float) -> None:
    """Widen whole tracks: what they said the last time is for the most part said again.

    Errors of an exponential memory, uses `waited_ns` apart: the mean of many uses is as much worse
    than that of independent ones as the covariance is made larger here (`tracks.reuse`).
    """
    factor = np.array([reuse(w * NS, memory_s).inflation for w in waited_ns[which].tolist()])
    places.covariance[which] *= factor.reshape(-1, 1, 1)


def _put_increments(places: Places, report: SourceReport, which: NDArray[np.intp]) -> None:
    """Replace places of increments by what they say; nan where they say nothing of a place."""
    for i in which.tolist():
        sent = report.increment[i] if report.increment else None
        places.covariance[i] = np.nan
        if sent is None or sent.frame != "carrier":
            continue
        size = len(sent.y)
        matrix = np.zeros((size, size))
        matrix[np.triu_indices(size)] = sent.information
        matrix = matrix + np.triu(matrix, 1).T
        place, covariance = as_plots(Increment(np.array(sent.y, dtype=float), matrix))
        places.east_north_m[i], places.covariance[i] = place, covariance


def _put_equivalents(
    places: Places,
    before: Told,
    logs: _Logs,
    filters: _Filters,
    which: NDArray[np.intp],
    ways_m: Array,
) -> None:
    """Replace places of tracks by plots that say what their filters have learnt."""
    for noise in np.unique(filters.noise[which]).tolist():
        some = which[filters.noise[which] == noise]
        rows = logs.row[some]
        elapsed_s = (logs.at_ns[some] - before.t_ns[rows]) * 1e-9
        known = carried(Bank(before.state[rows], before.covariance[rows]), elapsed_s, noise)
        gained = equivalent_measurement(
            TrackLog(*known),
            TrackLog(*filters.bank.take(some)),
            MotionModel(np.eye(4), np.zeros((4, 4))),  # it is carried on already
        )
        place, covariance = as_plots(gained)
        places.east_north_m[some] = place - ways_m[some]
        places.covariance[some] = covariance


def _definite(covariance: Array) -> Flags:
    """(n,) whether a matrix (n, 2, 2) is a covariance."""
    trace = covariance[:, 0, 0] + covariance[:, 1, 1]
    determinant = covariance[:, 0, 0] * covariance[:, 1, 1] - covariance[:, 0, 1] ** 2
    return np.asarray((trace > 0) & (determinant > 0) & np.isfinite(trace), dtype=np.bool_)


def _remembered(before: Told, logs: _Logs, filters: _Filters, renewed: Flags, used: Flags) -> Told:
    """The memory with the newest report of each track; what has been silent for long is gone."""
    last = {logs.name[i]: i for i in np.flatnonzero(renewed).tolist()}
    which = np.array(list(last.values()), dtype=np.intp)
    newest = int(max(logs.at_ns.max(initial=0), before.t_ns.max(initial=0)))
    horizon = newest - KEPT_NS
    old = [k for k, n in enumerate(before.names) if n not in last and before.t_ns[k] >= horizon]
    kept = np.array(old[-max(MOST_TRACKS - len(which), 0) :], dtype=np.intp)
    earlier = np.where(logs.row >= 0, _at(before.used_ns, logs.row), NEVER)
    used_ns = np.where(used, logs.at_ns, earlier)[which]
    return Told(
        names=(*(before.names[k] for k in kept.tolist()), *last),
        t_ns=np.concatenate([before.t_ns[kept], logs.at_ns[which]]),
        used_ns=np.concatenate([before.used_ns[kept], used_ns]),
        state=np.concatenate([before.state[kept], filters.bank.state[which]]),
        covariance=np.concatenate([before.covariance[kept], filters.bank.covariance[which]]),
    )


def _at(column: NDArray[np.int64], row: NDArray[np.intp]) -> NDArray[np.int64]:
    """Cells of rows, anything where there is none."""
    return column[row] if len(column) else np.zeros(len(row), dtype=np.int64)
