"""Registration by target logs that are tracks: increments, thinned, and naively."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_least, at_most, between, told
from bench.registration.over_time import Truth, error, first, seen
from bench.registration.scenes import SIDE_M
from estimation.arrays import transposed
from estimation.consistency import nees
from estimation.frames import east_north_covariance, east_north_from_polar
from estimation.relative_frame import OwnAxesFrame, PolarLogs, updated
from estimation.relative_frame.matrices import inverse, times
from estimation.relative_frame.tracks import (
    MotionModel,
    TrackLog,
    memory_s,
    plots_of_tracks,
    reuse,
    thinned,
)

INTERVAL_S, SCANS, TARGETS = 4.0, 40, 8
SPEED_MPS, ACCELERATION = 8.0, 0.02  # white, (m/s^2)^2 s


class Scan(NamedTuple):
    """One carrier's tracks (N, L) at one scan, beside the plots they were made of."""

    plots: PolarLogs
    tracks: TrackLog


class Recording(NamedTuple):
    """Runs of a while: both carriers' scans, what is known at first, and the truth."""

    scans: list[tuple[Scan, Scan]]
    before: OwnAxesFrame
    truth: Truth


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The demand on tracks: honest by increments, dishonest and warned of otherwise."""
    given = recorded(np.random.default_rng([seed, 4]), max(runs // 80, 20))
    yield at_most("tracks: equivalent measurements - plots", plot_differences(given), 1e-3, "m")
    memory = memory_of(given)
    yield told("tracks: memory of the filter", memory, "s")
    every = range(1, SCANS)
    for name, logs in (("plots", plots), ("equivalent measurements", equivalents)):
        yield between(f"tracks: NEES/3 by {name}", registered(given, logs, every), 0.9, 1.1)
    chosen = thinned(np.arange(SCANS) * INTERVAL_S, memory)[1:].tolist()
    yield told("tracks: NEES/3 thinned by three memories", registered(given, states, chosen))
    yield at_least("tracks: NEES/3 naively reused", registered(given, states, every), 3)
    warned = float(bool(reuse(INTERVAL_S, memory).warning))
    yield at_least("tracks: naive reuse raises a warning", warned, 1)


def model() -> MotionModel:
    """Nearly constant velocity over one interval."""
    dt = INTERVAL_S
    transition, noise = np.eye(4), np.zeros((4, 4))
    for place in (0, 1):
        axis = np.ix_([place, place + 2], [place, place + 2])
        transition[axis] = np.array([[1.0, dt], [0.0, 1.0]])
        noise[axis] = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return MotionModel(transition, ACCELERATION * noise)


def recorded(rng: np.random.Generator, runs: int) -> Recording:
    """Both carriers track the same moving targets, scan by scan."""
    frame, truth = first(rng, runs)
    given, shape = model(), (runs, TARGETS)
    state = np.concatenate(
        [
            rng.uniform(-SIDE_M / 2, SIDE_M / 2, (*shape, 2)),
            rng.normal(0, SPEED_MPS, (*shape, 2)),
        ],
        axis=-1,
    )
    root = np.linalg.cholesky(given.noise)
    scans: list[tuple[Scan, Scan]] = []
    for _ in range(SCANS):
        logs = seen(rng, state[..., :2], truth)
        before = scans[-1] if scans else (None, None)
        one, two = (
            Scan(plot, filtered(last.tracks if last else None, plot, given))
            for last, plot in zip(before, logs, strict=True)
        )
        scans.append((one, two))
        state = state @ given.transition.T + rng.standard_normal((*shape, 4)) @ root.T
    return Recording(scans, frame, truth)


def filtered(before: TrackLog | None, plot: PolarLogs, given: MotionModel) -> TrackLog:
    """A Kalman filter's track after one more plot, in the carrier's axes."""
    z = east_north_from_polar(plot.bearing_rad, plot.range_m)
    sigmas = np.sqrt(plot.covariance[..., 0, 0]), np.sqrt(plot.covariance[..., 1, 1])
    r = east_north_covariance(plot.bearing_rad, plot.range_m, *sigmas)
    if before is None:
        covariance = np.zeros((*z.shape[:-1], 4, 4))
        covariance[..., :2, :2] = r
        covariance[..., 2:, 2:] = SPEED_MPS**2 * np.eye(2)
        return TrackLog(np.concatenate([z, np.zeros_like(z)], axis=-1), covariance)
    state = before.state @ given.transition.T
    p = given.transition @ before.covariance @ given.transition.T + given.noise
    gain = p[..., :, :2] @ inverse(p[..., :2, :2] + r)
    p = p - gain @ p[..., :2, :]
    return TrackLog(state + times(gain, z - state[..., :2]), (p + transposed(p)) / 2)


Logs = Callable[[Scan, Scan], PolarLogs]


def plots(before: Scan, now: Scan) -> PolarLogs:
    """The plots themselves."""
    del before
    return now.plots


def equivalents(before: Scan, now: Scan) -> PolarLogs:
    """What the tracks gained since the last scan."""
    return plots_of_tracks(before.tracks, now.tracks, model())


def states(before: Scan, now: Scan) -> PolarLogs:
    """The tracks' positions as if they were plots."""
    del before
    return PolarLogs.from_east_north(now.tracks.state[..., :2], now.tracks.covariance[..., :2, :2])


def registered(given: Recording, logs: Logs, chosen: Iterable[int]) -> float:
    """NEES/3 at the end of a registration by the chosen scans."""
    frame = given.before
    for index in chosen:
        (own_0, other_0), (own_1, other_1) = given.scans[index - 1], given.scans[index]
        frame = updated(logs(own_0, own_1), logs(other_0, other_1), frame).frame
    return float(nees(error(frame, given.truth), frame.covariance).mean() / 3)


def plot_differences(given: Recording) -> float:
    """Largest distance [m] of an equivalent measurement from the plot that was filtered."""
    worst = 0.0
    for last, now in pairwise(given.scans):
        for before, after in zip(last, now, strict=True):
            found = equivalents(before, after)
            there = east_north_from_polar(found.bearing_rad, found.range_m)
            plot = east_north_from_polar(after.plots.bearing_rad, after.plots.range_m)
            worst = max(worst, float(np.abs(there - plot).max()))
    return worst


def memory_of(given: Recording) -> float:
    """The memory [s] of the tracks at the last scan."""
    before, now = (pair[0].tracks for pair in given.scans[-2:])
    return float(np.median(memory_s(before, now, model(), INTERVAL_S)))
