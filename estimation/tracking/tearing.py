"""A track whose hypotheses lie far apart is torn: one Gaussian would stand for none of them.

Far from the sensors the ellipse of a first plot holds several plots of the next scan. Their moments
are those of the whole ellipse, so that nothing would be learnt until they become few. Where one
hypothesis can stand by itself and is much narrower than the fold of all, it goes on as the track;
what is left of the fold, with the existence that is left, is a track of its own. One can that is
likelier than all the others together, or that is likelier by itself to be a target than `_STANDS`:
of several targets close together the tracks wait less for each other.
The number of targets expected stays what it was.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.tracking import imm
from estimation.tracking.imm import Bank
from estimation.tracking.pairing import Paired, believed

_HALF, _ALL = 0.5, 0.99  # share of a hypothesis that stands by itself, and of one that is the fold
_STANDS = 0.25  # existence of a hypothesis that stands by itself with less
_WIDER = 4.0  # times the area of its ellipse is that of a fold that is torn
_NOTHING = 1e-3  # of the probability of a model


class Torn(NamedTuple):
    """t tracks that are torn.

    Attributes:
        pair: (t,) rows of the leading pairs.
        lead: what these make of their tracks; rest: the folds without them.
    """

    pair: Indices
    lead: Bank
    rest: Bank


def leading(track: Indices, share: Array, existence: Array) -> Indices:
    """The likeliest pair of each track (n,) that has one that can stand by itself.

    Args:
        track, share: (k,) track of each pair, and its probability if that track exists.
        existence: (n,) of the tracks.
    """
    stands = (share > _HALF) | (share * existence[track] > _STANDS)
    some = np.flatnonzero(stands & (share < _ALL))
    order = some[np.lexsort((-share[some], track[some]))]
    return np.asarray(order[np.diff(track[order], prepend=-1) != 0])


def torn(before: Bank, fold: Bank, pairs: Paired, share: Array, model: Array) -> Torn:
    """Which tracks are torn, and into what.

    Args:
        before: the tracks before the scan; fold: after it.
        pairs: that lead, one a track.
        share: (k,) probability of each if its track exists; model: (models, k) after it.
    """
    lead, folds = believed(before, pairs, model), fold.take(pairs.track)
    wide = np.flatnonzero(_area(folds) > _WIDER * _area(lead))
    lead = lead.take(wide)
    return Torn(wide, lead, without(folds.take(wide), lead, share[wide]))


def without(fold: Bank, part: Bank, share: Array) -> Bank:
    """What has to be folded with `part`, of some share (n,) below 1, to give `fold`.

    A model that is next to nothing without the part stays as the fold has it.
    """
    left = fold.model - part.model * share
    some = left > _NOTHING * fold.model
    ratio = np.where(some, part.model * share / np.where(some, left, 1.0), 0.0)
    away = part.mean - fold.mean
    far = away[:, None] * away
    covariance = fold.covariance + ratio * (fold.covariance - part.covariance - (1 + ratio) * far)
    model = np.where(some, left, 0.0)
    shared = fold.shared + ratio * (fold.shared - part.shared)
    return Bank(fold.mean - ratio * away, covariance, model / model.sum(axis=0), shared)


def _area(bank: Bank) -> Array:
    """Square root of the determinant of the covariance of the place (n,) [m^2]."""
    _, covariance = imm.places(bank)
    determinant = covariance[0, 0] * covariance[1, 1] - covariance[0, 1] ** 2
    return np.asarray(np.sqrt(np.maximum(determinant, 0.0)))
