"""The last two logs of every target of a source and its track, report by report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.tracking.source_tracks import Sensing
from schemas.messages import SourceProperties, SourceReport

from ..navigation import NS
from ..settings import LogSettings, TrackingSettings
from ..state import Dictionary, Learned, SourceLogs
from .coordinates import Places
from .features import NOTHING_LEARNED, heard
from .reading import Fresh, read
from .telling import after_logs, refitted
from .tracks import NAMELESS, Filters, filtered, named, sensing, unseen

LEAP_SIGMAS = 6.0


class Absorbed(NamedTuple):
    """What became of the logs of one report.

    Attributes:
        logs: how many there were.
        sigma_defaults: brought no sigma of their own.
        without_sigma: have a position, but neither they nor their source a sigma: not used.
        increments: that say nothing new of a place: not used.
        superseded: not newer than what is known of their target: not used.
        astray: measured so long before or after their report's stamp that nothing can be done with
            them: not used.
        claimed_twice: names that two logs claim: none of these is used.
        recycled: names that leapt further than any target moves: taken for new targets.
    """

    logs: int = 0
    sigma_defaults: int = 0
    without_sigma: int = 0
    increments: int = 0
    superseded: int = 0
    astray: int = 0
    claimed_twice: tuple[str, ...] = ()
    recycled: tuple[str, ...] = ()


NO_LOGS = SourceLogs(
    report_seq=0,
    report_t_ns=-1,
    born=0,
    key=(),
    identity=(),
    track=(),
    seq=np.zeros(0, dtype=np.int64),
    index=np.zeros(0, dtype=np.int64),
    t_ns=np.zeros((2, 0), dtype=np.int64),
    place_m=np.zeros((2, 0, 2)),
    covariance=np.zeros((2, 0, 2, 2)),
    altitude_m=np.zeros(0),
    state=np.zeros((0, 4)),
    state_covariance=np.zeros((0, 4, 4)),
    existence=np.zeros(0),
    hits=np.zeros(0, dtype=np.int64),
    used_t_ns=np.zeros(0, dtype=np.int64),
    features=np.zeros((0, 0)),
)


class Rules(NamedTuple):
    """How logs are kept and made tracks.

    Attributes:
        source: what it declares; learned: what is known of how well it tells features.
        dictionary: of the features of the run.
    """

    logs: LogSettings = LogSettings()
    tracking: TrackingSettings = TrackingSettings()
    source: SourceProperties = SourceProperties()
    dictionary: Dictionary = Dictionary()
    learned: Learned = NOTHING_LEARNED


def with_report(
    logs: SourceLogs, report: SourceReport, places: Places, way_m: Array, rules: Rules
) -> tuple[SourceLogs, Absorbed]:
    """Put the logs of a report before those already known of the same targets.

    Args:
        places: of the report's logs, relative to its carrier.
        way_m: (n, 2) dead-reckoned way of the carrier at each log.
    """
    settings = rules.logs
    fresh = read(report, places, way_m, settings)
    seen_m = np.concatenate([places.east_north_m, np.zeros((1, 2))])
    now = sensing(rules.source, seen_m, rules.tracking)
    twice = {name for name, count in Counter(fresh.key).items() if name and count > 1}
    fresh = _with_nameless(logs, fresh, now)
    single = np.array([name not in twice for name in fresh.key], dtype=np.bool_)
    known = {name: i for i, name in enumerate(logs.key)}
    previous = np.array([known.get(name, -1) for name in fresh.key], dtype=np.int64)
    newer = fresh.t_ns > np.append(logs.t_ns[0], -1)[previous]
    used = np.flatnonzero(fresh.usable & single & newer)
    leapt = used[_has_leapt(logs, fresh, used, previous[used], settings)]
    previous[leapt] = -1

    taken = {fresh.key[i] for i in used} | twice
    kept = _still_of_use(logs, report, taken, settings)
    existence = unseen(
        logs, kept, way_m.mean(axis=0) if len(way_m) else np.zeros(2), report.swept, now
    )
    lives = existence > rules.tracking.give_up
    before = _without_gaps(logs, fresh, used, previous[used], settings)
    rows = _Rows(used, before, kept[lives], existence[lives])
    filters = _filters(logs, fresh, rows, now, rules)
    features = _features(logs, report, rows, rules)
    return _merged(logs, fresh, rows, filters, features, rules), Absorbed(
        logs=len(report),
        sigma_defaults=int(places.defaulted.sum()),
        without_sigma=int((places.located & ~places.usable).sum()),
        increments=int((fresh.is_increment & ~places.usable).sum()),
        superseded=int((fresh.usable & ~newer).sum()),
        astray=int(fresh.astray.sum()),
        claimed_twice=tuple(sorted(name.partition("/")[2] for name in twice)),
        recycled=tuple(sorted(fresh.key[i].partition("/")[2] for i in leapt)),
    )


def _with_nameless(logs: SourceLogs, fresh: Fresh, now: Sensing) -> Fresh:
    """The logs with names for those that have none."""
    nameless = np.array([not key for key in fresh.key], dtype=np.bool_)
    which = np.flatnonzero(nameless & fresh.usable)
    if not which.size:
        return fresh._replace(born=logs.born)
    names, born = named(logs, fresh.plots, which, now)
    key, track = list(fresh.key), list(fresh.track)
    for i, name in zip(which, names, strict=True):
        key[i] = track[i] = name
    return fresh._replace(key=key, track=track, born=born)


@np.errstate(all="ignore")  # numbers from the wire may be anything within its bounds
def _has_leapt(
    logs: SourceLogs,
    fresh: Fresh,
    used: NDArray[np.intp],
    previous: NDArray[np.int64],
    settings: LogSettings,
) -> NDArray[np.bool_]:
    """(m,) whether a name stands for another target now: nothing moves so far in that time."""
    if not len(logs.key):
        return np.zeros(len(used), dtype=np.bool_)
    gap_s = (fresh.t_ns[used] - logs.t_ns[0, previous]) * NS
    moved_m = np.hypot(*(fresh.place_m[used] - logs.place_m[0, previous]).T)
    variance = np.trace(fresh.covariance[used] + logs.covariance[0, previous], axis1=1, axis2=2)
    reach_m = settings.max_speed_mps * gap_s + LEAP_SIGMAS * np.sqrt(variance)
    leapt: NDArray[np.bool_] = (previous >= 0) & (moved_m > reach_m)
    return leapt


def _still_of_use(
    logs: SourceLogs, report: SourceReport, taken: set[str], settings: LogSettings
) -> NDArray[np.int64]:
    """Targets a report says nothing of but that are young enough to be carried on."""
    young = (report.t_ns - logs.t_ns[0]) * NS <= settings.max_age_s
    of_use = [i for i, name in enumerate(logs.key) if young[i] and name not in taken]
    return np.array(of_use, dtype=np.int64)


class _Rows(NamedTuple):
    """Which logs stand in the next memory of a source.

    Attributes:
        used: (k,) rows of the fresh logs.
        previous: (k,) row of the target each goes on from, -1 where it begins anew.
        kept: (m,) rows of other targets that stay, with the probability of their `existence`.
    """

    used: NDArray[np.intp]
    previous: NDArray[np.int64]
    kept: NDArray[np.int64]
    existence: Array


def _without_gaps(
    logs: SourceLogs,
    fresh: Fresh,
    used: NDArray[np.intp],
    previous: NDArray[np.int64],
    settings: LogSettings,
) -> NDArray[np.int64]:
    """(k,) previous rows, -1 where the gap is too long for a straight line over it."""
    gap_s = (fresh.t_ns[used] - np.append(logs.t_ns[0], 0)[previous]) * NS
    return np.where((previous >= 0) & (gap_s <= settings.max_age_s), previous, -1)


def _filters(logs: SourceLogs, fresh: Fresh, rows: _Rows, now: Sensing, rules: Rules) -> Filters:
    """The filters of the targets of the used logs."""
    nameless = np.array([fresh.key[i][0] == NAMELESS for i in rows.used], dtype=np.bool_)
    plots, settings = fresh.plots.take(rows.used), (rules.logs, rules.tracking)
    return filtered(logs, plots, rows.previous, nameless, now, settings)


def _features(logs: SourceLogs, report: SourceReport, rows: _Rows, rules: Rules) -> Array:
    """(k + m, columns) what is known of the features of the used and of the kept targets."""
    said = heard(report, np.arange(len(report)), rules.source, rules.dictionary, rules.learned)
    known = refitted(logs.features, logs.dictionary, rules.dictionary)
    improved = after_logs(known, rows.previous, rows.used, said, rules.dictionary)
    return np.concatenate([improved, known[rows.kept]])


class _Pairs(NamedTuple):
    """The used logs (0), and what was known before of their targets (1)."""

    t_ns: NDArray[np.int64]
    place_m: Array
    covariance: Array


def _paired(logs: SourceLogs, fresh: Fresh, rows: _Rows) -> _Pairs:
    """Each used log before its previous one; an instant of -1 where there is none."""
    used, n = rows.used, len(rows.used)
    known = np.flatnonzero(rows.previous >= 0)
    pairs = _Pairs(
        np.stack([fresh.t_ns[used], np.full(n, -1)]),
        np.stack([fresh.place_m[used], np.zeros((n, 2))]),
        np.stack([fresh.covariance[used], np.zeros((n, 2, 2))]),
    )
    old = rows.previous[known]
    pairs.t_ns[1, known] = logs.t_ns[0, old]
    pairs.place_m[1, known] = logs.place_m[0, old]
    pairs.covariance[1, known] = logs.covariance[0, old]
    return pairs


def _merged(
    logs: SourceLogs, fresh: Fresh, rows: _Rows, filters: Filters, features: Array, rules: Rules
) -> SourceLogs:
    """The used fresh logs, each before its previous one, and after them the kept targets."""
    used, previous, kept, existence = rows
    pairs, served = _paired(logs, fresh, rows), np.append(logs.used_t_ns, -1)[previous]
    most = rules.logs.max_per_source
    return SourceLogs(
        report_seq=fresh.seq,
        report_t_ns=max(logs.report_t_ns, fresh.stamp_ns),
        born=fresh.born,
        key=_joined(fresh.key, used, logs.key, kept)[:most],
        identity=_joined(fresh.identity, used, logs.identity, kept)[:most],
        track=_joined(fresh.track, used, logs.track, kept)[:most],
        seq=np.concatenate([np.full(len(used), fresh.seq), logs.seq[kept]])[:most],
        index=np.concatenate([used, logs.index[kept]])[:most],
        t_ns=np.concatenate([pairs.t_ns, logs.t_ns[:, kept]], axis=1)[:, :most],
        place_m=np.concatenate([pairs.place_m, logs.place_m[:, kept]], axis=1)[:, :most],
        covariance=np.concatenate([pairs.covariance, logs.covariance[:, kept]], axis=1)[:, :most],
        altitude_m=np.concatenate([fresh.altitude_m[used], logs.altitude_m[kept]])[:most],
        state=np.concatenate([filters.state, logs.state[kept]])[:most],
        state_covariance=np.concatenate([filters.covariance, logs.state_covariance[kept]])[:most],
        existence=np.concatenate([filters.existence, existence])[:most],
        hits=np.concatenate([filters.hits, logs.hits[kept]])[:most],
        used_t_ns=np.concatenate([served, logs.used_t_ns[kept]])[:most],
        features=features[:most],
        dictionary=rules.dictionary,
    )


def _joined(
    fresh: Sequence[str], used: NDArray[np.intp], old: Sequence[str], kept: NDArray[np.int64]
) -> tuple[str, ...]:
    return (*(fresh[i] for i in used), *(old[i] for i in kept))
