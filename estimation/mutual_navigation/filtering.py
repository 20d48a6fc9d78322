"""Kalman steps of several carriers together: correlated noise, and gains for some of them only.

An update may improve all states (the centralised filter), or only those of the carrier that
measured, the errors of the others being *considered*: their cross-covariances stay exact, so that
nothing is believed twice however often fixes are passed on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array


class Gaussian(NamedTuple):
    """A state and its uncertainty.

    Attributes:
        mean: (N,).
        covariance: (N, N).
    """

    mean: Array
    covariance: Array


class Step(NamedTuple):
    """One instant of a filter, as the smoother needs it.

    Attributes:
        transition: (N, N) from the instant before.
        predicted: before the measurements of the instant.
        updated: after them.
    """

    transition: Array
    predicted: Gaussian
    updated: Gaussian


def predicted(known: Gaussian, transition: Array, noise: Array) -> Gaussian:
    """The state after a transition (N, N) with noise covariance (N, N)."""
    covariance = transition @ known.covariance @ transition.T + noise
    return Gaussian(transition @ known.mean, (covariance + covariance.T) / 2)


def updated(
    known: Gaussian,
    innovation: Array,
    by_state: Array,
    noise: Array,
    improves: NDArray[np.intp] | None = None,
) -> Gaussian:
    """The state after m measurements whose errors may be correlated.

    Args:
        known: before.
        innovation: (m,) measured less predicted.
        by_state: (m, N) derivatives of the measurements.
        noise: (m, m) covariance of their errors; it may be singular.
        improves: indices of the states that are corrected, default all. The others keep mean and
            covariance; what ties them to the corrected ones is kept exactly.

    Source: Skrypnik & Erokhin, eqs 8 and 9, are this for two measurements of one state.
    """
    seen = by_state @ known.covariance
    spread = seen @ by_state.T + noise
    gain = np.linalg.solve(spread, seen).T.astype(float)
    if improves is not None:
        chosen = np.zeros_like(gain)
        chosen[improves] = gain[improves]
        gain = chosen
    return corrected(known, innovation, by_state, noise, gain)


def corrected(
    known: Gaussian, innovation: Array, by_state: Array, noise: Array, gain: Array
) -> Gaussian:
    """The state after measurements used with any gain (N, m), however it was found."""
    seen = by_state @ known.covariance
    spread = seen @ by_state.T + noise
    lost = gain @ seen
    covariance = known.covariance - lost - lost.T + gain @ spread @ gain.T
    return Gaussian(known.mean + gain @ innovation, (covariance + covariance.T) / 2)


def smoothed(steps: Sequence[Step]) -> list[Gaussian]:
    """Every instant in the light of all (Rauch, Tung & Striebel), the last unchanged."""
    if not steps:
        return []
    later = steps[-1].updated
    found = [later]
    for now, following in zip(steps[-2::-1], steps[:0:-1], strict=True):
        ahead = following.predicted
        tied = following.transition @ now.updated.covariance
        gain = np.linalg.lstsq(ahead.covariance, tied, rcond=None)[0].T
        mean = now.updated.mean + gain @ (later.mean - ahead.mean)
        covariance = now.updated.covariance + gain @ (later.covariance - ahead.covariance) @ gain.T
        later = Gaussian(mean, (covariance + covariance.T) / 2)
        found.append(later)
    return found[::-1]
