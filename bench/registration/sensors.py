"""Range biases, range scale and clock offset as states: honest, and how much they learn."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, between, told
from bench.registration.over_time import Truth, error, seen
from bench.registration.scenes import SIDE_M, SIGMA_C_RAD, SIGMA_OFFSET_M
from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.frames import rotation_clockwise
from estimation.relative_frame import (
    PolarLogs,
    RelativeFramePrior,
    SensorErrorPrior,
    adjustment_with_sensor_errors,
)

SIGMAS = SensorErrorPrior(own_bias_m=200.0, other_bias_m=200.0, scale=0.005, clock_s=5.0)
SPEED_MPS = 100.0  # of each axis: aircraft


class Means(NamedTuple):
    """Of many runs with all sensor errors at once."""

    nees: float  # of frame and sensor errors, / 7
    chi2: float  # / 2L
    learnt: Array  # (4,) RMS error after / prior sigma
    converged: float


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """All four sensor errors beside the frame."""
    for pairs in (6, 12, 50):
        m = measure(seed, max(runs // 10, 50), pairs)
        name = f"sensor errors, L = {pairs}"
        yield between(f"{name}: NEES/7", m.nees, 0.95, 1.05)
        yield between(f"{name}: chi2/(2L)", m.chi2, 0.97, 1.03)
        for what, ratio in zip(("own bias", "other bias", "scale", "clock"), m.learnt, strict=True):
            yield told(f"{name}: {what}, RMS error / prior", ratio)


def measure(seed: int, runs: int, pairs: int) -> Means:
    """The paper's experiment with moving targets and both sensors wrong."""
    rng = np.random.default_rng([seed, pairs, 7])
    wrong = np.array(SIGMAS) * rng.standard_normal((runs, 4))
    offset = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (runs, 2))
    norths = SIGMA_C_RAD * rng.standard_normal((runs, 2))
    q = (rotation_clockwise(-norths[:, 0]) @ offset[..., None])[..., 0]
    truth = Truth(q, norths[:, 1] - norths[:, 0])
    places = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (runs, pairs, 2))
    velocity = rng.normal(0, SPEED_MPS, (runs, pairs, 2))  # in own axes
    own, _ = seen(rng, places, truth)
    _, other = seen(rng, places - wrong[:, None, 3:] * velocity, truth)
    own = PolarLogs(own.bearing_rad, own.range_m - wrong[:, :1], own.covariance)
    reported = other.range_m / (1 + wrong[:, 2:3]) - wrong[:, 1:2]
    other = PolarLogs(other.bearing_rad, reported, other.covariance)
    prior = RelativeFramePrior(
        offset + SIGMA_OFFSET_M * rng.standard_normal((runs, 2)),
        SIGMA_OFFSET_M**2 * np.eye(2),
        SIGMA_C_RAD,
        SIGMA_C_RAD,
    )
    in_other = (rotation_clockwise(-truth.D_rad)[:, None] @ velocity[..., None])[..., 0]
    found = adjustment_with_sensor_errors(own, other, prior, SIGMAS, in_other)
    errors = np.concatenate([error(found.own_axes, truth), found.errors - wrong], axis=1)
    return Means(
        float(nees(errors, found.covariance).mean() / 7),
        float(found.chi2.mean() / (2 * pairs)),
        rms(errors[:, 3:], axis=0) / np.array(SIGMAS),
        float(found.converged.mean()),
    )
