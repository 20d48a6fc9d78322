"""A bank of filters of a few models each: all tracks at once, the track as the last axis.

A state is (east, north, east rate, north rate) in the picture frame. All models move with constant
velocity under white acceleration noise, faint for straight motion and strong for manoeuvres; the
probability of each is carried along (interacting multiple models). What a turn or a change of speed
does to a target grows with its velocity, so noise may as well be of its turn rate and of its speed.
Arrays are (4, models, n): component, model, track; numpy then works on long rows, and what
differs between one target and a hundred thousand is the length of the rows.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from estimation.arrays import Array, Indices

_PLACE, _RATE = slice(0, 2), slice(2, 4)
_BATCH = 4096  # mixtures worked on together: their numbers stay in the cache


class Motion(NamedTuple):
    """How targets are expected to move: in one of several ways, the quietest first.

    Attributes:
        noise: (models,) spectral density [m^2/s^3] of each component of the white acceleration.
        louder_s: (models - 1,) mean time [s] until a target takes up each way but the first.
        quieter_s: (models - 1,) mean time until one that does falls back.
        sigma_speed_mps: one sigma of each velocity component of a target just found.
        turning: (models,) spectral density [rad^2/s] of a white turn rate; empty = none turns so.
        hastening: (models,) spectral density [1/s] of a white relative change of speed; likewise.
        out_of: (models - 1,) way before it that each but the first is taken up out of, and falls
            back to; empty = the one just before it.
    """

    noise: tuple[float, ...] = (1.0, 300.0)
    louder_s: tuple[float, ...] = (60.0,)
    quieter_s: tuple[float, ...] = (10.0,)
    sigma_speed_mps: float = 150.0
    turning: tuple[float, ...] = ()
    hastening: tuple[float, ...] = ()
    out_of: tuple[int, ...] = ()

    @property
    def models(self) -> int:
        """Number of them."""
        return len(self.noise)

    @property
    def origins(self) -> tuple[int, ...]:
        """(models - 1,) `out_of`, none left out."""
        return self.out_of or tuple(range(self.models - 1))

    def steady(self) -> Array:
        """(models,) share of the targets that move so, in the long run."""
        share = np.ones(self.models)
        for k, origin in enumerate(self.origins):
            share[k + 1] = share[origin] * self.quieter_s[k] / self.louder_s[k]
        steady: Array = share / share.sum()
        return steady

    @lru_cache(maxsize=64)  # noqa: B019 - of the value; sources report at even intervals
    def change(self, dt_s: float) -> Array:
        """(models, models) probability that a target of one model is of another `dt_s` later."""
        rate = np.zeros((self.models, self.models))
        for k, origin in enumerate(self.origins):
            rate[origin, k + 1], rate[k + 1, origin] = 1 / self.louder_s[k], 1 / self.quieter_s[k]
        change: Array = expm((rate - np.diag(rate.sum(axis=1))) * dt_s)
        change.flags.writeable = False
        return change


class Bank(NamedTuple):
    """States of n tracks under each of the models; never changed in place.

    Attributes:
        mean: (4, models, n) [m, m/s].
        covariance: (4, 4, models, n).
        model: (models, n) probability of each model, columns sum to 1.
        shared: (4, errors, models, n) covariance with errors of frames, see `frame_errors`.
    """

    mean: Array
    covariance: Array
    model: Array
    shared: Array

    def take(self, which: Indices) -> Bank:
        """The tracks `which`, in that order."""
        return Bank(*(part.take(which, axis=-1) for part in self))


def empty(models: int = 2) -> Bank:
    """No tracks."""
    return bare(np.zeros((4, models, 0)), np.zeros((4, 4, models, 0)), np.zeros((models, 0)))


def bare(mean: Array, covariance: Array, model: Array) -> Bank:
    """Tracks that have nothing to do with frames."""
    return Bank(mean, covariance, model, np.zeros((4, 0, *model.shape)))


def joined(*banks: Bank) -> Bank:
    """The tracks of all, in order."""
    parts = zip(*banks, strict=True)
    return Bank(*(np.concatenate(part, axis=-1) for part in parts))


def born(place_m: Array, covariance_m2: Array, offset_s: Array, motion: Motion) -> Bank:
    """Tracks from places (2, n) with covariances (2, 2, n), their velocities unknown.

    The places hold `offset_s` (n,) after the instant of the bank.
    """
    n, models = place_m.shape[-1], motion.models
    mean, covariance = np.zeros((4, models, n)), np.zeros((4, 4, models, n))
    mean[_PLACE] = place_m[:, None]
    covariance[_PLACE, _PLACE] = covariance_m2[:, :, None]
    variance = motion.sigma_speed_mps**2
    for k in (0, 1):
        covariance[k + 2, k + 2] = variance
        covariance[k, k] += variance * offset_s**2
        covariance[k, k + 2] = covariance[k + 2, k] = -variance * offset_s
    return bare(mean, covariance, np.repeat(motion.steady()[:, None], n, axis=-1))


def predicted(bank: Bank, dt_s: float, motion: Motion) -> Bank:
    """The bank `dt_s` later: models interact, then each moves.

    Source: Blom & Bar-Shalom, The interacting multiple model algorithm for systems with Markovian
    switching coefficients, IEEE Trans. AC 33(8), 1988.
    """
    return _moved(_interacted(bank, dt_s, motion), dt_s, motion)


def combined(bank: Bank) -> tuple[Array, Array]:
    """Mean (4, n) and covariance (4, 4, n) of each track over its models."""
    mean, covariance = _mixed(bank, bank.model[:, None])
    return mean[:, 0], covariance[:, :, 0]


def places(bank: Bank) -> tuple[Array, Array]:
    """Mean (2, n) and covariance (2, 2, n) of the place of each track over its models."""
    place, spread = bank.mean[_PLACE], bank.covariance[_PLACE, _PLACE]
    return combined(bank._replace(mean=place, covariance=spread))


def _interacted(bank: Bank, dt_s: float, motion: Motion) -> Bank:
    """Each model restarted from the mixture that a change of model since the last time implies."""
    joint = motion.change(dt_s)[:, :, None] * bank.model[:, None]  # was i, is now j
    model = joint.sum(axis=0)
    given = joint / np.maximum(model, 1e-300)
    mean, covariance = _mixed(bank, given)
    shared = np.einsum("aein,ijn->aejn", bank.shared, given)
    return Bank(mean, covariance, model, shared)


def _mixed(bank: Bank, share: Array) -> tuple[Array, Array]:
    """First two moments of j mixtures of the models with shares (models, j, n).

    Returns:
        mean (4, j, n), covariance (4, 4, j, n); fewer components if the bank has fewer.
    """
    parts, shape = len(bank.mean), share.shape[1:]
    mean, covariance = np.zeros((parts, *shape)), np.zeros((parts, parts, *shape))
    batch = _BATCH // share.shape[1]
    for first in range(0, share.shape[-1], batch):
        some = np.s_[..., first : first + batch]
        _mix(bank.mean[some], bank.covariance[some], share[some], mean[some], covariance[some])
    return mean, covariance


def _mix(means: Array, covariances: Array, share: Array, mean: Array, covariance: Array) -> None:
    """Adds the moments of mixtures to a mean and a covariance of zeros."""
    work = np.empty_like(covariance)
    for model, weight in enumerate(share):
        mean += means[:, model, None] * weight
        covariance += np.multiply(covariances[:, :, model, None], weight, out=work)
    for model, weight in enumerate(share):
        apart = means[:, model, None] - mean
        np.multiply(apart[:, None], apart, out=work)
        covariance += np.multiply(work, weight, out=work)


def _moved(bank: Bank, dt_s: float, motion: Motion) -> Bank:
    """Constant velocity under white acceleration noise, by blocks of F P F' + Q."""
    noise = _noise(bank, motion)
    mean, covariance = bank.mean.copy(), bank.covariance.copy()
    mean[_PLACE] += dt_s * mean[_RATE]
    covariance[_PLACE] += dt_s * covariance[_RATE]
    covariance[:, _PLACE] += dt_s * covariance[:, _RATE]
    covariance[_PLACE, _PLACE] += noise * (dt_s**3 / 3)
    covariance[_PLACE, _RATE] += noise * (dt_s**2 / 2)
    covariance[_RATE, _PLACE] += noise * (dt_s**2 / 2)
    covariance[_RATE, _RATE] += noise * dt_s
    shared = bank.shared
    if shared.size:
        shared = shared.copy()
        shared[_PLACE] += dt_s * shared[_RATE]
    return Bank(mean, covariance, bank.model, shared)


def _noise(bank: Bank, motion: Motion) -> Array:
    """Spectral densities (2, 2, models, n) of the acceleration [m^2/s^3].

    A turn rate w and a relative change of speed h accelerate a target of velocity v by w J v + h v,
    J a quarter turn: with white w and h, densities t and s, by t J E[v v'] J' + s E[v v'].
    """
    noise = np.zeros((2, 2, *bank.model.shape))
    for k in (0, 1):
        noise[k, k] = np.asarray(motion.noise, dtype=float)[:, None]
    if motion.turning or motion.hastening:
        rate = bank.mean[_RATE]
        squared = bank.covariance[_RATE, _RATE] + rate[:, None] * rate
        turning, hastening = (
            np.asarray(each or np.zeros(motion.models))[:, None]
            for each in (motion.turning, motion.hastening)
        )
        across = turning * squared
        noise += hastening * squared
        noise[0, 0] += across[1, 1]
        noise[1, 1] += across[0, 0]
        noise[0, 1] -= across[0, 1]
        noise[1, 0] -= across[1, 0]
    return noise
