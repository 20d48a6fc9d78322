"""Which directions of (q, D) the targets determine, in words."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from estimation.arrays import Array

Status = Literal["determined", "weak", "undetermined"]

_DETERMINED, _WEAK = 0.5, 0.9  # posterior sigma over prior sigma
_PURE = 0.8  # share of the prior-scaled motion above which a direction is named by one part alone


class Direction(NamedTuple):
    """One principal direction of (q, D) and how far the data narrowed it.

    Attributes:
        name: in words, "location along 040 deg", "orientation", or both "together".
        ratio: posterior over prior sigma along it; 1 = nothing learnt.
        status: determined (ratio < .5), weak (< .9) or undetermined.
        motion: (3,) the displacement of (q, D) [m, m, rad] of one prior sigma along it.
    """

    name: str
    ratio: float
    status: Status
    motion: Array

    def __str__(self) -> str:
        """The direction as a sentence."""
        return f"{self.name} is {self.status}: {self.ratio:.2g} of the prior sigma"


def directions(posterior: Array, prior: Array) -> list[Direction]:
    """Principal directions of a correction, the least determined first.

    The ratios are the square roots of the generalised eigenvalues of (posterior, prior), so they
    depend neither on units nor on the choice of axes.

    Args:
        posterior: (3, 3) covariance of (q, D), east m, north m, rad.
        prior: (3, 3) covariance before the data, positive definite.

    Raises:
        ValueError: the prior is not positive definite, so there is nothing to compare with.
    """
    try:
        np.linalg.cholesky(prior)
    except np.linalg.LinAlgError as error:
        raise ValueError("the prior covariance of (q, D) must be positive definite") from error
    sigmas = np.sqrt(np.diag(prior))
    variances, axes = np.linalg.eigh(prior / np.outer(sigmas, sigmas))
    # The symmetric root and the rounding break ties: no data names east, north and orientation.
    root = sigmas[:, None] * (axes * np.sqrt(variances)) @ axes.T
    whitener = np.linalg.inv(root)
    shrunk = whitener @ posterior @ whitener.T
    principal = np.linalg.eigh(shrunk.round(12))[1].T[::-1]
    return [_direction(axis, shrunk, root, sigmas) for axis in principal]


def _direction(axis: Array, shrunk: Array, root: Array, sigmas: Array) -> Direction:
    """The direction of one unit `axis` (3,) of the space where the prior is the unit matrix."""
    ratio = float(np.sqrt(axis @ shrunk @ axis))
    motion = root @ axis
    return Direction(_name(motion, sigmas), ratio, _status(ratio), motion)


def _status(ratio: float) -> Status:
    """How far a direction is determined."""
    if ratio < _DETERMINED:
        return "determined"
    return "weak" if ratio < _WEAK else "undetermined"


def _name(motion: Array, sigmas: Array) -> str:
    """A motion of (q, D) in words; parts are weighed in prior sigmas."""
    scaled = (motion / sigmas) ** 2
    turn_share = scaled[2] / scaled.sum()
    if turn_share > _PURE:
        return "orientation"
    along = round(float(np.degrees(np.arctan2(motion[0], motion[1])))) % 180
    location = f"location along {along:03d} deg"
    return location if turn_share < 1 - _PURE else f"{location} together with orientation"
