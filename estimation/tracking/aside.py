"""Does a track stand where its target is? Readings too wide to move it tell, if all lie aside.

Where two carriers see a target from opposite sides, their ranges fix one coordinate and the range
of a third carrier the other. A track that takes the third one's plots from a neighbour is as sharp
as a right one, and bearings a kilometre wide fit it as well: each by itself, but all of them are
off the same way. The track moves too little to take that in, and no other could begin, as it holds
the plots. So what such readings say of a target that stands aside is added up by itself. Is that
target by so much likelier than one where the track is, the track is of nobody.

What all plots of a scan have in common, an offset or too small a sigma, is the sensor's: it is
taken out first and speaks against no track.

Source: Willsky & Jones, A generalized likelihood ratio approach to the detection and estimation of
jumps in linear systems, IEEE Trans. AC 21(1), 1976; how far aside is expected beforehand is what
one reading tells, as in Kass & Wasserman, J. American Statistical Association 90, 1995.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices
from estimation.tracking.imm import Bank
from estimation.tracking.pairing import Paired
from estimation.tracking.scan import Scan

_LITTLE = 0.03  # share of a reading's variance that is the track's, up to which it hardly moves it
_KEPT = 1 - 1 / 32  # of what was said before, at each reading: sensors have slow errors
_READINGS = 3  # fewer say nothing
_DOUBT = math.log(1000.0)  # so much is reached once in a thousand right tracks (Ville)
_SIZE = 6  # information (east, both, north) [1/m^2], its vector (2) [1/m], readings


def unheard(tracks: int) -> Array:
    """What (6, n) is said aside of tracks before any such reading."""
    return np.zeros((_SIZE, tracks))


def heard(said: Array, bank: Bank, scan: Scan, pairs: Paired) -> Array:
    """What is said aside after a scan.

    Args:
        said: (6, n) before.
        bank: the n tracks before the scan.
        scan: one report.
        pairs: that are taken for right, at most one a track.
    """
    model = bank.model[:, pairs.track].argmax(axis=0)
    gradient, variance, residual = _readings(bank, scan, pairs, model)
    covariance = bank.covariance[:, :, model, pairs.track]
    mine = np.einsum("rak,abk,rbk->rk", gradient, covariance, gradient)
    faint = (mine <= _LITTLE * variance) & np.isfinite(variance)
    after = said.copy()
    for row in range(len(residual)):
        some = np.flatnonzero(faint[row])
        if some.size:
            off = _own(residual[row, some] / np.sqrt(variance[row, some]))
            east, north = gradient[row, :2][:, some] / np.sqrt(variance[row, some])
            new = [east * east, east * north, north * north, east * off, north * off]
            track = pairs.track[some]
            after[:, track] = after[:, track] * _KEPT + np.stack([*new, np.ones(some.size)])
    return after


def elsewhere(said: Array) -> NDArray[np.bool_]:
    """Which of the tracks (n,) are of nobody, by what is said aside of them (6, n).

    By the logarithm of the ratio of likelihoods: chi^2 / 2 less what two free coordinates cost.
    """
    east, both, north, x, y, readings = said
    least = 1e-9 * (east + north) + 1e-150  # from one side only, one coordinate is not told
    east, north = east + least, north + least
    chi2 = (north * x**2 - 2 * both * x * y + east * y**2) / (east * north - both**2)
    ratio = chi2 / 2 * readings / (readings + 1) - np.log(readings + 1)
    return np.asarray((ratio > _DOUBT) & (readings >= _READINGS), dtype=np.bool_)


def _own(off: Array) -> Array:
    """Residuals (k,) in sigmas, less what all have in common and by their own scatter."""
    own = off - np.median(off)
    own /= max(1.0, math.sqrt(float(np.mean(own**2))))
    return own


def _readings(bank: Bank, scan: Scan, pairs: Paired, model: Indices) -> tuple[Array, Array, Array]:
    """Independent readings of pairs: gradients (rows, 4, k), variances and residuals (rows, k)."""
    found, every = pairs.innovations, np.arange(len(model))
    mean = bank.mean[:, model, pairs.track][:, None]
    offset_s = scan.plots.readings().offset_s[pairs.plot]
    plain = scan.plots.expected(mean, offset_s).gradient[:, :, 0]
    gradient = plain.copy()
    for row, mixing in enumerate(found.mixing[:, :, model, every]):
        gradient[row] += np.einsum("jk,jak->ak", mixing[:row], plain[:row])
    return gradient, found.variance[:, model, every], found.residual[:, model, every]
