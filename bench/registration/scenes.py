"""The paper's experiment with known pairs: what two carriers report, and the truth behind it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.frames import polar_from_east_north, rotation_clockwise
from estimation.relative_frame import (
    OwnAxesFrame,
    PolarLogs,
    RelativeFrame,
    RelativeFramePrior,
)

DEG = np.pi / 180
SIGMA_RANGE_M, SIGMA_BEARING_RAD, SIGMA_OFFSET_M, SIGMA_C_RAD = 100.0, 0.5 * DEG, 1500.0, 1 * DEG
SIDE_M = 30e3


class Experiment(NamedTuple):
    """Runs of the paper's experiment as one batch: what the carriers report, and the truth."""

    own: PolarLogs
    other: PolarLogs
    prior: RelativeFramePrior
    theta: Array  # (runs, 4) the corrections to be found: x, y, c1, c2
    true_own: PolarLogs
    true_other: PolarLogs
    truth: RelativeFramePrior  # the true offset, with the prior's sigmas


def experiment(
    rng: np.random.Generator, shape: tuple[int, ...], pairs: int, sigma_c_rad: float = SIGMA_C_RAD
) -> Experiment:
    """Targets uniform in a square centred on the own carrier, the other uniform in it.

    `shape` is that of the batch: (runs,), or () for one experiment.
    """
    targets = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (*shape, pairs, 2))
    offset = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (*shape, 2))
    sigmas = np.array([SIGMA_OFFSET_M, SIGMA_OFFSET_M, sigma_c_rad, sigma_c_rad])
    theta = sigmas * rng.standard_normal((*shape, 4))
    true_own, true_other = _exact(targets), _exact(targets - offset[..., None, :])
    return Experiment(
        own=_measured(rng, true_own, theta[..., 2]),
        other=_measured(rng, true_other, theta[..., 3]),
        prior=RelativeFramePrior.from_sigmas(offset - theta[..., :2], *sigmas),
        theta=theta,
        true_own=true_own,
        true_other=true_other,
        truth=RelativeFramePrior.from_sigmas(offset, *sigmas),
    )


def _exact(east_north_m: Array) -> PolarLogs:
    bearing, ranges = polar_from_east_north(east_north_m)
    return PolarLogs.from_sigmas(bearing, ranges, SIGMA_BEARING_RAD, SIGMA_RANGE_M)


def _measured(rng: np.random.Generator, true: PolarLogs, c_rad: Array) -> PolarLogs:
    bearing = true.bearing_rad - c_rad[..., None]
    return PolarLogs.from_sigmas(
        bearing + SIGMA_BEARING_RAD * rng.standard_normal(bearing.shape),
        true.range_m + SIGMA_RANGE_M * rng.standard_normal(bearing.shape),
        SIGMA_BEARING_RAD,
        SIGMA_RANGE_M,
    )


def errors_fixed(frame: RelativeFrame, scene: Experiment) -> Array:
    """Errors (runs, 4) of (x, y, c1, c2)."""
    norths = np.stack([frame.c1_rad, frame.c2_rad], axis=-1)
    return np.concatenate([frame.offset_correction_m, norths], axis=-1) - scene.theta


def errors_own(frame: OwnAxesFrame, scene: Experiment) -> Array:
    """Errors (runs, 3) of (q, D): q is where the other carrier really stands in own axes."""
    own_from_fixed = rotation_clockwise(-scene.theta[:, 2])
    q = (own_from_fixed @ scene.truth.offset_m[..., None])[..., 0]
    turn = frame.D_rad - (scene.theta[:, 3] - scene.theta[:, 2])
    return np.concatenate([frame.q_m - q, turn[:, None]], axis=-1)


def logs_of(scene: Experiment) -> tuple[PolarLogs, PolarLogs, RelativeFramePrior]:
    """The arguments of every pairwise method."""
    return scene.own, scene.other, scene.prior
