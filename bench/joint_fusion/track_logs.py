"""Two sources that track by themselves: increments, intersection, and states taken for plots."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_most, between, told
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.relative_frame import Increment, MotionModel, TrackLog, equivalent_measurement
from estimation.track_fusion import (
    covariance_intersection,
    information_of,
    predicted,
    with_increments,
)

SCANS, INTERVAL_S = 40, 1.0
SIGMAS_M = ((20.0, 60.0), (60.0, 20.0))  # of two sources in east and north: they complement
Q = 4.0  # m^2/s^3
SIGMA_SPEED_MPS = 100.0
AXES = np.eye(2)


class Recording(NamedTuple):
    """Targets (N) by scan: true states, plots of both sources, and their filters' tracks."""

    truth: list[Array]
    plots: list[list[Increment]]
    tracks: list[list[TrackLog]]


class Fused(NamedTuple):
    """What the centre holds of every target at the end, and NEES/4 over the second half."""

    track: TrackLog
    nees: float


def model() -> MotionModel:
    """Constant velocity, white acceleration, east and north; state east, north, their rates."""
    t = INTERVAL_S
    noise = Q * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
    transition = np.array([[1.0, t], [0.0, 1.0]])
    return MotionModel(*(np.asarray(np.kron(m, AXES), dtype=float) for m in (transition, noise)))


@cache
def recorded(seed: int, targets: int) -> Recording:
    """Targets as the model says, every plot seen."""
    rng, moved = np.random.default_rng(seed), model()
    truth = np.hstack([rng.uniform(-5e4, 5e4, (targets, 2)), rng.normal(0, 50, (targets, 2))])
    start = _start(truth)
    tracks: list[list[TrackLog]] = [[start, start]]
    states, plots = [truth], []
    for _ in range(SCANS):
        noise = rng.multivariate_normal(np.zeros(4), moved.noise, targets)
        truth = truth @ moved.transition.T + noise
        seen = [_plot(rng, truth, sigma) for sigma in SIGMAS_M]
        rows = np.arange(targets)
        before = [predicted(track, moved) for track in tracks[-1]]
        tracks.append([with_increments(b, p, rows) for b, p in zip(before, seen, strict=True)])
        states.append(truth)
        plots.append(seen)
    return Recording(states, plots, tracks)


def _start(truth: Array) -> TrackLog:
    """What everybody knows beforehand: hardly anything, about the place the target began at."""
    spread = np.diag([1e8, 1e8, SIGMA_SPEED_MPS**2, SIGMA_SPEED_MPS**2])
    middle = np.zeros_like(truth)
    return TrackLog(middle, np.broadcast_to(spread, (len(truth), 4, 4)).copy())


def _plot(rng: np.random.Generator, truth: Array, sigma: tuple[float, float]) -> Increment:
    place = truth[:, :2] + rng.normal(0.0, sigma, (len(truth), 2))
    covariance = np.broadcast_to(np.diag(np.square(sigma)), (len(truth), 2, 2))
    return information_of(TrackLog(place, covariance), 4)


Centre = Callable[[Recording, int, TrackLog], TrackLog]


def by_plots(of: Recording, scan: int, track: TrackLog) -> TrackLog:
    """Central fusion: the plots themselves."""
    for plot in of.plots[scan]:
        track = with_increments(track, plot, np.arange(len(track.state)))
    return track


def by_increments(of: Recording, scan: int, track: TrackLog) -> TrackLog:
    """What each source's filter learnt since its last report."""
    before, now = of.tracks[scan], of.tracks[scan + 1]
    for b, n in zip(before, now, strict=True):
        gained = equivalent_measurement(b, n, model())
        track = with_increments(track, gained, np.arange(len(track.state)))
    return track


def by_intersection(of: Recording, scan: int, track: TrackLog) -> TrackLog:
    """The sources' tracks by covariance intersection."""
    for log in of.tracks[scan + 1]:
        track = covariance_intersection(track, information_of(log, 4)).track
    return track


def naively(of: Recording, scan: int, track: TrackLog) -> TrackLog:
    """The sources' tracks as if they were fresh measurements."""
    for log in of.tracks[scan + 1]:
        track = with_increments(track, information_of(log, 4), np.arange(len(track.state)))
    return track


def fused(of: Recording, method: Centre) -> Fused:
    """A centre over all scans."""
    track, squares = _start(of.truth[0]), []
    for scan in range(SCANS):
        track = method(of, scan, predicted(track, model()))
        if scan >= SCANS // 2:
            squares.append(nees(track.state - of.truth[scan + 1], track.covariance).mean() / 4)
    return Fused(track, float(np.mean(squares)))


def difference(a: TrackLog, b: TrackLog) -> float:
    """Largest difference of states in sigmas, and of covariances in variances."""
    sigma = np.sqrt(np.diagonal(b.covariance, axis1=1, axis2=2))
    states = np.abs(a.state - b.state) / sigma
    spread = np.abs(a.covariance - b.covariance) / (sigma[:, :, None] * sigma[:, None])
    return float(max(states.max(), spread.max()))


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Increments against central fusion, and how honest each way is."""
    of = recorded(seed, max(runs // 2, 20))
    central, exact = fused(of, by_plots), fused(of, by_increments)
    apart, plain = fused(of, by_intersection), fused(of, naively)
    alone = nees(of.tracks[-1][0].state - of.truth[-1], of.tracks[-1][0].covariance).mean() / 4
    yield at_most(
        "increments - central fusion", difference(exact.track, central.track), 1e-9, "sigma"
    )
    yield between("increments: NEES/dim", exact.nees, 0.9, 1.1)
    yield at_most("covariance intersection: NEES/dim", apart.nees, 1.1)
    yield told("states taken for plots: NEES/dim", plain.nees)
    yield told("one source's own track: NEES/dim", float(alone))
    for name, track in (
        ("central fusion", central.track),
        ("covariance intersection", apart.track),
        ("the first source's track", of.tracks[-1][0]),
        ("states taken for plots", plain.track),
    ):
        yield told(f"{name}: error of the place", _rms_m(track, of.truth[-1]), "m")


def _rms_m(track: TrackLog, truth: Array) -> float:
    error = track.state[:, :2] - truth[:, :2]
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
