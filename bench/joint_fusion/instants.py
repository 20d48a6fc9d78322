"""At which instant to fuse: the paper's formula, what it saves in time, and manoeuvring targets."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_most, between, near, told
from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.time_alignment import (
    Carried,
    at_last,
    at_tick,
    carried,
    fused_logs,
    sigma_at_last,
)

PERIOD_S = 10.0
SIGMA_M, SIGMA_SPEED_MPS, SIGMA_TURN_MPS2 = 100.0, 5.0, 8.0
RATIOS = (0.0, 0.5, 1.0, 2.0, 5.0)


class Logs(NamedTuple):
    """R targets with n logs each at random moments of one period, and how each target flies."""

    times_s: Array  # (R, n)
    place_m: Array  # (R, n, 2)
    start_m: Array  # (R, 2) at time 0
    velocity_mps: Array  # (R, 2)
    acceleration_mps2: Array  # (R, 2) from 0 on; nobody knows it
    believed_mps: Array  # (R, 2) velocity as tracked up to 0

    def truth_m(self, time_s: Array) -> Array:
        """Where the targets (R, 2) are at times (R,)."""
        t = time_s[:, None]
        return self.start_m + t * self.velocity_mps + t**2 / 2 * self.acceleration_mps2


def monte_carlo_ratio(seed: int, runs: int, carrying: float) -> float:
    """Measured over predicted sigma of two equal sources fused when the last one measures."""
    rng = np.random.default_rng([seed, int(10 * carrying)])
    first = rng.normal(0.0, 1.0, runs) + rng.normal(0.0, carrying, runs)
    second = rng.normal(0.0, 1.0, runs)
    weight = 1.0 / (1.0 + carrying**2)
    fused = (weight * first + second) / (weight + 1.0)
    return float(rms(fused) / sigma_at_last(1.0, carrying))


def logged(seed: int, runs: int, sources: int) -> Logs:
    """Targets at 200 m/s that turn as hard as they like."""
    rng = np.random.default_rng([seed, sources])
    start, heading = rng.uniform(0, 1e5, (runs, 2)), rng.uniform(0, 2 * np.pi, runs)
    velocity = 200.0 * np.column_stack([np.sin(heading), np.cos(heading)])
    across = np.column_stack([velocity[:, 1], -velocity[:, 0]]) / 200.0
    turn = across * rng.normal(0, SIGMA_TURN_MPS2, (runs, 1))
    at = rng.uniform(0, PERIOD_S, (runs, sources))
    believed = velocity + rng.normal(0, SIGMA_SPEED_MPS, (runs, 2))
    empty = np.empty((runs, sources, 2))
    logs = Logs(at, empty, start, velocity, turn, believed)
    places = np.stack([logs.truth_m(t) for t in at.T], axis=1)
    return logs._replace(place_m=places + rng.normal(0, SIGMA_M, places.shape))


def fused_at(of: Logs, instant_s: Array) -> Carried:
    """All logs of a target carried to an instant (R,) with what is known of its velocity."""
    shape = of.place_m.shape
    spread = np.broadcast_to(np.eye(2), (*shape, 2))
    q = 3.0 * SIGMA_TURN_MPS2**2 / 4.0  # q t^3 / 3 is then about that of half a turn, t = 1 s
    log = Carried(of.place_m, SIGMA_M**2 * spread)
    believed = np.broadcast_to(of.believed_mps[:, None], shape)
    moved = carried(
        log, believed, SIGMA_SPEED_MPS**2 * spread, instant_s[:, None] - of.times_s, q=q
    )
    return fused_logs(moved)


def error_m(found: Carried, truth_m: Array) -> float:
    """Root mean square of the distance."""
    return float(rms(np.linalg.norm(found.place_m - truth_m, axis=-1)))


def by_instant(seed: int, runs: int, sources: int) -> dict[str, float]:
    """Errors [m] and times [periods] of both ways, of n sources."""
    of = logged(seed, runs, sources)
    last, tick = at_last(of.times_s, PERIOD_S), at_tick(of.times_s, PERIOD_S)
    first = of.times_s.min(axis=1)
    return {
        "fused at the last, error then": error_m(fused_at(of, last), of.truth_m(last)),
        "fused at the tick, error then": error_m(fused_at(of, tick), of.truth_m(tick)),
        "age of the first log at the tick": float(np.mean(tick - first)) / PERIOD_S,
        "waited for the tick after the last": float(np.mean(tick - last)) / PERIOD_S,
    }


def blurred_clocks(seed: int, runs: int, sigma_s: float = 0.5) -> tuple[float, float]:
    """NEES/2 of logs whose stamps err, with the sigma of the stamp and without."""
    rng = np.random.default_rng([seed, 99])
    velocity = rng.normal(0, 200.0, (runs, 2))
    error = rng.normal(0, SIGMA_M, (runs, 2)) - velocity * rng.normal(0, sigma_s, (runs, 1))
    log = Carried(error, np.broadcast_to(SIGMA_M**2 * np.eye(2), (runs, 2, 2)))
    still = np.zeros((runs, 2, 2))
    told_of, not_told = (
        carried(log, velocity, still, np.zeros(runs), np.full(runs, sigma))
        for sigma in (sigma_s, 0.0)
    )
    with_it, without = (
        float(nees(found.place_m, found.covariance).mean() / 2) for found in (told_of, not_told)
    )
    return with_it, without


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The formula, its limit, the times saved, the errors with manoeuvres, stamps that err."""
    draws = max(100 * runs, 100_000)
    worst = max(abs(monte_carlo_ratio(seed, draws, p) - 1.0) for p in RATIOS)
    yield at_most("s_OB: measured / formula - 1, largest", worst, 0.01)
    yield near("s_OB / s as carrying costs nothing", float(sigma_at_last(1.0, 0.0)), 0.7071, 5e-5)
    for sources in (1, 2, 3):
        found = by_instant(seed, max(20 * runs, 5000), sources)
        for name, value in found.items():
            text = f"{sources} sources, {name}"
            if name.startswith("age"):
                yield near(text, value, sources / (sources + 1), 0.02, "T")
            elif name.startswith("waited"):
                yield near(text, value, 1 / (sources + 1), 0.02, "T")
            else:
                yield told(text, value, "m")
    with_it, without = blurred_clocks(seed, max(20 * runs, 5000))
    yield between("stamps that err by .5 s, sigma known: NEES/2", with_it, 0.9, 1.1)
    yield told("stamps that err by .5 s, sigma left out: NEES/2", without)
