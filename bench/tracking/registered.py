"""A scene whose carriers do not know where they are: registration first, then the picture.

The own carrier tracks alone; each other carrier's plots are compared with those tracks, at first by
an acquisition (nobody says whose plot is whose), then scan by scan. Its plots join the picture,
with the covariance of its frame as their common error, as soon as it is acquired.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.tracking.ours import scan_of
from bench.tracking.scenes import Scene
from estimation.acquisition import acquire
from estimation.arrays import Array, Indices
from estimation.relative_frame import OwnAxesFrame, PolarLogs, RelativeFramePrior
from estimation.relative_frame.adjustment import updated
from estimation.tracking import bernoulli
from estimation.tracking.imm import combined
from estimation.tracking.innovations import Common
from estimation.tracking.marginals import by_assignment
from estimation.tracking.scan import Scan
from estimation.tracking.tracker import Picture, Settings, nothing, predicted, shown, step

_SIGMA_PLACE_M, _SIGMA_HEADING_RAD = 500.0, np.radians(1.0)
_STARTS_S = 6.0
_NEAREST = 60  # logs compared at first
_SURE = 0.9
_EARLIER = 3.0  # scans over which errors of the own tracks are much the same


class Frame(NamedTuple):
    """Error of a carrier's reported pose: what to add, and its covariance (3, 3)."""

    error: Array
    covariance: Array


def scans(scene: Scene, settings: Settings) -> Iterator[Scan]:
    """The scans of a scene as far as their frames are known, in the picture frame."""
    alone = nothing(settings, 0)
    known: dict[int, Frame | None] = {}
    for k, carrier in enumerate(scene.carrier.tolist()):
        reported = scan_of(scene, k, scene.reported[k])
        if carrier == 0:
            alone, _ = step(alone, reported, settings)
            yield reported
            continue
        now = predicted(alone, reported.t_ns, settings)
        known[carrier] = frame = _compared(known.get(carrier), scene, k, now, settings)
        if frame is not None:
            yield _corrected(scene, k, frame)


def _compared(
    frame: Frame | None, scene: Scene, k: int, own: Picture, settings: Settings
) -> Frame | None:
    """The frame of a scan's carrier after that scan, None as long as it is not known."""
    if frame is not None:
        return _improved(frame, scene, k, own, settings)
    return _acquired(scene, k, own, settings) if scene.t_s[k] >= _STARTS_S else None


def _corrected(scene: Scene, k: int, frame: Frame) -> Scan:
    scan = scan_of(scene, k, scene.reported[k] + frame.error)
    return scan._replace(common=Common(frame.covariance, scan.view.site_m))


def _acquired(scene: Scene, k: int, own: Picture, settings: Settings) -> Frame | None:
    """The frame at the first comparison, if one was found that may be acted upon."""
    tracks, plots = shown(own, settings), scan_of(scene, k, scene.reported[k])
    place = scene.reported[k][:2]
    there = plots.plots.found()
    assert there is not None
    mine = _nearest(tracks.mean[:, :2], place)
    theirs = _nearest(there.place_m.T, place)
    prior = RelativeFramePrior.from_sigmas(
        place, _SIGMA_PLACE_M, _SIGMA_PLACE_M, 0.0, _SIGMA_HEADING_RAD
    )
    own_logs = PolarLogs.from_east_north(tracks.mean[mine, :2], tracks.covariance[mine, :2, :2])
    found = acquire(own_logs, _logs(scene, k).take(theirs), prior)
    if not found.modes or found.modes[0].probability < _SURE:
        return None
    return _frame(found.modes[0].frame, scene.reported[k])


def _improved(frame: Frame, scene: Scene, k: int, own: Picture, settings: Settings) -> Frame:
    """By the plots of one scan that are surely of an own track."""
    scan = _corrected(scene, k, frame)
    tracks = own.tracks.take(np.flatnonzero(own.tracks.existence > _SURE))
    pairs = bernoulli.gated(tracks, scan, settings.gate)
    detection = np.full(len(tracks.identity), scan.detection)
    clutter = np.full(scan.plots.size, 1e-6)
    chosen = by_assignment(bernoulli.candidates(tracks, pairs, detection, clutter)).pair > 0
    mean, covariance = _states(tracks.take(pairs.track[chosen]))
    own_logs = PolarLogs.from_east_north(mean, covariance * _EARLIER)
    before = OwnAxesFrame(
        scene.reported[k, :2] + frame.error[:2], np.asarray(frame.error[2]), frame.covariance
    )
    after = updated(own_logs, _logs(scene, k).take(pairs.plot[chosen]), before)
    return _frame(after.frame, scene.reported[k])


def _states(tracks: bernoulli.Tracks) -> tuple[Array, Array]:
    mean, covariance = combined(tracks.bank)
    return mean[:2].T, np.moveaxis(covariance[:2, :2], -1, 0)


def _logs(scene: Scene, k: int) -> PolarLogs:
    """Plots in the reported axes of their carrier."""
    seen, sensors = scene.seen[k], scene.sensors
    bearing = seen.bearing_rad + scene.reported[k, 2]
    return PolarLogs.from_sigmas(
        bearing, seen.range_m, sensors.sigma_bearing_rad, sensors.sigma_range_m
    )


def _frame(found: OwnAxesFrame, reported: Array) -> Frame:
    return Frame(np.array([*(found.q_m - reported[:2]), float(found.D_rad)]), found.covariance)


def _nearest(place_m: Array, to_m: Array) -> Indices:
    return np.sort(np.argsort(np.hypot(*(place_m - to_m).T))[:_NEAREST])
