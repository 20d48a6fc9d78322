"""Applying a correction: honest with a consider covariance, harmful for few pairs without."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_least, at_most, between, told
from bench.registration.over_time import Truth, seen
from bench.registration.scenes import SIDE_M, experiment, logs_of
from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.frames import rotation_clockwise
from estimation.relative_frame import adjustment
from estimation.relative_frame.consider import Positions, corrected, fused, positions

LENGTHS = (1, 2, 3, 5, 10, 30)
FRESH = 3  # targets a run that the correction has not seen


class Means(NamedTuple):
    """Of fused positions, over many runs and fresh targets."""

    nees: float  # / 2
    nees_ignored: float  # / 2, with S in place of S + H P H'
    gain: float  # RMS error / own sensor alone
    gain_ignored: float


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Honest for every L; never worse than the own sensor."""
    for pairs in LENGTHS:
        m = measure(seed, max(runs // 2, 50), pairs)
        name = f"consider, L = {pairs}"
        yield between(f"{name}: NEES/2 of fused positions", m.nees, 0.97, 1.03)
        yield at_most(f"{name}: RMS error / own sensor alone", m.gain, 1)
        yield told(f"{name}: the same without H P H'", m.gain_ignored)
        if pairs == 1:
            yield at_least(f"{name}: NEES/2 without H P H'", m.nees_ignored, 3)


def measure(seed: int, runs: int, pairs: int) -> Means:
    """Registration by L pairs of the paper's experiment, then fusion of fresh targets."""
    rng = np.random.default_rng([seed, pairs, 9])
    scene = experiment(rng, (runs,), pairs)
    frame = adjustment(*logs_of(scene)).own_axes
    own_from_fixed = rotation_clockwise(-scene.theta[:, 2])
    truth = Truth(
        (own_from_fixed @ scene.truth.offset_m[..., None])[..., 0],
        scene.theta[:, 3] - scene.theta[:, 2],
    )
    targets = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (runs, FRESH, 2))
    own_logs, other_logs = seen(rng, targets, truth)
    own, other = positions(own_logs), corrected(other_logs, frame)
    exact = frame._replace(covariance=np.zeros_like(frame.covariance))
    honest, ignored = fused(own, other), fused(own, corrected(other_logs, exact))
    alone = _rms(own, targets)
    return Means(
        _nees(honest, targets),
        _nees(ignored, targets),
        _rms(honest, targets) / alone,
        _rms(ignored, targets) / alone,
    )


def _nees(found: Positions, targets: Array) -> float:
    return float(nees(found.east_north_m - targets, found.covariance).mean() / 2)


def _rms(found: Positions, targets: Array) -> float:
    return float(rms(found.east_north_m - targets))
