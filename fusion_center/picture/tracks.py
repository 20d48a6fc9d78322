"""What sources that track by themselves say anew: as plots, each measurement once.

An increment, or a track whose filter is sent, is turned into the plot that says what the source has
learnt since its last report of that track. Of a track without a filter, or of which a report is
missing, the place is taken whole, with a covariance so much larger as most of it has been said
before. What was used of which track, and when, is remembered.
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
from ..relative_frames.views import UNKNOWN_MEMORY_S
from ..sources.coordinates import Places
from ..state import Told

SAME_NS = 1_000_000
"""Two stamps nearer to each other than this are of one report."""
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
        found: places from the carrier at its stamp; nan where a log brings nothing new.
        told: what is to be remembered of the source.
    """

    found: Places
    told: Told


class _Logs(NamedTuple):
    """The logs (n,) of a report that are no plots: kinds, names, times, rows in memory or -1."""

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


def has_tracks(report: SourceReport) -> bool:
    """Whether any of its logs is more than a plot."""
    return report.kind is not None and any(kind and kind != "plot" for kind in report.kind)


def news(
    before: Told,
    report: SourceReport,
    at_ns: Stamps,
    moved_m: Array,
    found: Places,
    way_m: Array,
    memory_s: float,
) -> News:
    """What is new in a report, and what to remember of it.

    Args:
        before: what is remembered of its source.
        at_ns: (n,) instants of the logs.
        found: places of the logs, from the carrier at its stamp.
        moved_m: (n, 2) the carrier's way from its stamp to each log.
        way_m: (2,) dead-reckoned way of the carrier at the stamp: places plus it stand still.
        memory_s: of the source's filters.
    """
    logs = _logs(before, report, at_ns)
    moved = found._replace(
        covariance=found.covariance.copy(), east_north_m=found.east_north_m.copy()
    )
    filters = _filters(report, way_m + moved_m)
    is_increment = np.array([k == "increment" for k in logs.kind.tolist()], dtype=np.bool_)
    is_track = np.array([k == "track" for k in logs.kind.tolist()], dtype=np.bool_)
    since = np.where(logs.row >= 0, logs.at_ns - _at(before.t_ns, logs.row), 1)
    waited = logs.at_ns - np.where(logs.row >= 0, _at(before.used_ns, logs.row), NEVER)
    named = np.array([bool(name) for name in logs.name], dtype=np.bool_)
    exact = is_track & (since > 0) & _continued(before, logs, filters)
    whole = is_track & ~exact & named & (since > 0)
    fresh = (is_increment & (since > 0)) | exact | whole
    _put_increments(moved, report, moved_m, np.flatnonzero(is_increment & fresh))
    _put_equivalents(moved, before, logs, filters, np.flatnonzero(exact), way_m)
    _thinned(moved, whole, waited, memory_s)
    useful = fresh & _definite(moved.covariance)
    moved.covariance[(is_increment | is_track) & ~useful] = np.nan
    return News(moved, _remembered(before, logs, filters, named & (since > 0), useful))


def _logs(before: Told, report: SourceReport, at_ns: Stamps) -> _Logs:
    n = len(report)
    rows = {name: row for row, name in enumerate(before.names)}
    names = [name or "" for name in report.track_id or [""] * n]
    return _Logs(
        np.array([kind or "plot" for kind in report.kind or ["plot"] * n]),
        names,
        at_ns,
        np.array([rows.get(name, -1) for name in names], dtype=np.intp),
    )


class _Filters(NamedTuple):
    """Filters (n,) behind logs: state over ground, nan where none that is known."""

    bank: Bank
    noise: Array
    since_ns: NDArray[np.int64]


def _filters(report: SourceReport, way_m: Array) -> _Filters:
    n = len(report)
    state, covariance = np.full((n, 4), np.nan), np.full((n, 4, 4), np.nan)
    noise, since_ns = np.zeros(n), np.full(n, -1, dtype=np.int64)
    upper = np.triu_indices(4)
    for i, sent in enumerate(report.filter or ()):
        if isinstance(sent, TrackFilter) and sent.model == MODEL and len(sent.state) == 4:
            state[i], noise[i], since_ns[i] = sent.state, sent.q, sent.previous_t_ns
            covariance[i][upper] = covariance[i].T[upper] = sent.covariance
    state[:, :2] += way_m
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


def _put_increments(
    places: Places, report: SourceReport, moved_m: Array, which: NDArray[np.intp]
) -> None:
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
        places.east_north_m[i], places.covariance[i] = place + moved_m[i], covariance


def _put_equivalents(
    places: Places,
    before: Told,
    logs: _Logs,
    filters: _Filters,
    which: NDArray[np.intp],
    way_m: Array,
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
        places.east_north_m[some] = place - way_m
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
