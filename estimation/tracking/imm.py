"""A bank of two-model filters: every track at once, arrays with the track as the last axis.

A state is (east, north, east rate, north rate) in the picture frame. Both models move with
constant velocity under white acceleration noise, faint for straight motion and strong for
manoeuvres; the probability that a target manoeuvres is carried along (interacting multiple
models). Arrays are (4, 2, n): component, model, track; numpy then works on long rows, and what
differs between one target and a hundred thousand is the length of the rows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices

_PLACE, _RATE = slice(0, 2), slice(2, 4)


class Motion(NamedTuple):
    """How targets are expected to move.

    Attributes:
        quiet, manoeuvring: spectral density [m^2/s^3] of each component of the white acceleration.
        quiet_s, manoeuvring_s: mean time [s] a target stays in that way of moving.
        sigma_speed_mps: one sigma of each velocity component of a target just found.
    """

    quiet: float = 1.0
    manoeuvring: float = 100.0
    quiet_s: float = 60.0
    manoeuvring_s: float = 10.0
    sigma_speed_mps: float = 150.0


class Bank(NamedTuple):
    """States of n tracks under two models; never changed in place.

    Attributes:
        mean: (4, 2, n) [m, m/s].
        covariance: (4, 4, 2, n).
        model: (2, n) probability of each model, columns sum to 1.
    """

    mean: Array
    covariance: Array
    model: Array

    def take(self, which: Indices) -> Bank:
        """The tracks `which`, in that order."""
        return Bank(*(np.take(part, which, axis=-1) for part in self))


def empty() -> Bank:
    """No tracks."""
    return Bank(np.zeros((4, 2, 0)), np.zeros((4, 4, 2, 0)), np.zeros((2, 0)))


def joined(first: Bank, second: Bank) -> Bank:
    """The tracks of both, in order."""
    both = zip(first, second, strict=True)
    return Bank(*(np.concatenate(parts, axis=-1) for parts in both))


def born(place_m: Array, covariance_m2: Array, offset_s: Array, motion: Motion) -> Bank:
    """Tracks from places (2, n) with covariances (2, 2, n), their velocities unknown.

    The places hold `offset_s` (n,) after the instant of the bank.
    """
    n = place_m.shape[-1]
    mean, covariance = np.zeros((4, 2, n)), np.zeros((4, 4, 2, n))
    mean[_PLACE] = place_m[:, None]
    covariance[_PLACE, _PLACE] = covariance_m2[:, :, None]
    variance = motion.sigma_speed_mps**2
    for k in (0, 1):
        covariance[k + 2, k + 2] = variance
        covariance[k, k] += variance * offset_s**2
        covariance[k, k + 2] = covariance[k + 2, k] = -variance * offset_s
    steady = motion.quiet_s / (motion.quiet_s + motion.manoeuvring_s)
    model = np.repeat([[steady], [1.0 - steady]], n, axis=-1)
    return Bank(mean, covariance, model)


def predicted(bank: Bank, dt_s: float, motion: Motion) -> Bank:
    """The bank `dt_s` later: models interact, then each moves.

    Source: Blom & Bar-Shalom, The interacting multiple model algorithm for systems with Markovian
    switching coefficients, IEEE Trans. AC 33(8), 1988.
    """
    return _moved(_interacted(bank, dt_s, motion), dt_s, motion)


def combined(bank: Bank) -> tuple[Array, Array]:
    """Mean (4, n) and covariance (4, 4, n) of each track over its models."""
    return _mixed(bank, bank.model)


def _interacted(bank: Bank, dt_s: float, motion: Motion) -> Bank:
    """Each model restarted from the mixture that a change of model since the last time implies."""
    leave = [-math.expm1(-dt_s / motion.quiet_s), -math.expm1(-dt_s / motion.manoeuvring_s)]
    change = np.array([[1.0 - leave[0], leave[0]], [leave[1], 1.0 - leave[1]]])
    joint = change[:, :, None] * bank.model[:, None]  # was i, is now j
    model = joint.sum(axis=0)
    given = joint / np.maximum(model, 1e-300)
    mixed = [_mixed(bank, given[:, j]) for j in (0, 1)]
    mean = np.stack([part[0] for part in mixed], axis=1)
    covariance = np.stack([part[1] for part in mixed], axis=2)
    return Bank(mean, covariance, model)


def _mixed(bank: Bank, share: Array) -> tuple[Array, Array]:
    """First two moments of the mixture of the two models with shares (2, n)."""
    apart = bank.mean[:, 1] - bank.mean[:, 0]
    mean = bank.mean[:, 0] + share[1] * apart
    spread = (apart[:, None] * apart) * (share[0] * share[1])
    each = bank.covariance
    covariance = each[:, :, 0] * share[0] + each[:, :, 1] * share[1] + spread
    return mean, covariance


def _moved(bank: Bank, dt_s: float, motion: Motion) -> Bank:
    """Constant velocity under white acceleration noise, by blocks of F P F' + Q."""
    mean, covariance = bank.mean.copy(), bank.covariance.copy()
    mean[_PLACE] += dt_s * mean[_RATE]
    covariance[_PLACE] += dt_s * covariance[_RATE]
    covariance[:, _PLACE] += dt_s * covariance[:, _RATE]
    noise = np.array([motion.quiet, motion.manoeuvring])[:, None]
    for k in (0, 1):
        covariance[k, k] += noise * (dt_s**3 / 3)
        covariance[k, k + 2] += noise * (dt_s**2 / 2)
        covariance[k + 2, k] += noise * (dt_s**2 / 2)
        covariance[k + 2, k + 2] += noise * dt_s
    return Bank(mean, covariance, bank.model)
