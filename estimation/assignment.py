"""The best one-to-one pairs among sparse candidates: thousands of objects, few rivals each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching
from scipy.spatial import cKDTree

from estimation.arrays import Array, ArrayLike, Indices

_BATCH = 2000  # candidates solved together: the solver's time grows with rows squared
_PASSES, _SETTLED = 50, 1e-4
_LARGEST = 300.0  # of a log ratio, so that its exponential is finite


def neighbours(first: ArrayLike, second: ArrayLike, radius: float) -> tuple[Indices, Indices]:
    """Which of the points (n, d) and (m, d) lie within `radius` of each other, by (first, second).

    Points that are not finite have no neighbours.
    """
    a, b = (np.asarray(points, dtype=float) for points in (first, second))
    at_a, at_b = (np.flatnonzero(np.isfinite(points).all(axis=-1)) for points in (a, b))
    if not (at_a.size and at_b.size):
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    found = cKDTree(a[at_a]).sparse_distance_matrix(cKDTree(b[at_b]), radius, output_type="ndarray")
    i, j = at_a[found["i"]], at_b[found["j"]]
    order = np.lexsort((j, i))
    return i[order], j[order]


def assignment(first: Indices, second: Indices, gain: Array) -> Indices:
    """Which candidates make the one-to-one set of largest total gain, by increasing index.

    Candidates fall into groups that share no object; each group is solved by itself, so that the
    time grows with the number of objects and not with its cube.

    Args:
        first: (K,) one side of each candidate, no pair twice.
        second: (K,) the other side.
        gain: (K,) what it is worth to pair them; what gains nothing (<= 0) stays alone.
    """
    useful = np.flatnonzero(gain > 0)
    if not useful.size:
        return useful
    group = _groups(first[useful], second[useful])
    size = np.bincount(group)[group]
    chosen = [useful[size == 1]]
    for batch in _batches(group[size > 1]):
        rivals = useful[size > 1][batch]
        chosen.append(rivals[_solved(first[rivals], second[rivals], gain[rivals])])
    return np.sort(np.concatenate(chosen))


def pair_probabilities(first: Indices, second: Indices, log_ratio: Array) -> Array:
    """The probability (K,) of each candidate, over all one-to-one sets of them.

    Bethe's approximation by belief propagation: exact where the candidates form no loops.

    Args:
        first, second: (K,) as of `assignment`.
        log_ratio: (K,) ln p(they are one) / p(both stand alone).

    Source: Williams & Lau, Approximate evaluation of marginal association probabilities with
    belief propagation, IEEE Trans. AES 50(4), 2014, eqs 30 and 31.
    """
    psi = np.exp(np.clip(log_ratio, -_LARGEST, _LARGEST))
    probability = np.asarray(psi / (1.0 + psi), dtype=float)
    _, i = np.unique(first, return_inverse=True)
    _, j = np.unique(second, return_inverse=True)
    rivals = np.flatnonzero((np.bincount(i)[i] > 1) | (np.bincount(j)[j] > 1))
    if rivals.size:
        probability[rivals] = _propagated(i[rivals], j[rivals], psi[rivals])
    return probability


def _propagated(i: Indices, j: Indices, psi: Array) -> Array:
    """Probabilities (K,) of candidates that have rivals, by messages until they settle."""
    nu = np.ones_like(psi)
    for _ in range(_PASSES):
        mu = psi / (1.0 + _others(i, psi * nu))
        before, nu = nu, 1.0 / (1.0 + _others(j, mu))
        if np.abs(nu - before).max() < _SETTLED:
            break
    weighed = psi * nu
    return np.asarray(weighed / (1.0 + np.bincount(i, weighed)[i]), dtype=float)


def _others(owner: Indices, message: Array) -> Array:
    """Sum of the messages of the same owner but for one's own."""
    return np.maximum(np.bincount(owner, message)[owner] - message, 0.0)


def _groups(first: Indices, second: Indices) -> Indices:
    """The group of each candidate: those that share an object, directly or through others."""
    _, i = np.unique(first, return_inverse=True)
    _, j = np.unique(second, return_inverse=True)
    count = int(i.max() + j.max() + 2)
    links = coo_array((np.ones(len(i)), (i, j + i.max() + 1)), shape=(count, count))
    _, label = connected_components(links, directed=False)
    return np.asarray(label[i], dtype=np.intp)


def _batches(group: Indices) -> Iterator[Indices]:
    """Candidates of whole groups, some `_BATCH` at a time."""
    if not group.size:
        return
    order = np.argsort(group, kind="stable")
    begins = np.searchsorted(group[order], group[order])
    yield from np.split(order, np.flatnonzero(np.diff(begins // _BATCH)) + 1)


def _solved(first: Indices, second: Indices, gain: Array) -> Indices:
    """The best set in one batch: everyone of the first side may also take a place of its own."""
    rows, i = np.unique(first, return_inverse=True)
    columns, j = np.unique(second, return_inverse=True)
    n, m = len(rows), len(columns)
    dearest = 2.0 * gain.max()  # a zero would be no edge at all
    weight = np.concatenate([dearest - gain, np.full(n, dearest)])
    alone = np.arange(n)
    ends = np.concatenate([i, alone]), np.concatenate([j, m + alone])
    _, column = min_weight_full_bipartite_matching(csr_array((weight, ends), shape=(n, m + n)))
    return np.flatnonzero(column[i] == j)
