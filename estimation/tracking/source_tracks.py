"""Tracks of one source in its own frame: whose plot is it?

One plot to one track, the likeliest set of pairs within a gate; `existence` says whether there is a
target at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.relative_frame.matrices import Indices
from estimation.tracking.bank import Innovations


class Sensing(NamedTuple):
    """What is assumed of a source and of its targets.

    Attributes:
        process_noise: q of the targets' velocities [m^2/s^3].
        gate: chi-squared of 2 within which a plot may belong to a track.
        detection: probability that a look sees a target.
        clutter_density: false plots expected on a square metre in a look.
    """

    process_noise: float
    gate: float
    detection: float
    clutter_density: float


def log_ratio(found: Innovations, sensing: Sensing) -> Array:
    """(n, m) ln of the density of a plot if it is of the track's target, over that of clutter."""
    ratio: Array = found.log_likelihood + np.log(sensing.detection / sensing.clutter_density)
    return ratio


def assigned(found: Innovations, gate: float) -> tuple[Indices, Indices]:
    """Tracks and plots (k,) of the likeliest one-to-one set, each pair within the gate.

    As many pairs as can be: to leave one out is as unlikely as the worst pair there may be.
    """
    possible = found.distance2 <= gate  # never true of nan
    if not possible.any():
        none = np.zeros(0, dtype=np.intp)
        return none, none
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415  (0.4 s, at the first use)

    cost = found.distance2 + found.log_determinant
    left_out = gate + found.log_determinant[possible].max()
    gain = np.where(possible, np.maximum(left_out - cost, 1e-9), 0.0)
    track, plot = linear_sum_assignment(gain, maximize=True)
    chosen = possible[track, plot]
    return track[chosen], plot[chosen]
