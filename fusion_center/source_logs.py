"""The last two logs of every target of a source, report by report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from schemas.messages import SourceReport

from .coordinates import Places
from .navigation import NS
from .settings import LogSettings
from .state import SourceLogs

LEAP_SIGMAS = 6.0


class Absorbed(NamedTuple):
    """What became of the logs of one report.

    Attributes:
        logs: how many there were.
        sigma_defaults: brought no sigma of their own.
        without_sigma: have a position, but neither they nor their source a sigma: not used.
        increments: of a kind that is not a position: not used.
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
    key=(),
    identity=(),
    track=(),
    seq=np.zeros(0, dtype=np.int64),
    index=np.zeros(0, dtype=np.int64),
    t_ns=np.zeros((2, 0), dtype=np.int64),
    place_m=np.zeros((2, 0, 2)),
    covariance=np.zeros((2, 0, 2, 2)),
    altitude_m=np.zeros(0),
)


def with_report(
    logs: SourceLogs, report: SourceReport, places: Places, way_m: Array, settings: LogSettings
) -> tuple[SourceLogs, Absorbed]:
    """Put the logs of a report before those already known of the same targets.

    Args:
        places: of the report's logs, relative to its carrier.
        way_m: (n, 2) dead-reckoned way of the carrier at each log.
    """
    fresh = _read(report, places, way_m, settings)
    twice = {name for name, count in Counter(fresh.key).items() if name and count > 1}
    single = np.array([name not in twice for name in fresh.key], dtype=np.bool_)
    known = {name: i for i, name in enumerate(logs.key) if name}
    previous = np.array([known.get(name, -1) for name in fresh.key], dtype=np.int64)
    newer = fresh.t_ns > np.append(logs.t_ns[0], -1)[previous]
    used = np.flatnonzero(fresh.usable & single & newer)
    leapt = used[_has_leapt(logs, fresh, used, previous[used], settings)]
    previous[leapt] = -1

    taken = {fresh.key[i] for i in used} | twice
    kept = _still_of_use(logs, report, taken, settings)
    merged = _merged(logs, fresh, used, previous[used], kept, settings)
    return merged, Absorbed(
        logs=len(report),
        sigma_defaults=int(places.defaulted.sum()),
        without_sigma=int((places.located & ~places.usable).sum()),
        increments=len(report) - int(fresh.positions.sum()),
        superseded=int((fresh.usable & ~newer).sum()),
        astray=int(fresh.astray.sum()),
        claimed_twice=tuple(sorted(name.partition("/")[2] for name in twice)),
        recycled=tuple(sorted(fresh.key[i].partition("/")[2] for i in leapt)),
    )


@np.errstate(all="ignore")  # numbers from the wire may be anything within its bounds
def _has_leapt(
    logs: SourceLogs,
    fresh: _Fresh,
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


class _Fresh(NamedTuple):
    """The logs of a report in the terms of `SourceLogs`."""

    seq: int
    key: list[str]
    identity: list[str]
    track: list[str]
    positions: NDArray[np.bool_]
    astray: NDArray[np.bool_]
    usable: NDArray[np.bool_]
    t_ns: NDArray[np.int64]
    place_m: Array
    covariance: Array
    altitude_m: Array


def _read(report: SourceReport, places: Places, way_m: Array, settings: LogSettings) -> _Fresh:
    """Names, instants and places of a report's logs; an unsure instant makes the place unsure."""
    n = len(report)
    identity, track = _identities(report, n), _texts(report.track_id, n)
    key = [f"i/{i}" if i else f"t/{t}" if t else "" for i, t in zip(identity, track, strict=True)]
    kinds = _texts(report.kind, n)
    positions = np.array([kind != "increment" for kind in kinds], dtype=np.bool_)
    covariance = places.covariance
    if report.sigma_time_offset_s is not None:
        sigma_s = np.nan_to_num(np.array(report.sigma_time_offset_s, dtype=np.float64))
        covariance = covariance + round_covariance((settings.sigma_velocity_mps * sigma_s) ** 2)
    t_ns = instants_ns(report)
    astray = np.abs(t_ns - report.t_ns) * NS > settings.max_age_s
    return _Fresh(
        seq=report.seq,
        key=key,
        identity=identity,
        track=track,
        positions=positions,
        astray=astray,
        usable=places.usable & positions & ~astray,
        t_ns=t_ns,
        place_m=places.east_north_m + way_m,
        covariance=covariance,
        altitude_m=places.altitude_m,
    )


def instants_ns(report: SourceReport) -> NDArray[np.int64]:
    """When each log of a report was measured (n,)."""
    n = len(report)
    if report.time_offset_s is None:
        return np.full(n, report.t_ns, dtype=np.int64)
    offset_s: Array = np.nan_to_num(np.array(report.time_offset_s, dtype=np.float64))
    return report.t_ns + np.rint(offset_s / NS).astype(np.int64)


def _still_of_use(
    logs: SourceLogs, report: SourceReport, taken: set[str], settings: LogSettings
) -> NDArray[np.int64]:
    """Targets a report says nothing of but that are young enough to be carried on.

    A plot without a name cannot be followed: the next report over the whole field replaces it.
    """
    young = (report.t_ns - logs.t_ns[0]) * NS <= settings.max_age_s
    nameless = report.swept is not None
    of_use = [
        i
        for i, name in enumerate(logs.key)
        if young[i] and (name not in taken if name else nameless)
    ]
    return np.array(of_use, dtype=np.int64)


def _merged(
    logs: SourceLogs,
    fresh: _Fresh,
    used: NDArray[np.intp],
    previous: NDArray[np.int64],
    kept: NDArray[np.int64],
    settings: LogSettings,
) -> SourceLogs:
    """The used fresh logs, each before its previous one, and after them the kept targets."""
    known = np.flatnonzero(previous >= 0)
    gap_s = (fresh.t_ns[used[known]] - logs.t_ns[0, previous[known]]) * NS
    known = known[gap_s <= settings.max_age_s]  # no straight line over a longer gap
    t_ns = np.stack([fresh.t_ns[used], np.full(len(used), -1)])
    place = np.stack([fresh.place_m[used], np.zeros((len(used), 2))])
    covariance = np.stack([fresh.covariance[used], np.zeros((len(used), 2, 2))])
    t_ns[1, known] = logs.t_ns[0, previous[known]]
    place[1, known] = logs.place_m[0, previous[known]]
    covariance[1, known] = logs.covariance[0, previous[known]]

    most = settings.max_per_source
    return SourceLogs(
        report_seq=fresh.seq,
        key=_joined(fresh.key, used, logs.key, kept)[:most],
        identity=_joined(fresh.identity, used, logs.identity, kept)[:most],
        track=_joined(fresh.track, used, logs.track, kept)[:most],
        seq=np.concatenate([np.full(len(used), fresh.seq), logs.seq[kept]])[:most],
        index=np.concatenate([used, logs.index[kept]])[:most],
        t_ns=np.concatenate([t_ns, logs.t_ns[:, kept]], axis=1)[:, :most],
        place_m=np.concatenate([place, logs.place_m[:, kept]], axis=1)[:, :most],
        covariance=np.concatenate([covariance, logs.covariance[:, kept]], axis=1)[:, :most],
        altitude_m=np.concatenate([fresh.altitude_m[used], logs.altitude_m[kept]])[:most],
    )


def _identities(report: SourceReport, n: int) -> list[str]:
    names, kinds = _texts(report.identity, n), _texts(report.identity_kind, n)
    return [f"{kind}/{name}" if name else "" for name, kind in zip(names, kinds, strict=True)]


def _texts(values: Sequence[str | None] | None, n: int) -> list[str]:
    return [""] * n if values is None else [value or "" for value in values]


def _joined(
    fresh: Sequence[str], used: NDArray[np.intp], old: Sequence[str], kept: NDArray[np.int64]
) -> tuple[str, ...]:
    return (*(fresh[i] for i in used), *(old[i] for i in kept))


def round_covariance(variance: Array) -> Array:
    """Covariances (n, 2, 2) of equal variance (n,) [m^2] in every direction."""
    return variance[:, None, None] * np.eye(2)
