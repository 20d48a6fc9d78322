"""One instant for logs of many: at the last of them, or at the tick at which the picture leaves.

The paper carries earlier logs to the moment of the last one and not to the tick. Here nothing waits
for a tick at all; both ways are kept as functions, so that the paper can be repeated.

Source: Klimov, paper 002, procedure (a). Its 1/s_j^2 = 1/s_meas^2 + 1/s_carry^2 is a misprint of
s_j^2 = s_meas^2 + s_carry^2, and its limit .705 of sqrt(1/2).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike
from estimation.relative_frame.matrices import inverse, times

Instant = Callable[[Array, float], Array]
"""Times of logs (..., n) [s] and the period of the ticks [s] -> the instant to carry them to."""


class Carried(NamedTuple):
    """Places (..., d) at another instant, with covariance (..., d, d)."""

    place_m: Array
    covariance: Array


def at_last(times_s: Array, period_s: float) -> Array:
    """`align_to = "last"`: the time of the last log; the period has no say."""
    del period_s
    return np.asarray(times_s.max(axis=-1), dtype=float)


def at_tick(times_s: Array, period_s: float) -> Array:
    """`align_to = "tick"`: the first tick not before the last log; ticks at whole periods."""
    return np.asarray(np.ceil(times_s.max(axis=-1) / period_s) * period_s, dtype=float)


def sigma_at_last(sigma: ArrayLike, carrying: ArrayLike) -> Array:
    """One sigma of two equal sources fused when the second one measures, s_OB of the paper.

    Args:
        sigma: of either measurement.
        carrying: one sigma of carrying the first to that moment.

    Source: the formula after procedure (a): s sqrt(1 - s^2 / (2 s^2 + p^2)).
    """
    s2, p2 = np.square(sigma), np.square(carrying)
    return np.asarray(np.sqrt(s2 * (1.0 - s2 / (2.0 * s2 + p2))), dtype=float)


def sigma_of_fused(sigma: ArrayLike, carrying: ArrayLike) -> Array:
    """One sigma (...) of logs (..., n), each with its own and that of carrying it; for any number.

    The errors of carrying are taken as independent, as the paper does.
    """
    variance = np.square(sigma) + np.square(carrying)
    return np.asarray(1.0 / np.sqrt(np.sum(1.0 / variance, axis=-1)), dtype=float)


def carried(
    log: Carried,
    velocity_mps: Array,
    velocity_covariance: Array,
    passed_s: ArrayLike,
    sigma_time_s: ArrayLike = 0.0,
    q: float = 0.0,
) -> Carried:
    """Logs (..., d) some time later, each with a time and a sigma of its time of its own.

    Args:
        log: as measured.
        velocity_mps: (..., d) of the target; velocity_covariance: (..., d, d).
        passed_s: (...) from the log's own instant (its `t_ns` plus its time offset) to the new one.
        sigma_time_s: (...) of that instant: an error along the velocity.
        q: spectral density of the target's acceleration [m^2/s^3], per axis.
    """
    t = np.asarray(passed_s, dtype=float)[..., None]
    blurred = np.asarray(sigma_time_s, dtype=float)[..., None] * velocity_mps
    way2 = np.square(t)[..., None] + np.square(sigma_time_s)[..., None, None]
    manoeuvre = (q * np.abs(t) ** 3 / 3)[..., None] * np.eye(log.place_m.shape[-1])
    along = blurred[..., :, None] * blurred[..., None, :]
    covariance = log.covariance + way2 * velocity_covariance + along + manoeuvre
    return Carried(log.place_m + t * velocity_mps, covariance)


def fused_logs(logs: Carried) -> Carried:
    """One place (..., d) of n independent logs (..., n, d) of one instant, by their weights."""
    weight = inverse(logs.covariance)
    covariance = inverse(weight.sum(axis=-3))
    place = times(covariance, times(weight, logs.place_m).sum(axis=-2))
    return Carried(place, covariance)


def time_offset(
    misclosure_m: Array, covariance: Array, velocity_mps: Array, prior_sigma_s: ArrayLike
) -> tuple[Array, Array]:
    """A time offset of each log (...) with its sigma [s], from how far it lies along the velocity.

    Args:
        misclosure_m: (..., d) place of the log less where the target was at the stated time.
        covariance: (..., d, d) of it, the target's own uncertainty included.
        velocity_mps: (..., d); a target at rest tells nothing and the prior stays.
        prior_sigma_s: (...) of the offset before.
    """
    pull = times(inverse(covariance), velocity_mps)
    information = np.sum(pull * velocity_mps, axis=-1)
    variance = np.square(prior_sigma_s)
    after = variance / (1.0 + variance * information)
    return after * np.sum(pull * misclosure_m, axis=-1), np.asarray(np.sqrt(after), dtype=float)
