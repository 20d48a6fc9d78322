"""Which logs of two sides are of one target: coordinates, features and their common error jointly.

A side is a picture, a carrier or a source, its logs already in a common frame. What a correction of
a carrier's frame leaves is one error shared by all its logs: it is a nuisance, integrated out, and
never taken for noise of each log. What one pair says of it, all other pairs know.

Source: Klimov, paper 002, eqs 1 to 3 (`estimation.association_rules` has the paper's own rule); for
the likelihood ratio of two tracks: Bar-Shalom & Chen, Multisensor track-to-track association for
tracks with dependent errors, CDC 2004.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices, transposed
from estimation.assignment import assignment, neighbours, pair_probabilities
from estimation.relative_frame.matrices import inverse, solved, times

_GATE_SIGMAS = 4.5  # of a misclosure: of right pairs 1 in 25 000 lies outside it in a plane
_PASSES, _SETTLED = 20, 1e-3
_STARTS = 48  # values of a large common error that are tried
_LARGEST = 300.0  # of a log ratio, so that its exponential is finite
_LEAST = 1e-12  # variance in any direction, by the total: two flat ellipses may be parallel
_OCTAVE = 2.0  # sides of logs searched together have sigmas within such a factor


class Side(NamedTuple):
    """Places of one side's logs, as columns.

    Attributes:
        place_m: (n, d).
        covariance: (n, d, d) of each log by itself, independent of all others.
        by_common: (n, d, k) derivative of the place by the common error; None = it has none.
    """

    place_m: Array
    covariance: Array
    by_common: Array | None = None


class Population(NamedTuple):
    """How many targets there are [per unit of place], by who sees them; clutter is alone."""

    both: float
    own_alone: float
    other_alone: float


class Candidates(NamedTuple):
    """Pairs near enough to be one target, and the misclosures own - other.

    Attributes:
        own, other: (K,) rows.
        misclosure_m: (K, d); covariance: (K, d, d) of both logs' own errors.
        by_common: (K, d, k) derivative of the misclosure by the common error.
    """

    own: Indices
    other: Indices
    misclosure_m: Array
    covariance: Array
    by_common: Array


class Association(NamedTuple):
    """The best one-to-one pairs, and how sure they are.

    Attributes:
        own, other: (k,) rows, by increasing own row.
        log_ratio: (k,) ln p(one target) / p(two targets), all others as they are.
        probability: (k,) of each pair over all ways to pair.
        common: (c,) the common error that the pairs show, with its covariance (c, c).
        candidates: (K,) how many pairs were near enough.
        status: `paired`, or why nothing could be.
    """

    own: Indices
    other: Indices
    log_ratio: Array
    probability: Array
    common: Array
    common_covariance: Array
    candidates: int
    status: str


class _Parts(NamedTuple):
    """What each candidate says of the common error: G' S^-1 w (K, c) and G' S^-1 G (K, c, c)."""

    vector: Array
    matrix: Array


def population(own: int, other: int, extent: float, seen_by_both: float) -> Population:
    """Densities from the numbers of logs on a common area (or volume) of that extent.

    Args:
        seen_by_both: share of the targets that both sides have a log of, within (0, 1).
    """
    total = (own + other) / (1.0 + seen_by_both) / extent
    alone = (1.0 - seen_by_both) * total / 2
    return Population(seen_by_both * total, alone, alone)


def candidates(
    own: Side, other: Side, common: Array, gate_sigmas: float = _GATE_SIGMAS
) -> Candidates:
    """Pairs whose misclosure is within the gate of its covariance, the common error included.

    Args:
        common: (k, k) covariance of the common error; k = 0 where there is none.
        gate_sigmas: half axes of the gate, in sigmas.
    """
    i, j = _near(own, other, common, gate_sigmas)
    pairs = _misclosures(own, other, i, j, len(common))
    inside = _squares(pairs.misclosure_m, _whole(pairs, common))[0] <= gate_sigmas**2
    return _misclosures(own, other, i[inside], j[inside], len(common))


def coordinate_log_ratio(pairs: Candidates, common: Array, of: Population) -> Array:
    """Log of p(one target) / p(two targets), each pair by itself: S = R1 + R2 + G P G'.

    Args:
        pairs: K of them.
        common: (k, k) covariance of the common error.
        of: densities of the targets.
    """
    return _log_density(pairs.misclosure_m, _whole(pairs, common)) + _log_prior(of)


def associate(pairs: Candidates, common: Array, of: Population, features: Array) -> Association:
    """The best pairs, the common error integrated out.

    Each pair is judged by what all the others say of the common error, weighed by how sure they
    are; the weights and the error settle together.

    Args:
        pairs: K candidates.
        common: (c, c) prior covariance of the common error; c = 0 where there is none.
        of: densities of the targets.
        features: (K,) log-likelihood ratio of the features of each pair; 0 = none.
    """
    if not len(pairs.own):
        return _nothing(common)
    prior = features + _log_prior(of)
    ratio = prior + _first(pairs, common, prior)
    probability = pair_probabilities(pairs.own, pairs.other, ratio)
    parts = _parts(pairs)
    for _ in range(_PASSES):
        ratio = prior + _predictive(pairs, parts, common, probability)
        before, probability = probability, pair_probabilities(pairs.own, pairs.other, ratio)
        if np.abs(probability - before).max() < _SETTLED:
            break
    return _decided(pairs, parts, common, ratio, probability)


def _decided(
    pairs: Candidates, parts: _Parts, common: Array, ratio: Array, probability: Array
) -> Association:
    chosen = assignment(pairs.own, pairs.other, ratio)
    covariance = _posterior(common, np.tensordot(probability, parts.matrix, 1))
    return Association(
        own=pairs.own[chosen],
        other=pairs.other[chosen],
        log_ratio=ratio[chosen],
        probability=probability[chosen],
        common=covariance @ (probability @ parts.vector),
        common_covariance=covariance,
        candidates=len(ratio),
        status="paired" if chosen.size else "no pair is likelier one target than two",
    )


def _first(pairs: Candidates, common: Array, prior: Array) -> Array:
    """Log density of each misclosure to begin with.

    A common error larger than the logs' own makes many a wrong pair likely: then the one pair is
    sought with which most others agree, and all begin with what that pair says.
    """
    density = _log_density(pairs.misclosure_m, _whole(pairs, common))
    by_common = pairs.by_common @ common @ transposed(pairs.by_common)
    if np.median(_traces(by_common)) < np.median(_traces(pairs.covariance)):
        return density
    tried = np.argsort(-density - prior, kind="stable")
    tried = tried[:: max(len(tried) // _STARTS, 1)]
    said = [_said_by(pairs, common, int(which)) for which in tried]
    agreed = [_agreement(pairs.own, prior + log_density, pull) for log_density, pull in said]
    return said[int(np.argmax(agreed))][0]


def _said_by(pairs: Candidates, common: Array, which: int) -> tuple[Array, float]:
    """Log density of all misclosures if one pair is right, and how unlikely that pair is."""
    g, w = pairs.by_common[which], pairs.misclosure_m[which]
    gain = common @ g.T @ inverse(pairs.covariance[which] + g @ common @ g.T)
    spread = common - gain @ g @ common
    left = pairs.misclosure_m - times(pairs.by_common, gain @ w)
    pull = g.T @ np.linalg.solve(pairs.covariance[which] + g @ common @ g.T, w)
    return _log_density(left, _whole(pairs, spread)), float(pull @ common @ pull)


def _agreement(own: Indices, ratio: Array, unlikely: float) -> float:
    """Log of how well all logs of one side find a partner each, partners used twice or not."""
    _, i = np.unique(own, return_inverse=True)
    found = np.log1p(np.bincount(i, np.exp(np.minimum(ratio, _LARGEST))))
    return float(found.sum()) - unlikely / 2


def _traces(matrices: Array) -> Array:
    return np.asarray(np.trace(matrices, axis1=-2, axis2=-1), dtype=float)


def _parts(pairs: Candidates) -> _Parts:
    gained = transposed(solved(pairs.covariance, pairs.by_common))
    return _Parts(times(gained, pairs.misclosure_m), gained @ pairs.by_common)


def _posterior(common: Array, matrix: Array) -> Array:
    """Covariance (..., c, c) after information; of a prior that may be singular."""
    after: Array = common @ inverse(np.eye(len(common)) + matrix @ common)
    return (after + transposed(after)) / 2


def _predictive(pairs: Candidates, parts: _Parts, common: Array, probability: Array) -> Array:
    """Log density of each misclosure given what all other pairs say of the common error."""
    share = probability[:, None]
    others = np.tensordot(probability, parts.matrix, 1) - share[..., None] * parts.matrix
    spread = _posterior(common, others)
    mean = times(spread, probability @ parts.vector - share * parts.vector)
    left = pairs.misclosure_m - times(pairs.by_common, mean)
    return _log_density(left, _whole(pairs, spread))


def _whole(pairs: Candidates, common: Array) -> Array:
    """Covariance of the misclosures, the common error's (c, c) or (K, c, c) included."""
    whole: Array = pairs.covariance + pairs.by_common @ common @ transposed(pairs.by_common)
    return whole


def _nothing(common: Array) -> Association:
    none, empty = np.empty(0, dtype=np.intp), np.empty(0)
    nowhere = "no two logs are near enough to be one target"
    return Association(none, none, empty, empty, np.zeros(len(common)), common, 0, nowhere)


def _misclosures(own: Side, other: Side, i: Indices, j: Indices, size: int) -> Candidates:
    covariance = own.covariance[i] + other.covariance[j]
    least = _LEAST * _traces(covariance)[:, None, None]
    covariance = covariance + least * np.eye(own.place_m.shape[1])
    by_common = np.zeros((*covariance.shape[:2], size))
    if own.by_common is not None:
        by_common += own.by_common[i]
    if other.by_common is not None:
        by_common -= other.by_common[j]
    return Candidates(i, j, own.place_m[i] - other.place_m[j], covariance, by_common)


def _semi_axis(side: Side, common: Array) -> Array:
    """Largest sigma (n,) of each place in any direction; a bound that needs no eigenvalues."""
    whole = side.covariance
    if side.by_common is not None:
        whole = whole + side.by_common @ common @ transposed(side.by_common)
    return np.asarray(np.sqrt(_traces(whole)), dtype=float)


def _near(own: Side, other: Side, common: Array, sigmas: float) -> tuple[Indices, Indices]:
    """Pairs within the gate of a circle round each, logs of like sigma searched together."""
    own_sigma, other_sigma = _semi_axis(own, common), _semi_axis(other, common)
    rows, columns = [np.empty(0, dtype=np.intp)], [np.empty(0, dtype=np.intp)]
    for a in _octaves(own_sigma):
        for b in _octaves(other_sigma):
            radius = sigmas * float(np.hypot(own_sigma[a].max(), other_sigma[b].max()))
            i, j = neighbours(own.place_m[a], other.place_m[b], radius)
            rows.append(a[i])
            columns.append(b[j])
    i, j = np.concatenate(rows), np.concatenate(columns)
    order = np.lexsort((j, i))
    return i[order], j[order]


def _octaves(sigma: Array) -> list[Indices]:
    """Rows whose sigmas are within a factor of each other; those without a finite one are out."""
    finite = np.flatnonzero(np.isfinite(sigma) & (sigma > 0))
    octave = np.floor(np.log(sigma[finite]) / np.log(_OCTAVE))
    return [finite[octave == value] for value in np.unique(octave)]


def _squares(vectors: Array, covariance: Array) -> tuple[Array, Array]:
    """Normalised squares (K,) of vectors (K, d), and log determinants of their covariances."""
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, vectors[..., None])[..., 0]
    diagonal = np.diagonal(factor, axis1=-2, axis2=-1)
    return np.sum(white**2, axis=-1), 2.0 * np.sum(np.log(diagonal), axis=-1)


def _log_density(vectors: Array, covariance: Array) -> Array:
    squares, determinant = _squares(vectors, covariance)
    return np.asarray(-0.5 * (squares + determinant + vectors.shape[-1] * np.log(2 * np.pi)))


def _log_prior(of: Population) -> float:
    """Log of the density of common targets over those that each side would have alone."""
    return float(np.log(of.both) - np.log(of.own_alone) - np.log(of.other_alone))
