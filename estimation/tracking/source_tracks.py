"""Tracks of one source in its own frame: whose plot is it?

One plot to one track, the likeliest set of pairs within a gate; `existence` says whether there is a
target at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.relative_frame.matrices import Indices
from estimation.tracking.bank import Bank, Innovations, innovations


class Sensing(NamedTuple):
    """What is assumed of a source and of its targets.

    Attributes:
        process_noise: q of the targets' velocities [m^2/s^3].
        gate: chi-squared of 2 within which a plot may belong to a track.
        detection: probability that a look sees a target.
        clutter_density: false plots expected on a square metre in a look.
        lifetime_s: for which a target that is there stays, on average.
    """

    process_noise: float
    gate: float
    detection: float
    clutter_density: float
    lifetime_s: float


class Scan(NamedTuple):
    """The m plots of one look.

    Attributes:
        at_s: (m,) when each was measured.
        place_m: (m, 2) along the axes of the tracks.
        covariance: (m, 2, 2) [m^2].
    """

    at_s: Array
    place_m: Array
    covariance: Array


class Matches(NamedTuple):
    """Pairs (k,) of a track and its plot, and ln of how much likelier a target is than clutter."""

    track: Indices
    plot: Indices
    log_ratio: Array


def matched(bank: Bank, at_s: Array, scan: Scan, sensing: Sensing) -> Matches:
    """The likeliest one-to-one pairs of n tracks and m plots.

    Args:
        at_s: (n,) times of the tracks, on the scale of the scan's.
    """
    found = expected(bank, at_s, scan, sensing)
    track, plot = assigned(found, sensing.gate)
    return Matches(track, plot, log_ratio(found, sensing)[track, plot])


def expected(bank: Bank, at_s: Array, scan: Scan, sensing: Sensing) -> Innovations:
    """Every plot against every track."""
    elapsed = scan.at_s - at_s[:, None]
    return innovations(bank, elapsed, sensing.process_noise, scan.place_m, scan.covariance)


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
