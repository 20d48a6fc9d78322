"""How good is a picture? GOSPA, OSPA, the SIAP measures and identity changes, against the truth.

All rest on one assignment: pairs of an object and its estimate closer than a cut-off c, of largest
total c^p - d^p. It minimises GOSPA and OSPA alike, so both come from the same pairs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike, Indices
from estimation.assignment import assignment, neighbours
from estimation.consistency import nees


class Matched(NamedTuple):
    """Objects and the estimates that are taken for them, by increasing object.

    Attributes:
        truth: (k,) rows of the objects.
        estimate: (k,) rows of the estimates.
        distance: (k,) between them.
    """

    truth: Indices
    estimate: Indices
    distance: Array


class Gospa(NamedTuple):
    """GOSPA of one instant, or of many as columns; the parts add up in the p-th power.

    Attributes:
        distance: (localisation^p + missed^p + false^p)^(1/p), in the unit of the places.
        localisation: of the matched; missed: of objects without an estimate; false: of estimates
            without an object.
        missed_count, false_count: how many those are.
    """

    distance: Array
    localisation: Array
    missed: Array
    false: Array
    missed_count: Indices
    false_count: Indices


class Ospa(NamedTuple):
    """OSPA of one instant: distance = (localisation^p + cardinality^p)^(1/p)."""

    distance: float
    localisation: float
    cardinality: float


class Picture(NamedTuple):
    """Objects, or tracks, over time as columns: a row says where one of them is at one instant.

    Attributes:
        step: (n,) the instant; any numbers that the truth and the tracks have in common.
        identity: (n,) which object or track; unique within an instant, kept over time.
        place: (n, d).
    """

    step: NDArray[Any]
    identity: NDArray[Any]
    place: Array


class Siap(NamedTuple):
    """Measures of a single integrated air picture over a run.

    Attributes:
        completeness: share of the objects' instants at which they have a track; 1 is ideal.
        ambiguity: tracks near a tracked object, by tracked objects; 1 is ideal.
        spuriousness: share of the tracks' instants at which they are near no object.
        accuracy: mean distance of the matched, in the unit of the places.
        identity_changes: how often an object's track is another than the last one it had.
        longest: share of the objects' instants covered by the track that holds each longest.
    """

    completeness: float
    ambiguity: float
    spuriousness: float
    accuracy: float
    identity_changes: int
    longest: float


def matched(truth: ArrayLike, estimate: ArrayLike, c: float, p: float = 2.0) -> Matched:
    """The best one-to-one assignment of places (n, d) and (m, d) closer than `c`.

    Raises:
        ValueError: c is not positive, p is below 1, or a place is not finite.
    """
    if not (c > 0 and p >= 1):
        raise ValueError(f"need a cut-off c > 0 and an order p >= 1: got c {c}, p {p}")
    objects, found = _places(truth), _places(estimate)
    i, j = neighbours(objects, found, c)
    distance = np.asarray(np.linalg.norm(objects[i] - found[j], axis=-1), dtype=float)
    chosen = assignment(i, j, 1.0 - (distance / c) ** p)
    return Matched(i[chosen], j[chosen], distance[chosen])


def gospa(truth: ArrayLike, estimate: ArrayLike, c: float, p: float = 2.0) -> Gospa:
    """Generalised optimal sub-pattern assignment metric with alpha = 2, and its parts.

    Args:
        truth: (n, d) places of the objects; n = 0 and m = 0 are allowed.
        estimate: (m, d) places claimed.
        c: the cut-off; an object missed or an estimate too many costs c^p / 2.
        p: the order.

    Raises:
        ValueError: as `matched`.

    Source: Rahmathullah, Garcia-Fernandez & Svensson, Generalized optimal sub-pattern assignment
    metric, FUSION 2017, proposition 1.
    """
    pairs = matched(truth, estimate, c, p)
    missed = np.array(len(_places(truth)) - len(pairs.truth))
    false = np.array(len(_places(estimate)) - len(pairs.truth))
    return _gospa(np.sum(pairs.distance**p), missed, false, c, p)


def gospa_over_time(truth: Picture, tracks: Picture, c: float, p: float = 2.0) -> Gospa:
    """GOSPA of every instant of the truth or the tracks, (T,) each, by increasing step.

    Raises:
        ValueError: as `matched`.
    """
    pairs = matched_over_time(truth, tracks, c, p)
    steps = np.union1d(truth.step, tracks.step)
    at = np.searchsorted(steps, truth.step)
    held = at[pairs.truth]
    power = np.bincount(held, pairs.distance**p, minlength=len(steps))
    number = np.bincount(held, minlength=len(steps))
    missed = np.bincount(at, minlength=len(steps)) - number
    found = np.bincount(np.searchsorted(steps, tracks.step), minlength=len(steps))
    return _gospa(power, missed, found - number, c, p)


def ospa(truth: ArrayLike, estimate: ArrayLike, c: float, p: float = 2.0) -> Ospa:
    """Optimal sub-pattern assignment metric: mean error per object of the larger set, at most c.

    Args:
        truth, estimate, c, p: as `gospa`.

    Raises:
        ValueError: as `matched`.

    Source: Schuhmacher, Vo & Vo, A consistent metric for performance evaluation of multi-object
    filters, IEEE Trans. SP 56(8), 2008, eqs 3 and 4.
    """
    pairs = matched(truth, estimate, c, p)
    fewer, more = sorted((len(_places(truth)), len(_places(estimate))))
    far = fewer - len(pairs.truth)
    apart = (np.sum(pairs.distance**p) + far * c**p) / max(more, 1)
    unequal = (more - fewer) * c**p / max(more, 1)
    roots = (float(part ** (1 / p)) for part in (apart + unequal, apart, unequal))
    return Ospa(*roots)


def matched_over_time(truth: Picture, tracks: Picture, c: float, p: float = 2.0) -> Matched:
    """The best assignment of every instant at once: rows of the two pictures.

    Raises:
        ValueError: as `matched`.
    """
    steps = np.union1d(truth.step, tracks.step)
    return matched(_apart(truth, steps, c), _apart(tracks, steps, c), c, p)


def siap(truth: Picture, tracks: Picture, c: float, p: float = 2.0) -> Siap:
    """The SIAP measures of a run; what has no denominator is nan.

    Args:
        truth: the objects.
        tracks: what is claimed of them.
        c: how near an object a track must be to be its; the assignment is that of `gospa`.
        p: its order.

    Raises:
        ValueError: as `matched`.

    Source: Votruba, Nisley, Rothrock & Zombro, Single integrated air picture (SIAP) metrics
    implementation, 2001; there a track may be given to several objects, here it counts once.
    """
    pairs = matched_over_time(truth, tracks, c, p)
    steps = np.union1d(truth.step, tracks.step)
    _, near = neighbours(_apart(truth, steps, c), _apart(tracks, steps, c), c)
    owner, held = truth.identity[pairs.truth], tracks.identity[pairs.estimate]
    return Siap(
        completeness=_share(len(pairs.truth), len(truth.step)),
        ambiguity=_share(len(np.unique(near)), len(pairs.truth)),
        spuriousness=1.0 - _share(len(np.unique(near)), len(tracks.step)),
        accuracy=_share(float(pairs.distance.sum()), len(pairs.truth)),
        identity_changes=identity_changes(truth.step[pairs.truth], owner, held),
        longest=_share(_longest(owner, held), len(truth.step)),
    )


def identity_changes(step: NDArray[Any], identity: NDArray[Any], track: NDArray[Any]) -> int:
    """How often objects are held by another track than the last that held them.

    Args:
        step: (k,) instants, in any order.
        identity: (k,) of the object held then; track: (k,) that held it.
    """
    order = np.lexsort((step, np.unique(identity, return_inverse=True)[1]))
    same = identity[order][1:] == identity[order][:-1]
    return int(np.sum(same & (track[order][1:] != track[order][:-1])))


def matched_nees(truth: ArrayLike, estimate: ArrayLike, covariance: Array, pairs: Matched) -> Array:
    """NEES (k,) of the matched: states (n, d) against estimates (m, d) with covariances (m, d, d).

    Whether their mean is honest: `estimation.consistency.mean_interval`.
    """
    states, found = np.asarray(truth, dtype=float), np.asarray(estimate, dtype=float)
    return nees(found[pairs.estimate] - states[pairs.truth], covariance[pairs.estimate])


def _places(points: ArrayLike) -> Array:
    """Finite places (n, d); an empty list has none."""
    places = np.asarray(points, dtype=float)
    places = places.reshape(0, 1) if places.size == 0 else places
    if places.ndim != 2 or not np.isfinite(places).all():
        raise ValueError(f"need finite places of shape (n, d): got shape {places.shape}")
    return places


def _gospa(power: ArrayLike, missed: Indices, false: Indices, c: float, p: float) -> Gospa:
    parts = np.stack([np.asarray(power, dtype=float), missed * c**p / 2, false * c**p / 2])
    whole = np.asarray(parts.sum(axis=0) ** (1 / p), dtype=float)
    apart, too_few, too_many = parts ** (1 / p)
    return Gospa(whole, apart, too_few, too_many, missed, false)


def _apart(picture: Picture, steps: NDArray[Any], c: float) -> Array:
    """Places with the instant as one more dimension, instants farther apart than the cut-off."""
    moved = 2.0 * c * np.searchsorted(steps, picture.step)
    return np.column_stack([picture.place, moved])


def _longest(identity: NDArray[Any], track: NDArray[Any]) -> int:
    """Sum over objects of the number of instants that the commonest track of each held it."""
    if not len(identity):
        return 0
    objects, i = np.unique(identity, return_inverse=True)
    _, j = np.unique(track, return_inverse=True)
    both, count = np.unique(np.column_stack([i, j]), axis=0, return_counts=True)
    most = np.zeros(len(objects), dtype=np.intp)
    np.maximum.at(most, both[:, 0], count)
    return int(most.sum())


def _share(part: float, whole: float) -> float:
    return part / whole if whole else float("nan")
