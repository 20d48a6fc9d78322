"""Tracks of one source in its own frame: who the nameless plots belong to, and the filters.

The pure parts are in `estimation.tracking`; here they meet the columns of `SourceLogs`. Places are
relative to the carrier plus its dead-reckoned way, so that in them a target moves as over ground.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.frames import polar_from_east_north
from estimation.tracking.bank import (
    Bank,
    Innovations,
    begun,
    carried,
    improved,
    innovations_of,
    normalised,
)
from estimation.tracking.existence import SUREST, missed, seen
from estimation.tracking.source_tracks import (
    Sensing,
    assigned,
    log_ratio,
)
from schemas.messages import Sector, SourceProperties

from ..navigation import NS
from ..settings import LogSettings, TrackingSettings
from ..state import SourceLogs

NAMELESS = "#"
"""Keys of tracks of nameless plots begin so; no source can give such a key."""
GROSS = 30.0
"""Chi2 of 2 dof beyond which a plot is no measurement of its track."""
LEAST_REACH_M = 1000.0
DETECTION = (0.1, 0.95)
"""No source misses or sees a target always, whatever it declares."""


class Plots(NamedTuple):
    """Logs of one report that can be used, k of them.

    Attributes:
        t_ns: (k,).
        place_m: (k, 2), covariance: (k, 2, 2).
    """

    t_ns: NDArray[np.int64]
    place_m: Array
    covariance: Array

    def take(self, which: NDArray[np.intp]) -> Plots:
        """Some of them."""
        return Plots(self.t_ns[which], self.place_m[which], self.covariance[which])


class Filters(NamedTuple):
    """The filter columns of k logs: what is known of their targets once they are taken in."""

    state: Array
    covariance: Array
    existence: Array
    hits: NDArray[np.int64]


def sensing(properties: SourceProperties, places_m: Array, settings: TrackingSettings) -> Sensing:
    """What is assumed of a source, from what it declares.

    Args:
        places_m: (n, 2) of its plots and targets from the carrier: they show how far it sees where
            it does not say.
    """
    seen_m = float(np.nanmax(np.hypot(*places_m.T), initial=LEAST_REACH_M))
    reach_m = min(properties.range_max_m, seen_m) or LEAST_REACH_M
    false = properties.clutter_per_scan + settings.clutter_per_scan
    return Sensing(
        process_noise=settings.process_noise_m2ps3,
        gate=settings.gate,
        detection=float(np.clip(properties.detection_probability, *DETECTION)),
        clutter_density=false / (np.pi * reach_m**2),
    )


@np.errstate(all="ignore")  # numbers from the wire may be anything within its bounds
def named(
    logs: SourceLogs, plots: Plots, which: NDArray[np.intp], now: Sensing
) -> tuple[list[str], int]:
    """Keys of the nameless plots `which`, and how many tracks there have been by then.

    A plot that no nameless track expects begins one.
    """
    free = np.array([i for i, key in enumerate(logs.key) if key[0] == NAMELESS], dtype=np.intp)
    keys = [""] * len(which)
    if free.size and len(which):
        mine = plots.take(which)
        bank = Bank(logs.state[free], logs.state_covariance[free])
        elapsed = (mine.t_ns - logs.t_ns[0, free][:, None]) * NS
        found = innovations_of(bank, elapsed, now.process_noise, mine.place_m, mine.covariance)
        for track, plot in zip(*assigned(found, now.gate), strict=True):
            keys[plot] = logs.key[free[track]]
    born = logs.born
    for i, key in enumerate(keys):
        if not key:
            keys[i], born = f"{NAMELESS}{born}", born + 1
    return keys, born


@np.errstate(all="ignore")
def filtered(
    logs: SourceLogs,
    plots: Plots,
    previous: NDArray[np.int64],
    nameless: NDArray[np.bool_],
    now: Sensing,
    settings: tuple[LogSettings, TrackingSettings],
) -> Filters:
    """The filters of k logs with these plots taken in.

    A plot under a name that lies far from where its track expects it is a gross error, and left
    out; when the next one does as well the track begins anew.

    Args:
        previous: (k,) row of each log's target in `logs`, -1 where there is none to go on from.
    """
    log_settings, tracking = settings
    # whoever has a name need not be found again by where it could have moved to
    unknown_mps = log_settings.max_speed_mps / 3
    fresh = begun(
        plots.place_m,
        plots.covariance,
        np.where(nameless, log_settings.sigma_velocity_mps, unknown_mps),
    )
    existence = np.where(nameless, tracking.birth, SUREST)
    hits = np.ones(len(previous), dtype=np.int64)
    old = np.flatnonzero(previous >= 0)
    if not old.size:
        return Filters(fresh.state, fresh.covariance, existence, hits)
    rows, mine = previous[old], plots.take(old)
    before = Bank(logs.state[rows], logs.state_covariance[rows])
    elapsed = (mine.t_ns - logs.t_ns[0, rows]) * NS
    expected = carried(before, elapsed, now.process_noise)
    after = improved(expected, mine.place_m, mine.covariance)
    before_hits, surprise = logs.hits[rows], _surprise(expected, mine)
    astray = surprise.distance2 > GROSS  # nameless plots are within their gate
    after = _where(astray & (before_hits > 1), expected, after)
    restart = astray & (before_hits == 1) | ~np.isfinite(after.covariance).all(axis=(1, 2))
    after = _where(restart, fresh.take(old), after)
    fresh.state[old], fresh.covariance[old] = after.state, after.covariance
    hits[old] = np.where(astray, 1, before_hits + 1)
    odds = seen(logs.existence[rows], log_ratio(surprise, now), now.detection)
    likely = np.nan_to_num(odds, nan=SUREST)
    existence[old] = np.where(nameless[old], likely, existence[old])
    return Filters(fresh.state, fresh.covariance, existence, hits)


def _surprise(expected: Bank, plots: Plots) -> Innovations:
    """How far each plot lies from where its own track expects it."""
    spread = expected.covariance[:, :2, :2] + plots.covariance
    return Innovations(*normalised(plots.place_m - expected.state[:, :2], spread))


def _where(which: NDArray[np.bool_], one: Bank, other: Bank) -> Bank:
    return Bank(
        np.where(which[:, None], one.state, other.state),
        np.where(which[:, None, None], one.covariance, other.covariance),
    )


def unseen(
    logs: SourceLogs, kept: NDArray[np.int64], way_m: Array, swept: Sector | None, now: Sensing
) -> Array:
    """Existence (k,) of the kept targets of which a report says nothing; names are believed."""
    existence = logs.existence[kept]
    nameless = np.array([logs.key[i][0] == NAMELESS for i in kept], dtype=np.bool_)
    looked = np.ones(len(kept), dtype=np.bool_)
    if swept is not None:
        bearing, _ = polar_from_east_north(logs.place_m[0, kept] - way_m)
        looked = np.mod(bearing - swept.start_rad, 2 * np.pi) <= swept.width_rad
    after = np.where(nameless & looked, missed(existence, now.detection), existence)
    return np.asarray(after)
