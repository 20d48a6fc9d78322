"""Whether bearings of two carriers are of one target, when no name says so.

Two lines cross somewhere at any instant, so one instant says nothing. Over time the crossings of
lines of two targets move as nothing with inertia does, the more so when a carrier turns. A pair is
solved with the frame in doubt, as each of several motions, and compared with both by themselves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.each_target import each_target
from estimation.bearings_only.fitting import maximum_likelihood
from estimation.bearings_only.measurements import Bearings
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.several_carriers import FramePrior

_WORST = -1e9


def log_odds_of_one(
    own: Bearings,
    other: Bearings,
    prior: FramePrior,
    motions: Sequence[Motion],
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> Array:
    """Ln (K,) of how much likelier each pair is of one target than of two.

    Schwarz's criterion stands for the evidence: half of chi2 + parameters ln bearings, of the best
    motion.

    Args:
        own, other: bearings (n, N) and (m, N') with common times and places, not finite where a
            target was not seen.
        prior: of the other's frame.
        motions: polynomials and splines.
        pairs: rows (K,) of both.

    Source: G. Schwarz, Annals of Statistics 6 (1978), 461-464.
    """
    i, j = pairs
    one, two = _rows(own, i), _rows(other, j)
    apart = _alone(own, motions)[i] + _alone(other, motions)[j]
    count = np.log(_seen(one) + _seen(two))
    together = np.full(len(i), np.inf)
    for motion in motions:
        found = each_target([one, two], [prior], motion)
        cost = found.chi2 + (motion.size - 1) * count
        together = np.fmin(together, np.where(found.converged, cost, np.inf))
    odds: Array = np.nan_to_num((apart - together) / 2, nan=_WORST, neginf=_WORST)
    return np.maximum(odds, _WORST)


def _alone(given: Bearings, motions: Sequence[Motion]) -> Array:
    """Schwarz's criterion (n,) of the best motion of targets by one carrier's bearings."""
    best = np.full(len(given.bearing_rad), np.inf)
    for motion in motions:
        cost = maximum_likelihood(given, motion).chi2 + (motion.size - 1) * np.log(_seen(given))
        best = np.fmin(best, cost)
    return best


def _rows(given: Bearings, which: NDArray[np.intp]) -> Bearings:
    sigma = np.broadcast_to(given.sigma_rad, given.bearing_rad.shape)
    return given._replace(bearing_rad=given.bearing_rad[which], sigma_rad=sigma[which])


def _seen(given: Bearings) -> Array:
    count: Array = np.maximum(np.isfinite(given.bearing_rad).sum(axis=1), 1).astype(float)
    return count
