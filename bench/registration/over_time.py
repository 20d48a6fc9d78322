"""Frames that drift, target logs that are tracks, and jumps: registration over time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_least, between
from bench.registration.scenes import (
    DEG,
    SIDE_M,
    SIGMA_BEARING_RAD,
    SIGMA_C_RAD,
    SIGMA_OFFSET_M,
    SIGMA_RANGE_M,
)
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import polar_from_east_north, rotation_clockwise, wrap_pi
from estimation.relative_frame import (
    STEADY,
    Drift,
    OwnAxesFrame,
    PolarLogs,
    Travel,
    advanced,
)

DRIFT = Drift(q_m_per_root_s=3.0, D_rad_per_root_s=0.02 * DEG)
INTERVAL_S, INSTANTS, TARGETS = 10.0, 60, 8
SPEED_MPS = 10.0


class Truth(NamedTuple):
    """The true frame of each of N runs: q (N, 2), D (N,)."""

    q_m: Array
    D_rad: Array


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Drift, as it is and ignored."""
    count = max(runs // 100, 20)
    honest, ignored = (drift_nees(seed, count, assumed) for assumed in (DRIFT, STEADY))
    yield between("drift: NEES/3 over the second half", honest, 0.9, 1.1)
    yield at_least("drift ignored: NEES/3 over the second half", ignored, 10)


def drift_nees(seed: int, runs: int, assumed: Drift) -> float:
    """Mean NEES/3 over the second half of a run of drifting frames and moving carriers."""
    rng = np.random.default_rng([seed, 60])
    frame, truth = first(rng, runs)
    total = 0.0
    for instant in range(INSTANTS):
        travel = Travel(*(SPEED_MPS * INTERVAL_S * _directions(rng, runs) for _ in range(2)))
        truth = moved(truth, travel, drifted(rng, runs, DRIFT, INTERVAL_S))
        own, other = pairs(rng, truth, TARGETS)
        frame = advanced(frame, INTERVAL_S, assumed, own, other, travel).frame
        if instant >= INSTANTS // 2:
            total += float(nees(error(frame, truth), frame.covariance).mean()) / 3
    return total / (INSTANTS - INSTANTS // 2)


def first(rng: np.random.Generator, runs: int) -> tuple[OwnAxesFrame, Truth]:
    """The paper's prior, in own axes, about a true frame somewhere in the square."""
    truth = Truth(rng.uniform(-SIDE_M / 2, SIDE_M / 2, (runs, 2)), np.zeros(runs))
    sigmas = np.array([SIGMA_OFFSET_M, SIGMA_OFFSET_M, np.sqrt(2) * SIGMA_C_RAD])
    wrong = sigmas * rng.standard_normal((runs, 3))
    covariance = np.broadcast_to(np.diag(sigmas**2), (runs, 3, 3))
    return OwnAxesFrame(truth.q_m + wrong[:, :2], truth.D_rad + wrong[:, 2], covariance), truth


def drifted(rng: np.random.Generator, runs: int, drift: Drift, elapsed_s: float) -> Array:
    """Steps (N, 3) of the random walk."""
    sigmas = np.sqrt(np.diag(drift.covariance(elapsed_s)))
    return sigmas * rng.standard_normal((runs, 3))


def moved(truth: Truth, travel: Travel, step: Array) -> Truth:
    """The true frame after the carriers' travel and a step of the drift."""
    other = np.asarray(travel.other_m)
    turned = (rotation_clockwise(truth.D_rad) @ other[..., None])[..., 0]
    return Truth(
        truth.q_m + turned - np.asarray(travel.own_m) + step[:, :2], truth.D_rad + step[:, 2]
    )


def pairs(rng: np.random.Generator, truth: Truth, count: int) -> tuple[PolarLogs, PolarLogs]:
    """Logs of fresh targets in the square, as both carriers measure them."""
    targets = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (len(truth.D_rad), count, 2))
    return seen(rng, targets, truth)


def seen(rng: np.random.Generator, targets_m: Array, truth: Truth) -> tuple[PolarLogs, PolarLogs]:
    """Logs of targets (N, L, 2) [m] in own axes."""
    both = []
    for apart, turn in ((targets_m, 0.0), (targets_m - truth.q_m[:, None], truth.D_rad[:, None])):
        bearing, ranges = polar_from_east_north(apart)
        both.append(
            PolarLogs.from_sigmas(
                bearing - turn + SIGMA_BEARING_RAD * rng.standard_normal(bearing.shape),
                ranges + SIGMA_RANGE_M * rng.standard_normal(bearing.shape),
                SIGMA_BEARING_RAD,
                SIGMA_RANGE_M,
            )
        )
    return both[0], both[1]


def error(frame: OwnAxesFrame, truth: Truth) -> Array:
    """Errors (N, 3) of (q, D)."""
    turn = wrap_pi(frame.D_rad - truth.D_rad)
    return np.concatenate([frame.q_m - truth.q_m, turn[:, None]], axis=1)


def _directions(rng: np.random.Generator, runs: int) -> Array:
    angle = rng.uniform(-np.pi, np.pi, runs)
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)
