"""Using a correction without pretending that it is exact: consider (Schmidt) covariances.

Targets of the other carrier are taken to own axes by an estimated (q, D). Its error is common to
all of them, and it is not improved by looking at them again: it is *considered*, S + H P H',
while the correction itself stays as it is. Then a fused position is never worse than the own
sensor alone; with S only, one or two pairs do harm.

Source: Jazwinski, Stochastic Processes and Filtering Theory, section 8.6 (Schmidt-Kalman).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, transposed
from estimation.frames import east_north_by_polar, east_north_from_polar
from estimation.relative_frame.logs import OwnAxesFrame, PolarLogs
from estimation.relative_frame.matrices import inverse, times


class Positions(NamedTuple):
    """Places of targets in own axes.

    Attributes:
        east_north_m: (..., L, 2).
        covariance: (..., L, 2, 2) of each; what the correction adds is inside.
        by_frame: (..., L, 2, 3) H, how each moves with (q, D); zero for own logs. Two targets
            of one carrier are correlated by H_i P H_j'.
    """

    east_north_m: Array
    covariance: Array
    by_frame: Array


def positions(logs: PolarLogs) -> Positions:
    """Own logs (..., L) as places: they need no correction."""
    by_polar = east_north_by_polar(logs.bearing_rad, logs.range_m)
    return Positions(
        east_north_from_polar(logs.bearing_rad, logs.range_m),
        by_polar @ logs.covariance @ transposed(by_polar),
        np.zeros((*logs.range_m.shape, 2, 3)),
    )


def corrected(other: PolarLogs, frame: OwnAxesFrame) -> Positions:
    """The other carrier's logs (..., L) as places in own axes, with S + H P H'."""
    turned = PolarLogs(
        other.bearing_rad + np.asarray(frame.D_rad)[..., None], other.range_m, other.covariance
    )
    seen = positions(turned)
    by_frame = seen.by_frame.copy()
    by_frame[..., 0, 0] = by_frame[..., 1, 1] = 1
    by_frame[..., 0, 2] = seen.east_north_m[..., 1]
    by_frame[..., 1, 2] = -seen.east_north_m[..., 0]
    considered = by_frame @ frame.covariance[..., None, :, :] @ transposed(by_frame)
    return Positions(
        seen.east_north_m + frame.q_m[..., None, :], seen.covariance + considered, by_frame
    )


def fused(own: Positions, other: Positions) -> Positions:
    """The same targets from both carriers, weighed by their whole covariances.

    The result moves with the frame by `by_frame`, so what is fused next can consider it again.
    Not for pairs that have themselves made the correction, unless it is refined further: their
    errors are in (q, D) already.
    """
    weight = own.covariance @ inverse(own.covariance + other.covariance)  # of the other's
    keep = np.eye(2) - weight
    return Positions(
        own.east_north_m + times(weight, other.east_north_m - own.east_north_m),
        keep @ own.covariance @ transposed(keep) + weight @ other.covariance @ transposed(weight),
        weight @ other.by_frame + keep @ own.by_frame,
    )
