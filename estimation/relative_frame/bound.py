"""The Cramer-Rao bound of a registration: what no estimator can beat on average."""

from __future__ import annotations

from typing import NamedTuple

from estimation.arrays import Array
from estimation.relative_frame.closed_form import closed_form
from estimation.relative_frame.logs import PolarLogs, RelativeFramePrior, in_own_axes


class Bound(NamedTuple):
    """Posterior Cramer-Rao bound (the prior counts as a measurement) in both axis systems.

    Attributes:
        fixed: (..., 4, 4) of (x, y, c1, c2).
        own_axes: (..., 3, 3) of (q, D).
    """

    fixed: Array
    own_axes: Array


def cramer_rao(own: PolarLogs, other: PolarLogs, truth: RelativeFramePrior) -> Bound:
    """Bound of registering a known scene, the targets' positions being nuisance parameters.

    Four measurements and two coordinates a target: eliminating the target leaves the misclosure
    with covariance S, so the bound is the inverse of P0^-1 + sum H' S^-1 H *at the truth*.

    Args:
        own: (..., L) true bearings and ranges, with the covariances of the measurements.
        other: likewise from the other carrier, each from true north.
        truth: the true offset, with the prior's sigmas.

    Raises:
        ValueError: own and other differ in length.
    Source: Van Trees, Detection, Estimation and Modulation Theory I, section 2.4.3.
    """
    at_truth = closed_form(own, other, truth)  # its misclosures are zero: no correction is made
    return Bound(at_truth.covariance, in_own_axes(at_truth, truth).covariance)
