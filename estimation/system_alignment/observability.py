"""What the ranges of a path can tell of the constants, and what they cannot, in words.

Measured against the prior: a direction whose sigma the data leave at .9 of the prior's or more is
undetermined. So noise in the dead reckoning, which bends a straight path a little, is no
observability. Source of the cases: Grinyak et al., statements 1 to 3 (the statements hold, the
printed proofs of 1 and 2 do not).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike
from estimation.bordered import factor, normal_equations
from estimation.system_alignment.logs import DeadReckoning, Ranges
from estimation.system_alignment.model import Model
from estimation.system_alignment.parameters import (
    CLOCK_OFFSET,
    WIND,
    Prior,
    offsets_of,
    places_of,
)

_UNDETERMINED = 0.9  # posterior over prior sigma
_WITHIN = 0.95  # cosine to the undetermined directions from which a known motion is one of them
_PART = 0.3  # of the largest share, from which a constant is named


class Direction(NamedTuple):
    """A combination of constants that the data leave as the prior had it.

    Attributes:
        name: in words.
        motion: (7 + 4 J,) of the constants, one prior sigma long.
    """

    name: str
    motion: Array


class Diagnosis(NamedTuple):
    """What a path and its ranges determine.

    Attributes:
        ratios: (T,) posterior over prior sigma of the principal directions, worst first.
        undetermined: one `Direction` for every ratio of .9 or more.
        sentence: the whole in one sentence.
    """

    ratios: Array
    undetermined: tuple[Direction, ...]
    sentence: str


def diagnose(
    path: DeadReckoning, logs: Ranges, prior: Prior, theta: ArrayLike | None = None
) -> Diagnosis:
    """Which combinations of the constants the ranges of this path determine.

    Only geometry and sigmas count, not the values measured, so that a plan can be asked too.

    Args:
        path: flown or planned.
        logs: ranges along it.
        prior: of the constants.
        theta: (7 + 4 J,) where to look; default the prior's mean.
    """
    model = Model(path, logs, prior)
    at = prior.mean if theta is None else np.asarray(theta, dtype=float)
    free = at[prior.free]
    normal = normal_equations(model(model.dead_reckoned(free), free))
    return diagnosis(model, free, factor(normal).information)


def diagnosis(model: Model, free: Array, information: Array) -> Diagnosis:
    """The same from the information (T, T) of the free constants, prior included."""
    root = np.linalg.inv(model.whitener)
    scaled = root.T @ information @ root
    values, axes = np.linalg.eigh((scaled + scaled.T) / 2)  # the prior's share is 1 each
    ratios = 1 / np.sqrt(np.maximum(values, 1))
    hidden = axes[:, ratios >= _UNDETERMINED]
    found = tuple(_named(model, free, hidden, root.astype(float)))
    return Diagnosis(ratios, found, _sentence(ratios, found))


def _named(model: Model, free: Array, hidden: Array, root: Array) -> Iterator[Direction]:
    """One direction after another taken out of the undetermined ones (T, k), known motions first.

    Of a plane of equally undetermined directions any axis is as good: those with a name are better.
    """
    if hidden.shape[1] == 0:
        return
    named = [(n, m[model.free]) for n, m in _motions(model, model.theta(free))]
    scaled = [model.whitener @ motion for _, motion in named]
    lengths = [max(float(np.linalg.norm(motion)), 1e-9) for motion in scaled]
    while hidden.shape[1]:
        within = [
            hidden.T @ motion / length for motion, length in zip(scaled, lengths, strict=True)
        ]
        best = int(np.argmax([np.linalg.norm(part).round(9) for part in within]))
        if np.linalg.norm(within[best]) < _WITHIN:
            break
        yield Direction(named[best][0], _full(model, named[best][1] / lengths[best]))
        hidden = _without(hidden, within[best])
    names = [model.prior.names[i] for i in model.free]
    for axis in hidden.T:
        yield Direction(_by_shares(axis, names), _full(model, root @ axis))


def _motions(model: Model, theta: Array) -> Iterator[tuple[str, Array]]:
    """Motions of the constants (7 + 4 J,) that some geometry hides, with their names."""
    path = model.dead_reckoned(theta[model.free])[:, :2]
    start = np.array([*model.path.start_m, model.path.height_m[0]])
    travelled = np.array([*(path[-1] - start[:2]), 0.0])
    places = theta[places_of(theta)]
    for i, place in enumerate(places):
        number = i + 1
        yield f"height of beacon {number}", _of_beacon(theta, i, [0, 0, 1])
        yield f"height of beacon {number} against its offset", _height_against_offset(model, i)
        about = np.cross(travelled, place - start)
        yield f"beacon {number} turned about the track", _of_beacon(theta, i, about)
    for i, place in enumerate(places):
        name = f"beacon {i + 1} moved round the object"
        aside = np.cross([0, 0, 1], place - start)
        yield name, _of_beacon(theta, i, aside)
        yield name, _of_beacon(theta, i, np.cross(place - start, aside))
    yield "the whole picture turned about the start", _whole_turn(model, theta, travelled, start)
    yield "all offsets against the clock offset", _offsets_against_clock(theta)


def _of_beacon(theta: Array, beacon: int, motion: ArrayLike) -> Array:
    """A motion of one beacon's place (3,)."""
    whole = np.zeros_like(theta)
    whole[places_of(theta)[beacon]] = motion
    return whole


def _height_against_offset(model: Model, beacon: int) -> Array:
    """One metre up, and the offset that undoes the mean change of range."""
    mean, free = model.prior.mean, model.free
    logs = model.logs.of(model.logs.beacon == beacon)
    whole = _of_beacon(mean, beacon, [0, 0, 1])
    if len(logs.epoch):
        seen = Model(model.path, logs, model.prior)
        up = whole @ seen.by_theta(seen.dead_reckoned(mean[free]), mean[free]).mean(axis=0)
        whole[offsets_of(mean)[beacon]] = -up
    return whole


def _whole_turn(model: Model, theta: Array, travelled: Array, start: Array) -> Array:
    """Beacons and ground speed turned about the vertical of the start."""
    up = np.array([0.0, 0.0, 1.0])
    where = places_of(theta)
    whole = np.zeros_like(theta)
    whole[where] = np.cross(up, theta[where] - start)
    whole[WIND] = np.cross(up, travelled)[:2] / model.path.time_s[-1]
    return whole


def _offsets_against_clock(theta: Array) -> Array:
    whole = np.zeros_like(theta)
    whole[offsets_of(theta)], whole[CLOCK_OFFSET] = 1, -1
    return whole


def _without(hidden: Array, within: Array) -> Array:
    """The directions (T, k) less the one of coordinates `within` (k,)."""
    axes, _ = np.linalg.qr(np.column_stack([within, np.eye(len(within))]))
    remaining: Array = hidden @ axes[:, 1:]
    return remaining


def _full(model: Model, motion: Array) -> Array:
    """A motion of the free constants among all."""
    whole = np.zeros_like(model.prior.mean)
    whole[model.free] = motion
    return whole


def _by_shares(axis: Array, names: list[str]) -> str:
    """The constants that move most, in prior sigmas."""
    shares = axis**2
    order = np.argsort(-shares)
    parts = [names[i] for i in order if shares[i] > _PART * shares.max()]
    return " together with ".join(parts)


def _sentence(ratios: Array, found: tuple[Direction, ...]) -> str:
    """How many directions are determined, and which are not."""
    if not found:
        return f"all {len(ratios)} constants are determined: {ratios[0]:.2g} of the prior at worst"
    listed = "; ".join(direction.name for direction in found)
    return f"{len(found)} of {len(ratios)} directions are undetermined: {listed}"
