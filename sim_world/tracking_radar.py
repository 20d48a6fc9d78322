"""A radar that tracks: its plots go through filters of its own, and it reports what they hold.

The filters live in the carrier's believed axes, at places relative to the carrier plus its
dead-reckoned way, so that a target there moves as over ground. A track is reported when a plot has
improved it: then its state is new information, the rest is only a prediction. Plots go to tracks
by nearest first; that this is sometimes wrong is what a real tracker does as well.
"""

from __future__ import annotations

from math import log
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, transposed
from estimation.frames import Site, east_north_covariance, level_plane
from estimation.tracking.bank import EMPTY, Bank, begun, carried, improved, innovations_of
from estimation.tracking.existence import missed, seen
from schemas.messages import SourceProperties

from .logs import Logs

GATE = 16.0
BORN, CONFIRMED, GIVEN_UP = 0.5, 0.95, 0.02
SEA_LEVEL_M = 0.0
LEAST_CLUTTER = 0.01
"""False plots assumed of a radar that declares none: a target that vanished must be given up."""


class Observation(NamedTuple):
    """From where and when a look was taken.

    Attributes:
        t_ns: of the look, by the radar's own clock.
        way_m: (2,) what the carrier has reckoned by then.
        site: the carrier's reported position.
    """

    t_ns: int
    way_m: Array
    site: Site


class TrackReport(NamedTuple):
    """The n tracks that a look has improved.

    Attributes:
        row: (n,) the log that did.
        number: (n,) of the tracks, each given once in a life.
        state: (n, 4) east, north from the carrier [m] and their rates over ground [m/s].
        covariance: (n, 4, 4).
        before_ns: (n,) when each was last reported; 0 = never.
        vector, information: (n, 4) and (n, 4, 4) what was learnt since then.
    """

    row: np.ndarray
    number: np.ndarray
    state: Array
    covariance: Array
    before_ns: np.ndarray
    vector: Array
    information: Array


class _Tracks(NamedTuple):
    """All tracks there are: filters at `t_ns`, and as they were when last reported."""

    number: np.ndarray
    t_ns: np.ndarray
    filters: Bank
    existence: Array
    confirmed: np.ndarray
    told_ns: np.ndarray
    told: Bank

    def take(self, which: np.ndarray) -> _Tracks:
        """Some of them."""
        return _Tracks(
            self.number[which],
            self.t_ns[which],
            self.filters.take(which),
            self.existence[which],
            self.confirmed[which],
            self.told_ns[which],
            self.told.take(which),
        )

    def joined(self, more: _Tracks) -> _Tracks:
        """These and then others."""
        return _Tracks(
            np.concatenate([self.number, more.number]),
            np.concatenate([self.t_ns, more.t_ns]),
            self.filters.joined(more.filters),
            np.concatenate([self.existence, more.existence]),
            np.concatenate([self.confirmed, more.confirmed]),
            np.concatenate([self.told_ns, more.told_ns]),
            self.told.joined(more.told),
        )


_NONE = _Tracks(
    np.zeros(0, dtype=np.int64),
    np.zeros(0, dtype=np.int64),
    EMPTY,
    np.zeros(0),
    np.zeros(0, dtype=bool),
    np.zeros(0, dtype=np.int64),
    EMPTY,
)


class RadarTracker:
    """The tracks of one radar in one life of its carrier.

    Args:
        radar: what it declares of its plots.
        process_noise: q of the targets' velocities that its filters assume [m^2/s^3].
        sigma_velocity_mps: of a new target's velocity about zero, per axis, as they assume it.
    """

    def __init__(
        self, radar: SourceProperties, process_noise: float, sigma_velocity_mps: float
    ) -> None:
        self._radar, self._noise, self._sigma_mps = radar, process_noise, sigma_velocity_mps
        self._tracks, self._born = _NONE, 0
        area_m2 = np.pi * min(radar.range_max_m, 1e6) ** 2
        self._density = max(radar.clutter_per_scan, LEAST_CLUTTER) / area_m2

    def update(self, logs: Logs, seen_from: Observation) -> TrackReport:
        """Take in the plots of one look; what is to be reported of it."""
        place, covariance = _places(logs, self._radar, seen_from)
        at_ns = seen_from.t_ns + _offsets_ns(logs)
        track, plot = self._matched(place, covariance, at_ns)
        self._improve(track, place[plot], covariance[plot], at_ns[plot])
        new = np.setdiff1d(np.arange(len(place)), plot)
        report = self._report(track, plot, seen_from.way_m)
        self._begin(place[new], covariance[new], at_ns[new])
        self._tracks = self._tracks.take(self._tracks.existence > GIVEN_UP)
        return report

    def _matched(
        self, place: Array, covariance: Array, at_ns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """One plot to one track, nearest first."""
        tracks = self._tracks
        elapsed = (at_ns - tracks.t_ns[:, None]) * 1e-9
        found = innovations_of(tracks.filters, elapsed, self._noise, place, covariance)
        cost = np.where(found.distance2 < GATE, found.distance2 + found.log_determinant, np.inf)
        pairs: list[tuple[int, int]] = []
        while cost.size and np.isfinite(cost.min()):
            track, plot = np.unravel_index(int(cost.argmin()), cost.shape)
            pairs.append((int(track), int(plot)))
            cost[track], cost[:, plot] = np.inf, np.inf
        chosen = np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)
        return chosen[:, 0], chosen[:, 1]

    def _improve(
        self, track: np.ndarray, place: Array, covariance: Array, at_ns: np.ndarray
    ) -> None:
        """Matched tracks take in their plots, the others have been missed."""
        tracks, radar = self._tracks, self._radar
        elapsed = (at_ns - tracks.t_ns[track]) * 1e-9
        found = innovations_of(
            tracks.filters.take(track), np.diag(elapsed), self._noise, place, covariance
        )
        likelihood = np.diag(found.log_likelihood) + np.log(
            radar.detection_probability / self._density
        )
        existence = missed(tracks.existence, min(radar.detection_probability, 0.999))
        existence[track] = seen(tracks.existence[track], likelihood, radar.detection_probability)
        after = improved(
            carried(tracks.filters.take(track), elapsed, self._noise), place, covariance
        )
        filters = Bank(tracks.filters.state.copy(), tracks.filters.covariance.copy())
        filters.state[track], filters.covariance[track] = after
        t_ns = tracks.t_ns.copy()
        t_ns[track] = at_ns
        confirmed = tracks.confirmed | (existence > CONFIRMED)
        self._tracks = tracks._replace(
            filters=filters, t_ns=t_ns, existence=existence, confirmed=confirmed
        )

    def _report(self, track: np.ndarray, plot: np.ndarray, way_m: Array) -> TrackReport:
        """The confirmed among the improved tracks, relative to the carrier again."""
        tracks = self._tracks
        told = tracks.confirmed[track]
        track, plot = track[told], plot[told]
        chosen = tracks.take(track)
        there = np.zeros(4)
        there[:2] = way_m
        gained, information = self._gained(chosen)
        self._remember(track, chosen)
        return TrackReport(
            row=plot,
            number=chosen.number,
            state=chosen.filters.state - there,
            covariance=chosen.filters.covariance,
            before_ns=chosen.told_ns,
            vector=gained - information @ there,
            information=information,
        )

    def _gained(self, chosen: _Tracks) -> tuple[Array, Array]:
        """Information (n, 4), (n, 4, 4) beyond what was last told, carried on to now."""
        information = np.linalg.inv(chosen.filters.covariance)
        vector = (information @ chosen.filters.state[..., None])[..., 0]
        elapsed = (chosen.t_ns - chosen.told_ns) * 1e-9
        known = carried(chosen.told, np.where(chosen.told_ns > 0, elapsed, 0.0), self._noise)
        before = np.linalg.inv(known.covariance)
        before[chosen.told_ns == 0] = 0.0
        gained = information - before
        return vector - (before @ known.state[..., None])[..., 0], (gained + transposed(gained)) / 2

    def _remember(self, track: np.ndarray, chosen: _Tracks) -> None:
        told = Bank(self._tracks.told.state.copy(), self._tracks.told.covariance.copy())
        told.state[track], told.covariance[track] = chosen.filters
        told_ns = self._tracks.told_ns.copy()
        told_ns[track] = chosen.t_ns
        self._tracks = self._tracks._replace(told=told, told_ns=told_ns)

    def _begin(self, place: Array, covariance: Array, at_ns: np.ndarray) -> None:
        """A track of every plot that belongs to none."""
        count = len(place)
        fresh = begun(place, covariance, self._sigma_mps)
        number = np.arange(self._born + 1, self._born + count + 1)
        self._born += count
        unsaid = np.zeros(count, dtype=np.int64)
        more = _Tracks(
            number, at_ns, fresh, np.full(count, BORN), np.zeros(count, dtype=bool), unsaid, fresh
        )
        self._tracks = self._tracks.joined(more)


_SIGMA_MPS = 30.0  # where the memory is looked for: it does not depend on where one begins


def memory_s(radar: SourceProperties, process_noise: float) -> float:
    """Time in which a track of the radar forgets an error to 1/e, where its plots are worst."""
    sigma = max(radar.sigma_range_m or 0.0, (radar.sigma_bearing_rad or 0.0) * _far_m(radar))
    plot = np.eye(2)[None] * sigma**2
    state = begun(np.zeros((1, 2)), plot, _SIGMA_MPS)
    period = radar.period_s
    for _ in range(200):
        before = carried(state, period, process_noise)
        state = improved(before, np.zeros((1, 2)), plot)
    forward = np.eye(4) + period * np.eye(4, k=2)
    kept = state.covariance[0] @ np.linalg.inv(before.covariance[0]) @ forward
    left = float(np.abs(np.linalg.eigvals(kept)).max())
    return period / -log(min(max(left, 1e-9), 1 - 1e-9))


def _far_m(radar: SourceProperties) -> float:
    return min(radar.range_max_m, 50_000.0)


def _places(logs: Logs, radar: SourceProperties, seen_from: Observation) -> tuple[Array, Array]:
    """Places (m, 2) plus the carrier's way, and their covariances, of the plots of a look."""
    slant = np.zeros(0) if logs.range_m is None else logs.range_m
    if logs.elevation_rad is None:
        here = seen_from.site
        level = level_plane(here, here, logs.bearing_rad, slant, SEA_LEVEL_M)
    else:
        along = np.stack([np.sin(logs.bearing_rad), np.cos(logs.bearing_rad)], axis=1)
        level = (slant * np.cos(logs.elevation_rad))[:, None] * along
    sigmas = (radar.sigma_bearing_rad or 1.0, radar.sigma_range_m or 1.0)
    return level + seen_from.way_m, east_north_covariance(logs.bearing_rad, slant, *sigmas)


def _offsets_ns(logs: Logs) -> np.ndarray:
    if logs.time_offset_s is None:
        return np.zeros(len(logs.bearing_rad), dtype=np.int64)
    offsets: np.ndarray = np.round(logs.time_offset_s * 1e9).astype(np.int64)
    return offsets
