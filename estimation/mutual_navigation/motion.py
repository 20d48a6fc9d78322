"""How the corrections of dead reckoning wander: velocity and height errors forget, clocks drift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from estimation.arrays import Array
from estimation.mutual_navigation.network import (
    CLOCK,
    DRIFT,
    USER_STATES,
    VX,
    VY,
    X,
    Y,
    Z,
)


class Wander(NamedTuple):
    """Errors of one user's dead reckoning, height and clock.

    Attributes:
        sigma_velocity_mps: with its memory `memory_velocity_s` (Gauss-Markov).
        sigma_height_m: with its memory `memory_height_s`.
        clock_walk_m_root_s: random walk of the clock offset.
        sigma_start_m: of each level coordinate at the start; of the clock `sigma_clock_m`, of its
            drift `sigma_drift_mps`.
    """

    sigma_velocity_mps: float = 1.0
    memory_velocity_s: float = 1800.0
    sigma_height_m: float = 10.0
    memory_height_s: float = 600.0
    clock_walk_m_root_s: float = 0.0
    sigma_start_m: float = 100.0
    sigma_clock_m: float = 300.0
    sigma_drift_mps: float = 0.3

    @property
    def start(self) -> Array:
        """(7, 7) covariance at the start."""
        sigma = np.empty(USER_STATES)
        sigma[[X, Y]], sigma[[VX, VY]] = self.sigma_start_m, self.sigma_velocity_mps
        sigma[Z], sigma[CLOCK], sigma[DRIFT] = (
            self.sigma_height_m,
            self.sigma_clock_m,
            self.sigma_drift_mps,
        )
        return np.diag(sigma**2)

    def step(self, dt_s: float) -> tuple[Array, Array]:
        """Transition (7, 7) and noise covariance (7, 7) of an interval, exact."""
        transition, noise = np.eye(USER_STATES), np.zeros((USER_STATES, USER_STATES))
        kept, moved, spread = _integrated_markov(dt_s, self.memory_velocity_s)
        for place, velocity in ((X, VX), (Y, VY)):
            transition[place, velocity], transition[velocity, velocity] = moved, kept
            pair = np.ix_([place, velocity], [place, velocity])
            noise[pair] = self.sigma_velocity_mps**2 * spread
        forgets = float(np.exp(-dt_s / self.memory_height_s))
        transition[Z, Z], noise[Z, Z] = forgets, self.sigma_height_m**2 * (1 - forgets**2)
        transition[CLOCK, DRIFT] = dt_s
        noise[CLOCK, CLOCK] = self.clock_walk_m_root_s**2 * dt_s
        return transition, noise


def joint_step(
    users: list[Wander], dt_s: float, controllers: list[tuple[float, float]]
) -> tuple[Array, Array]:
    """Transition and noise (N, N) of users and of uncertain places (sigma per axis, memory)."""
    steps = [wander.step(dt_s) for wander in users]
    for sigma_m, memory_s in controllers:
        kept = float(np.exp(-dt_s / memory_s))
        steps.append((kept * np.eye(3), sigma_m**2 * (1 - kept**2) * np.eye(3)))
    transition, noise = (
        np.asarray(block_diag(*part), dtype=float) for part in zip(*steps, strict=True)
    )
    return transition, noise


def joint_start(users: list[Wander], controllers: list[tuple[float, float]]) -> Array:
    """Covariance (N, N) at the start, all independent."""
    places = [sigma_m**2 * np.eye(3) for sigma_m, _ in controllers]
    return np.asarray(block_diag(*(wander.start for wander in users), *places), dtype=float)


def _integrated_markov(dt_s: float, memory_s: float) -> tuple[float, float, Array]:
    """Of a unit Gauss-Markov velocity: what is kept, what it moves, covariance (2, 2) gained."""
    ratio = dt_s / memory_s
    kept = float(np.exp(-ratio))
    left = float(-np.expm1(-ratio))
    moved = memory_s * left
    velocity = float(-np.expm1(-2 * ratio))
    cross = memory_s * left**2
    place = (
        memory_s**2 * (2 * ratio - 2 * left - left**2)
        if ratio > 1e-3
        else (2 * dt_s**3 / (3 * memory_s) * (1 - 0.75 * ratio))
    )
    return kept, moved, np.array([[place, cross], [cross, velocity]])
