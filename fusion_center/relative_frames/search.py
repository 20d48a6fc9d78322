"""Frames not yet known: which log is whose, and where the carrier's frame lies, both at once.

`estimation.acquisition` on the tracks of the own carrier and of one other. Identities that both
read and pairs that an operator has bound are certain; pairs ruled out stay apart. What is found is
used only when one way to lay the pictures on each other has nearly all the probability.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.acquisition import (
    Acquisition,
    Clues,
    Constraints,
    Settings,
    Velocities,
    acquire,
)
from estimation.arrays import Array
from estimation.relative_frame import OwnAxesFrame, PolarLogs, RelativeFramePrior

from ..settings import RegistrationSettings
from ..sources.sightings import Pair
from ..sources.telling import NOTHING_TELLS, Telling
from ..state import Orders
from .association import certain, ruled_out
from .views import View

TELLING_MPS = 5.0
"""Sigma of a velocity, per axis, from which it tells ships apart."""
LEAST_DOUBT = 1e-12
"""That a pair is wrong, or right."""


class Found(NamedTuple):
    """What a search came to.

    Attributes:
        pairs: of the most probable mode, with how each was paired; empty where no mode is trusted.
        probability: of that mode.
        sentence: in words.
        frame: of that mode.
    """

    pairs: list[Pair]
    probability: float
    sentence: str
    frame: OwnAxesFrame | None = None


def searched(
    own: View,
    other: View,
    prior: RelativeFramePrior,
    orders: Orders,
    now: RegistrationSettings,
    telling: Telling = NOTHING_TELLS,
) -> Found:
    """Pairs of two carriers' tracks when nothing but the prior is known of the other's frame.

    Args:
        other: its places along the axes of the own plane.
        telling: how features tell targets apart.

    Raises:
        LinAlgError, ValueError: covariances or places so extreme that nothing can be computed.
    """
    sure = certain(own, other, orders)
    mine = _surest(own, [pair.own for pair in sure], now.most_tracks)
    theirs = _surest(other, [pair.other for pair in sure], now.most_tracks)
    logs = _polar(own, mine), _polar(other, theirs)
    known = _constraints(own, other, (mine, theirs), sure, orders)
    ratio = _told(own, other, (mine, theirs), telling)
    clues = Clues(_velocities(own, mine), _velocities(other, theirs), log_ratio=ratio)
    found = acquire(*logs, prior, clues, known, Settings(trust=now.trust))
    if not _probability(found) > now.trust or found.status == "nothing":  # never of nan
        return Found([], _probability(found), found.sentence)
    best = found.modes[0]
    how = {(pair.own, pair.other): pair.method for pair in sure}
    by_features = ratio[best.own, best.other]
    chance = np.clip(best.pair_probability, LEAST_DOUBT, 1.0 - LEAST_DOUBT)
    by_place = np.log(chance / (1.0 - chance)) - by_features
    rows = zip(
        mine[best.own].tolist(),
        theirs[best.other].tolist(),
        by_place.tolist(),
        by_features.tolist(),
        strict=True,
    )
    pairs = [
        Pair(i, j, how[i, j]) if (i, j) in how else Pair(i, j, "coordinates", place, told)
        for i, j, place, told in rows
    ]
    return Found(pairs, best.probability, found.sentence, best.frame)


def _told(
    own: View, other: View, which: tuple[NDArray[np.intp], NDArray[np.intp]], telling: Telling
) -> Array:
    """Log-likelihood ratios (N1, N2) of the tracks searched, by their features."""
    i, j = (axis.ravel() for axis in np.meshgrid(*which, indexing="ij"))
    ratio: Array = telling.log_ratio(own.features, other.features, i, j)
    return ratio.reshape(len(which[0]), len(which[1]))


def _surest(view: View, needed: list[int], most: int) -> NDArray[np.intp]:
    """The tracks that are searched: those that are paired for certain, and the best known."""
    if len(view.log) <= most:
        return np.arange(len(view.log))
    spread = np.trace(view.covariance, axis1=1, axis2=2)
    spread[needed] = -1.0
    return np.sort(np.argsort(spread, kind="stable")[:most])


def _polar(view: View, which: NDArray[np.intp]) -> PolarLogs:
    return PolarLogs.from_east_north(view.east_north_m[which], view.covariance[which])


def _velocities(view: View, which: NDArray[np.intp]) -> Velocities:
    """Velocities that tell targets apart; one that is hardly known yet is none."""
    covariance = view.velocity_covariance[which]
    known = np.trace(covariance, axis1=1, axis2=2) < 2 * TELLING_MPS**2
    return Velocities(np.where(known[:, None], view.velocity_mps[which], np.nan), covariance)


def _constraints(
    own: View,
    other: View,
    which: tuple[NDArray[np.intp], NDArray[np.intp]],
    sure: list[Pair],
    orders: Orders,
) -> Constraints:
    """What is certain, and what is ruled out, in the numbering of the tracks searched."""
    at_own, at_other = ({int(i): k for k, i in enumerate(rows)} for rows in which)
    bound = {
        (at_own[pair.own], at_other[pair.other])
        for pair in sure
        if pair.own in at_own and pair.other in at_other
    }
    out = ruled_out(own, other, orders)
    forbidden = {(at_own[i], at_other[j]) for i, j in out if i in at_own and j in at_other}
    return Constraints(frozenset(bound), frozenset(forbidden - bound))


def _probability(found: Acquisition) -> float:
    chance = found.modes[0].probability if found.modes else 0.0
    return chance if np.isfinite(chance) else 0.0
