"""The alarm of one frame, `estimation.relative_frame.change_detection`, as columns of the state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.relative_frame import Drift, OwnAxesFrame, Travel, Watch, watched, watching
from estimation.relative_frame.change_detection import Scan
from estimation.relative_frame.own_axes_information import OwnAxesInformation

from ..navigation import NS
from ..state import WatchColumns


class Stand(NamedTuple):
    """Where two carriers have come to at a scan.

    Attributes:
        way_m: (2, 2) dead-reckoned, of the own and of the other one.
        drift_mps: (2,) of the other against the own one, as far as known.
    """

    t_ns: int
    way_m: Array
    drift_mps: Array


def after_scan(
    columns: WatchColumns | None,
    expected: OwnAxesFrame,
    said: OwnAxesInformation,
    stand: Stand,
    drift: Callable[[float], Drift],
) -> tuple[WatchColumns, bool]:
    """What is remembered after one more scan, and whether it raised the alarm; see `watched`.

    Args:
        columns: None before the first scan.
        drift: the random walk that is normal, by the time between two scans.
    """
    if columns is None:
        return _columns(watching(said.with_prior(expected)), stand), False
    seconds = (stand.t_ns - columns.t_ns) * NS
    moved = stand.way_m - columns.way_m
    travel = Travel(moved[0] - stand.drift_mps * seconds, moved[1])
    watch = _watch(columns)
    after, alarm = watched(watch, expected, said, seconds, drift(seconds), travel)
    return _columns(after, stand), bool(alarm.raised)


def _watch(columns: WatchColumns) -> Watch:
    scans = tuple(
        Scan(
            float(columns.elapsed_s[k]),
            Travel(columns.own_m[k], columns.other_m[k]),
            OwnAxesInformation(
                columns.point[k],
                columns.matrix[k],
                columns.vector[k],
                columns.chi2[k],
                int(columns.pairs[k]),
            ),
        )
        for k in range(len(columns.elapsed_s))
    )
    before = columns.before
    frame = OwnAxesFrame(before[:2], before[2], columns.before_covariance)
    return Watch(frame, scans, np.array(columns.suspected))


def _columns(watch: Watch, stand: Stand) -> WatchColumns:
    scans = watch.scans
    said = [scan.information for scan in scans]
    return WatchColumns(
        t_ns=stand.t_ns,
        way_m=stand.way_m,
        before=np.append(watch.before.q_m, watch.before.D_rad),
        before_covariance=watch.before.covariance,
        elapsed_s=np.array([scan.elapsed_s for scan in scans]),
        own_m=_rows([scan.travel.own_m for scan in scans], 2),
        other_m=_rows([scan.travel.other_m for scan in scans], 2),
        point=_rows([s.point for s in said], 3),
        matrix=_rows([s.matrix for s in said], 3, 3),
        vector=_rows([s.vector for s in said], 3),
        chi2=np.array([float(s.chi2) for s in said]),
        pairs=np.array([s.pairs for s in said], dtype=np.int64),
        suspected=bool(watch.suspected),
    )


def _rows(values: Sequence[object], *shape: int) -> Array:
    return np.array(values, dtype=float).reshape(len(values), *shape)
