"""What the targets of a report of bearings are called, names or none.

A target that its source names by an identity is called kind/name, the same by all carriers. One
that it only numbers, and one that it does not tell apart at all, are called #source/... and known
to their carrier alone: the bearings of the latter are followed here, look by look. What joins them
with those of other carriers is `pairing`.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.bearings_only import BearingTracks, followed, no_tracks
from schemas.messages import SourceReport

from ..navigation import NS, way_m
from ..sources.coordinates import column
from ..state import Nameless, State

NAMELESS = "#"
"""What has no identity is called so at first; no source can be called so."""
AGREED = 3
"""Attempts in a row that must find a pair before it counts."""
_OPEN = -1


def is_nameless(target: str) -> bool:
    """Whether only its own carrier calls a target so."""
    return target.startswith(NAMELESS)


def names(state: State, report: SourceReport) -> list[str]:
    """What the target of each row is called at its carrier; empty where that is open."""
    rows = _rows(state, report)
    return [_name(report, i, rows[i]) for i in range(len(report))]


def _name(report: SourceReport, i: int, row: int) -> str:
    identity = report.identity[i] if report.identity else None
    if identity:
        return f"{report.identity_kind[i] if report.identity_kind else ''}/{identity}"
    track = report.track_id[i] if report.track_id else None
    if track and report.range_m is None:
        return f"{NAMELESS}{report.stream}/track {track}"
    return f"{NAMELESS}{report.stream}/bearing {row}" if row != _OPEN else ""


def _rows(state: State, report: SourceReport) -> list[int]:
    known = state.nameless.get(_key(report))
    if known is None or known.seq != report.seq or len(known.rows) != len(report):
        return [_OPEN] * len(report)
    rows: list[int] = known.rows.tolist()
    return rows


def with_nameless(state: State, report: SourceReport) -> State:
    """The state with the nameless bearings of one report of a passive source followed."""
    carrier, n = state.carriers[report.carrier], len(report)
    bearing, sigma = bearings_of(state, report)
    nameless = np.array([not _name(report, i, _OPEN) for i in range(n)], dtype=np.bool_)
    which = np.flatnonzero(nameless & np.isfinite(bearing + sigma) & (sigma > 0))
    before = state.nameless.get(_key(report))
    if report.range_m is not None or not carrier.navigation or not (len(which) or before):
        return state
    if before is not None and before.boot == carrier.boot and report.t_ns <= before.t_ns:
        return state
    way = way_m(carrier.navigation, report.t_ns)
    with np.errstate(all="ignore"):  # numbers from the wire may be anything in bounds
        tracks, elapsed_s, moved_m = _since(before, carrier.boot, report.t_ns, way)
        tracks, number = followed(tracks, elapsed_s, moved_m, bearing[which], sigma[which])
    rows = np.full(n, _OPEN, dtype=np.int64)
    rows[which] = number
    now = Nameless(
        boot=carrier.boot, seq=report.seq, t_ns=report.t_ns, way_m=way, tracks=tracks, rows=rows
    )
    return replace(state, nameless={**state.nameless, _key(report): now})


def _since(
    before: Nameless | None, boot: int, t_ns: int, way: Array
) -> tuple[BearingTracks, float, Array]:
    """Tracks of the last look, time and way since then; another life of a carrier has none."""
    if before is None or before.boot != boot:
        return no_tracks(before.tracks.born if before else 0), 0.0, np.zeros(2)
    return before.tracks, (t_ns - before.t_ns) * NS, way - before.way_m


def bearings_of(state: State, report: SourceReport) -> tuple[Array, Array]:
    """Bearings (n,) from the carrier's own north and their sigmas, nan where there is none."""
    n, properties = len(report), state.sources(report.carrier).get(report.stream)
    default = properties.sigma_bearing_rad if properties else None
    stated = column(report.sigma_bearing_rad, n)
    sigma = np.where(np.isnan(stated), default or np.nan, stated)
    return column(report.bearing_rad, n), sigma


def target_of(state: State, carrier: str, target: str) -> str:
    """What a carrier's target is called in common; with the carrier where it is its alone."""
    if carrier == state.own:
        return target
    name = f"{carrier}/{target}"
    paired = state.paired.get(name)
    if paired is not None and paired.agreed >= AGREED:
        return paired.target
    return name if is_nameless(target) else target


def _key(report: SourceReport) -> str:
    return f"{report.carrier}/{report.stream}"
