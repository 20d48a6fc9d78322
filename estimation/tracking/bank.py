"""Many Kalman filters in one array: targets of near-constant velocity in a plane.

The velocity of each axis is a random walk of spectral density q [m^2/s^3]; positions are measured.
Nothing loops over tracks, and no number makes an exception: what cannot be inverted becomes nan.

Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation,
sections 5.2 and 6.2.2 (continuous white noise acceleration).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike, transposed


class Bank(NamedTuple):
    """n filters.

    Attributes:
        state: (n, 4) east, north [m] and their rates [m/s].
        covariance: (n, 4, 4).
    """

    state: Array
    covariance: Array

    @property
    def size(self) -> int:
        """How many there are."""
        return len(self.state)

    def take(self, which: slice | np.ndarray) -> Bank:
        """Some of them, by a slice, a mask or indices."""
        return Bank(self.state[which], self.covariance[which])

    def joined(self, more: Bank) -> Bank:
        """These filters and, after them, others."""
        return Bank(*(np.concatenate(both) for both in zip(self, more, strict=True)))


EMPTY = Bank(np.zeros((0, 4)), np.zeros((0, 4, 4)))


class Innovations(NamedTuple):
    """How far m plots lie from where n filters expect them.

    Attributes:
        distance2: (n, m) normalised squared, chi-squared of 2.
        log_determinant: (n, m) of the innovation's covariance [ln m^4].
    """

    distance2: Array
    log_determinant: Array

    @property
    def log_likelihood(self) -> Array:
        """(n, m) ln of the density of the plot [1/m^2] if it is of the filter's target."""
        logarithm: Array = -0.5 * (self.distance2 + self.log_determinant) - np.log(2 * np.pi)
        return logarithm


def begun(place_m: Array, covariance: Array, sigma_velocity_mps: ArrayLike) -> Bank:
    """Filters that know of their targets one plot each.

    Args:
        place_m: (n, 2).
        covariance: (n, 2, 2) of the places.
        sigma_velocity_mps: (n,) of each component of a velocity of which nothing is known.
    """
    whole = np.zeros((len(place_m), 4, 4))
    whole[:, :2, :2] = covariance
    whole[:, (2, 3), (2, 3)] = np.reshape(np.square(sigma_velocity_mps), (-1, 1))
    return Bank(np.concatenate([place_m, np.zeros_like(place_m)], axis=1), whole)


def carried(bank: Bank, elapsed_s: ArrayLike, process_noise: float) -> Bank:
    """The filters some time later, or earlier: each its own time (n,).

    Args:
        process_noise: q [m^2/s^3].
    """
    dt = np.broadcast_to(np.asarray(elapsed_s, dtype=float), bank.size)
    forward = np.zeros_like(bank.covariance)
    forward[:, range(4), range(4)] = 1.0
    forward[:, (0, 1), (2, 3)] = dt[:, None]
    state = (forward @ bank.state[..., None])[..., 0]
    moved = forward @ bank.covariance @ transposed(forward)
    return Bank(state, moved + _noise(dt, process_noise))


def _noise(dt: Array, process_noise: float) -> Array:
    """(n, 4, 4) what the random walk of the velocities adds; as much backwards."""
    noise = np.zeros((len(dt), 4, 4))
    size = process_noise * np.abs(dt)
    noise[:, (0, 1), (0, 1)] = (size * dt**2 / 3)[:, None]
    noise[:, (2, 3), (2, 3)] = size[:, None]
    noise[:, (0, 1), (2, 3)] = noise[:, (2, 3), (0, 1)] = (size * dt / 2)[:, None]
    return noise


def innovations_of(
    bank: Bank, elapsed_s: Array, process_noise: float, place_m: Array, covariance: Array
) -> Innovations:
    """Every plot against every filter, each at the plot's own time.

    Args:
        elapsed_s: (n, m) from each filter's time to each plot's.
        place_m: (m, 2).
        covariance: (m, 2, 2) of the plots.
    """
    dt = np.asarray(elapsed_s, dtype=float)[..., None, None]
    apart = place_m - (bank.state[:, None, :2] + dt[..., 0] * bank.state[:, None, 2:])
    p = bank.covariance[:, None]
    cross = p[..., :2, 2:] + p[..., 2:, :2]
    spread = p[..., :2, :2] + dt * cross + dt**2 * p[..., 2:, 2:] + covariance
    spread += process_noise * np.abs(dt) ** 3 / 3 * np.eye(2)
    return Innovations(*normalised(apart, spread))


def normalised(apart: Array, spread: Array) -> tuple[Array, Array]:
    """Normalised squared distances (...) of (..., 2) and ln of the determinants of (..., 2, 2)."""
    ee, en, nn = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    determinant = ee * nn - en * spread[..., 1, 0]
    east, north = apart[..., 0], apart[..., 1]
    weighed = nn * east**2 - (en + spread[..., 1, 0]) * east * north + ee * north**2
    return weighed / determinant, np.log(determinant)


def improved(bank: Bank, place_m: Array, covariance: Array) -> Bank:
    """Each filter with one plot of its own taken in.

    Args:
        place_m: (n, 2) at the filters' times.
        covariance: (n, 2, 2) of the plots.
    """
    p = bank.covariance
    gain = p[:, :, :2] @ _inverse(p[:, :2, :2] + covariance)
    apart = place_m - bank.state[:, :2]
    keep = np.eye(4) - np.concatenate([gain, np.zeros_like(gain)], axis=2)
    after = keep @ p @ transposed(keep) + gain @ covariance @ transposed(gain)
    return Bank(bank.state + (gain @ apart[..., None])[..., 0], after)


def _inverse(matrices: Array) -> Array:
    """Symmetric (n, 2, 2) inverted; nan where that cannot be."""
    a, b, d = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    swapped = np.stack([d, -b, -b, a], axis=1).reshape(-1, 2, 2)
    inverse: Array = swapped / (a * d - b**2)[:, None, None]
    return inverse
