"""Which directions of (q, D) the targets determine, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from estimation.arrays import Array

FRAME_NAMES = ("location east", "location north", "orientation")
Status = Literal["determined", "weak", "undetermined"]

DETERMINED, WEAK = 0.5, 0.9  # posterior sigma over prior sigma
_UNNOTICED = 0.5  # of the sigma of one plot: whoever joins it to others hardly sees the difference
_SAYS = 1e-3  # prior sigmas by data sigmas below which the data say nothing
_PART = 0.15  # share of a direction's motion from which a parameter is named
_PURE = 0.8  # share of the prior-scaled motion above which a direction is named by one part alone


class Direction(NamedTuple):
    """One principal direction of (q, D) and how far the data narrowed it.

    Attributes:
        name: in words, "location along 040 deg", "orientation", or both "together".
        ratio: posterior over prior sigma along it; 1 = nothing learnt.
        status: determined (ratio < .5, or less is open than half the sigma of a plot), weak (< .9)
            or undetermined.
        motion: (3,) the displacement of (q, D) [m, m, rad] of one prior sigma along it.
    """

    name: str
    ratio: float
    status: Status
    motion: Array

    def __str__(self) -> str:
        """The direction as a sentence."""
        return f"{self.name} is {self.status}: {self.ratio:.2g} of the prior sigma"


def directions(posterior: Array, prior: Array, plot: Array | None = None) -> list[Direction]:
    """Principal directions of a correction, the least determined first; see `Direction.status`.

    The ratios are the square roots of the generalised eigenvalues of (posterior, prior), so they
    depend neither on units nor on the choice of axes.

    Args:
        posterior: (3, 3) covariance of (q, D), east m, north m, rad.
        prior: (3, 3) covariance before the data, positive definite.
        plot: (3, 3) information of one plot on (q, D), were the place of its target known. What is
            known so well that a plot would not tell need not be learnt from data.

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
    found = [_direction(axis, shrunk, root, sigmas) for axis in principal]
    if plot is None:
        return found
    judged = [_against(direction, plot) for direction in found]
    return sorted(judged, key=lambda direction: direction.status == "determined")


def _direction(axis: Array, shrunk: Array, root: Array, sigmas: Array) -> Direction:
    """The direction of one unit `axis` (3,) of the space where the prior is the unit matrix."""
    ratio = float(np.sqrt(axis @ shrunk @ axis))
    motion = root @ axis
    return Direction(_name(motion, sigmas), ratio, status(ratio), motion)


def _against(direction: Direction, plot: Array) -> Direction:
    """The same; determined where one plot would not tell what is left open."""
    left = direction.ratio * direction.motion
    unnoticed = left @ plot @ left < _UNNOTICED**2
    return direction._replace(status="determined") if unnoticed else direction


def status(ratio: float) -> Status:
    """How far a direction is determined."""
    if ratio < DETERMINED:
        return "determined"
    return "weak" if ratio < WEAK else "undetermined"


def _name(motion: Array, sigmas: Array) -> str:
    """A motion of (q, D) in words; parts are weighed in prior sigmas."""
    scaled = (motion / sigmas) ** 2
    turn_share = scaled[2] / scaled.sum()
    if turn_share > _PURE:
        return "orientation"
    along = round(float(np.degrees(np.arctan2(motion[0], motion[1])))) % 180
    location = f"location along {along:03d} deg"
    return location if turn_share < 1 - _PURE else f"{location} together with orientation"


class Diagnosis(NamedTuple):
    """What the targets alone say of some parameters, measured in sigmas of their prior.

    Attributes:
        singular_values: (m,) of the whitened target information, largest first: how many times
            better than the prior the data know a direction; 1 = as well, 0 = not at all.
        rank: directions of which the data say anything.
        beaten: directions that the data know better than the prior.
        weakest: the worst direction in words.
        sentence: the whole in one sentence.
    """

    singular_values: Array
    rank: int
    beaten: int
    weakest: str
    sentence: str


def diagnose(information: Array, prior: Array, names: Sequence[str] = FRAME_NAMES) -> Diagnosis:
    """Which combinations of parameters the targets determine.

    Args:
        information: (K, K) of the targets alone, sum of H' S^-1 H.
        prior: (K, K) covariance; a parameter of no variance is known and left out.
        names: of the K parameters.

    Raises:
        ValueError: no parameter is uncertain, or there are not K names.
    """
    if len(names) != len(prior):
        raise ValueError(f"need a name of each parameter: {len(names)} for {len(prior)}")
    free = np.flatnonzero(np.diag(prior) > 0)
    if free.size == 0:
        raise ValueError("no parameter is uncertain: there is nothing to determine")
    sigmas = np.sqrt(np.diag(prior)[free])
    correlation = prior[np.ix_(free, free)] / np.outer(sigmas, sigmas)
    variances, axes = np.linalg.eigh(correlation)
    root = (axes * np.sqrt(np.maximum(variances, 0))) @ axes.T  # of parameters in prior sigmas
    scaled = information[np.ix_(free, free)] * np.outer(sigmas, sigmas)
    gained, directions_of = np.linalg.eigh(root @ scaled @ root)
    values = np.sqrt(np.maximum(gained, 0))[::-1]
    weakest = _in_words((root @ directions_of[:, 0]) ** 2, [names[int(i)] for i in free])
    rank, beaten = int((values > _SAYS).sum()), int((values > 1).sum())
    worst = float(values[-1])
    said = "not told by the targets at all" if worst <= _SAYS else f"known to {1 / worst:.2g}"
    sentence = (
        f"{rank} of {len(free)} directions are seen, {beaten} better than the prior knows them; "
        f"weakest: {weakest}, {said}"
        + ("" if worst <= _SAYS else " of the prior sigma by the targets alone")
    )
    return Diagnosis(values, rank, beaten, weakest, sentence)


def _in_words(shares: Array, names: list[str]) -> str:
    """The parameters that move most along a direction."""
    shares = shares / shares.sum()
    order = [i for i in np.argsort(-shares) if shares[i] > _PART]
    return " together with ".join(names[i] for i in order)
