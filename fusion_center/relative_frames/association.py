"""Which target logs of two carriers are of one target: by order, by identity, by coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.frames import rotation_clockwise
from estimation.relative_frame import OwnAxesFrame

from ..sources.sightings import Pair, Sightings
from ..sources.telling import NOTHING_TELLS, Telling
from ..state import Orders


def associate(
    own: Sightings,
    other: Sightings,
    orders: Orders,
    frame: OwnAxesFrame | None,
    gate: float,
    telling: Telling = NOTHING_TELLS,
) -> list[Pair]:
    """One-to-one pairs, the surest kind first; what is paired is out of the later kinds.

    Args:
        other: its places turned into own axes as far as navigation knows, see `registration`.
        frame: where the other carrier's frame lies; None = not known well enough for coordinates.
        gate: chi2 of 2 dof within which coordinates may pair.
        telling: how features tell targets apart.
    """
    forbidden = _Forbidden(own, other, orders)
    pairs = certain(own, other, orders)
    if frame is not None:
        pairs += _by_coordinates(own, other, frame, (gate, telling), forbidden, pairs)
    return pairs


def certain(own: Sightings, other: Sightings, orders: Orders) -> list[Pair]:
    """Pairs that an operator has bound, and those that bear one identity."""
    pairs = _by_order(own, other, orders)
    return pairs + _by_identity(own, other, _Forbidden(own, other, orders), pairs)


def ruled_out(own: Sightings, other: Sightings, orders: Orders) -> set[tuple[int, int]]:
    """Pairs that an operator has forbidden, and those whose identities contradict each other."""
    forbidden = _Forbidden(own, other, orders)
    mine = [i for i, name in enumerate(own.identity) if name]
    theirs = [j for j, name in enumerate(other.identity) if name]
    out = {(i, j) for i in mine for j in theirs if _contradict(own.identity[i], other.identity[j])}
    if orders.forbidden:
        everyone = ((i, j) for i in range(len(own.log)) for j in range(len(other.log)))
        out |= {pair for pair in everyone if forbidden(*pair)}
    return out


class _Forbidden:
    """Pairs that an operator has ruled out."""

    def __init__(self, own: Sightings, other: Sightings, orders: Orders) -> None:
        self._own, self._other = own.track, other.track
        self._pairs = frozenset(orders.forbidden)

    def __call__(self, i: int, j: int) -> bool:
        if not self._pairs:
            return False
        a, b = self._own[i], self._other[j]
        return (min(a, b), max(a, b)) in self._pairs


def _by_order(own: Sightings, other: Sightings, orders: Orders) -> list[Pair]:
    """Pairs that an operator has bound, as far as both tracks are there."""
    at_own = {name: i for i, name in enumerate(own.track) if name}
    at_other = {name: j for j, name in enumerate(other.track) if name}
    pairs: list[Pair] = []
    for a, b in orders.bound:
        i, j = at_own.get(a, at_own.get(b)), at_other.get(b, at_other.get(a))
        if i is not None and j is not None and not _is_taken(pairs, i, j):
            pairs.append(Pair(i, j, "operator"))
    return pairs


def _by_identity(
    own: Sightings, other: Sightings, forbidden: _Forbidden, taken: Sequence[Pair]
) -> list[Pair]:
    """Logs that carry one identity; of several sources of a carrier the best meets the best."""
    by_name: dict[str, list[int]] = {}
    for j in _best_first(other, {pair.other for pair in taken}):
        by_name.setdefault(other.identity[j], []).append(j)
    pairs = []
    for i in _best_first(own, {pair.own for pair in taken}):
        candidates = by_name.get(own.identity[i], [])
        allowed = [j for j in candidates if not forbidden(i, j)]
        if allowed:
            candidates.remove(allowed[0])
            pairs.append(Pair(i, allowed[0], "identity"))
    return pairs


def _best_first(logs: Sightings, taken: set[int]) -> list[int]:
    """Logs with an identity that are still free, the least uncertain first."""
    spread = np.trace(logs.covariance, axis1=1, axis2=2)
    order = np.argsort(spread, kind="stable").tolist()
    return [i for i in order if logs.identity[i] and i not in taken]


def _by_coordinates(
    own: Sightings,
    other: Sightings,
    frame: OwnAxesFrame,
    rules: tuple[float, Telling],
    forbidden: _Forbidden,
    taken: Sequence[Pair],
) -> list[Pair]:
    """The likeliest assignment within the gate, a pair left out being as unlikely as the worst.

    Features make a pair within the gate likelier or less likely, perhaps less than none.

    A log that has been paired takes no part, nor do two logs whose identities of one kind differ.
    """
    gate, telling = rules
    free_own = _free(len(own.log), (pair.own for pair in taken))
    free_other = _free(len(other.log), (pair.other for pair in taken))
    if not (free_own.size and free_other.size):
        return []
    distance2, spread = misclosures(own, other, frame, free_own, free_other)
    possible = distance2 <= gate
    for i, j in zip(*np.nonzero(possible), strict=True):
        a, b = int(free_own[i]), int(free_other[j])
        if forbidden(a, b) or _contradict(own.identity[a], other.identity[b]):
            possible[i, j] = False
    left_out = gate + np.log(spread[possible]).max(initial=0.0)
    by_place = (left_out - distance2 - np.log(spread)) / 2
    told = np.zeros(possible.shape)
    i, j = np.nonzero(possible)
    told[i, j] = telling.log_ratio(own.features, other.features, free_own[i], free_other[j])
    possible &= (by_place + told > 0) | (told == 0)
    from scipy.optimize import linear_sum_assignment  # 0.4 s, kept out of the start

    gain = np.where(possible, np.maximum(by_place + told, 0.0), 0.0)
    chosen = linear_sum_assignment(-gain)
    return [
        Pair(
            int(free_own[i]),
            int(free_other[j]),
            "coordinates",
            float(by_place[i, j]),
            float(told[i, j]),
        )
        for i, j in zip(*chosen, strict=True)
        if possible[i, j]
    ]


def misclosures(
    own: Sightings,
    other: Sightings,
    frame: OwnAxesFrame,
    which_own: NDArray[np.intp],
    which_other: NDArray[np.intp],
) -> tuple[Array, Array]:
    """Normalised squared distances (m, n) of corrected logs, and determinants of their covariance.

    S = C1 + R C2 R' + H P H': both logs' errors and those of the frame (q, D).
    """
    turn = rotation_clockwise(frame.D_rad)
    seen = other.east_north_m[which_other] @ turn.T
    by_frame = np.zeros((len(seen), 2, 3))  # of the misclosure own - q - R other, but for its sign
    by_frame[:, 0, 0] = by_frame[:, 1, 1] = 1.0
    by_frame[:, 0, 2], by_frame[:, 1, 2] = seen[:, 1], -seen[:, 0]
    theirs = turn @ other.covariance[which_other] @ turn.T
    theirs = theirs + by_frame @ frame.covariance @ transposed(by_frame)

    w = own.east_north_m[which_own][:, None] - (frame.q_m + seen)[None, :]
    s = own.covariance[which_own][:, None] + theirs[None, :]
    determinant = s[..., 0, 0] * s[..., 1, 1] - s[..., 0, 1] ** 2
    east, north = w[..., 0], w[..., 1]
    weighted = s[..., 1, 1] * east**2 - 2 * s[..., 0, 1] * east * north + s[..., 0, 0] * north**2
    return weighted / determinant, determinant


def _contradict(a: str, b: str) -> bool:
    """Whether two identities are of one kind and differ."""
    kind_a, _, name_a = a.partition("/")
    kind_b, _, name_b = b.partition("/")
    return bool(name_a and name_b) and kind_a == kind_b and name_a != name_b


def _free(count: int, taken: Iterable[int]) -> NDArray[np.intp]:
    free = np.ones(count, dtype=np.bool_)
    free[list(taken)] = False
    return np.flatnonzero(free)


def _is_taken(pairs: Iterable[Pair], i: int, j: int) -> bool:
    return any(pair.own == i or pair.other == j for pair in pairs)
