"""Which nameless target of another carrier is which of the own one's.

Every attempt at a frame first asks of all targets that nothing joins yet which two may be one
(`log_odds_of_one`), the frame being in doubt as navigation says. A pair counts when it has been
found several times in a row, likely by itself and far likelier than any other pair of either, and
it counts until its bearings end or speak against it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only import log_odds_of_one

from ..relative_frames import corrections
from ..state import Paired, Rays, State
from .common_targets import (
    MOTIONS,
    carriers_in,
    carriers_of,
    has_manoeuvred,
    prior_of,
    wide_prior,
)
from .naming import AGREED, is_nameless
from .windows import Sides, scene_of

WINDOW_S = 300.0
"""Of bearings: long enough to tell targets apart, and short enough for turns to be smooth in."""
LEAST_NATS, AHEAD_NATS = -3.0, 4.6
"""How likely a pair must be against two targets (one in twenty), and against any other pair."""
HOPELESS_NATS = -30.0
"""A pair that is so much less likely than two targets is given up."""


def candidates(state: State, name: str, t_ns: int) -> Sides:
    """Targets of both that nothing joins and that may be one; none where all have names."""
    joined = _joined(state, name, t_ns)
    mine, theirs = (_lately_seen(state, carrier, t_ns) for carrier in (state.own, name))
    shared = {target for target in theirs if target in mine and not is_nameless(target)}
    own = {t: r for t, r in mine.items() if t not in shared and t not in joined.values()}
    other = {t: r for t, r in theirs.items() if t not in shared and t not in joined}
    if not any(map(is_nameless, (*own, *other))):
        return Sides({}, {})
    return Sides(own, other)


def _joined(state: State, name: str, t_ns: int) -> dict[str, str]:
    """The own targets of those of a carrier, of pairs that count and whose both are seen."""
    settled = {
        key.partition("/")[2]: paired.target
        for key, paired in state.paired.items()
        if key.partition("/")[0] == name and paired.agreed >= AGREED
    }
    oldest = t_ns - round(state.settings.passive.shown_s * 1e9)
    return {
        called: target
        for called, target in settled.items()
        if min(_newest(state, f"{name}/{called}"), _newest(state, f"{state.own}/{target}"))
        >= oldest
    }


def _newest(state: State, key: str) -> int:
    rays = state.rays.get(key)
    return int(rays.t_ns[-1]) if rays is not None else -1


def _lately_seen(state: State, carrier: str, t_ns: int) -> dict[str, Rays]:
    """Targets of which a carrier has enough bearings and a new one, the most seen first."""
    settings = state.settings.passive
    oldest, silent = (t_ns - round(s * 1e9) for s in (WINDOW_S, settings.shown_s))
    found = {
        key.partition("/")[2]: (int((rays.t_ns >= oldest).sum()), rays)
        for key, rays in state.rays.items()
        if key.partition("/")[0] == carrier and rays.t_ns[-1] >= silent
    }
    enough = [target for target, (n, _) in found.items() if n >= settings.least_bearings]
    enough.sort(key=lambda target: (-found[target][0], target))
    return {target: found[target][1] for target in enough[: settings.frames_most_targets]}


def with_pairs(state: State, name: str, t_ns: int) -> State:
    """The state with the pairs of the own carrier and another judged anew.

    Of pairs whose bearings have ended nothing more is asked, until they are too old.
    """
    joined = _joined(state, name, t_ns)
    kept = {
        key: paired
        for key, paired in state.paired.items()
        if key.partition("/")[0] != name or _has_ended(state, key, joined, t_ns)
    }
    try:
        with np.errstate(all="ignore"):  # numbers from the wire may be anything in bounds
            found = _found(state, name, t_ns) | _still(state, name, t_ns, joined)
    except (np.linalg.LinAlgError, ValueError):
        return state
    fresh = {f"{name}/{k}": _again(state, f"{name}/{k}", t) for k, t in found.items()}
    return replace(state, paired={**kept, **fresh}) if kept | fresh != state.paired else state


def _has_ended(state: State, key: str, joined: Mapping[str, str], t_ns: int) -> bool:
    """Whether a pair counts though no bearings come any more, and they are not too old."""
    oldest = t_ns - round(state.settings.passive.frames_memory_s * 1e9)
    silent = state.paired[key].agreed >= AGREED and key.partition("/")[2] not in joined
    return silent and _newest(state, key) >= oldest


def _again(state: State, key: str, target: str) -> Paired:
    """A pair that is found, once more or for the first time."""
    before = state.paired.get(key)
    if before is None or before.target != target:
        return Paired(target=target)
    return replace(before, agreed=min(before.agreed + 1, AGREED))


def _found(state: State, name: str, t_ns: int) -> dict[str, str]:
    """Pairs of targets that nothing joins yet, each far likelier than any other of its two."""
    some = candidates(state, name, t_ns)
    if not some:
        return {}
    i, j = np.divmod(np.arange(len(some.own) * len(some.other)), len(some.other))
    own, other = list(some.own), list(some.other)
    anonymous = [np.array([is_nameless(target) for target in side]) for side in (own, other)]
    may = anonymous[0][i] | anonymous[1][j]
    odds = _log_odds(state, name, t_ns, some, (i[may], j[may]))
    if odds is None:
        return {}
    table = np.full((len(some.own), len(some.other)), -np.inf)
    table[i[may], j[may]] = odds
    return {other[b]: own[a] for a, b in _sure(table)}


def _sure(table: Array) -> list[tuple[int, int]]:
    """Rows and columns of the pairs that stand out."""
    pairs = []
    for a, b in zip(*np.nonzero(table >= LEAST_NATS), strict=True):
        rivals = np.concatenate([np.delete(table[a], b), np.delete(table[:, b], a)])
        if table[a, b] - max(rivals, default=-np.inf) >= AHEAD_NATS:
            pairs.append((int(a), int(b)))
    return pairs


def _still(state: State, name: str, t_ns: int, joined: Mapping[str, str]) -> dict[str, str]:
    """Of pairs that count, those that are not hopeless."""
    if not joined:
        return {}
    each = np.arange(len(joined))
    sides = Sides(
        {
            f"{target} {called}": state.rays[f"{state.own}/{target}"]
            for called, target in joined.items()
        },
        {called: state.rays[f"{name}/{called}"] for called in joined},
    )
    odds = _log_odds(state, name, t_ns, sides, (each, each))
    if odds is None:
        return dict(joined)
    return {
        called: joined[called] for called, o in zip(joined, odds, strict=True) if o > HOPELESS_NATS
    }


def _log_odds(
    state: State,
    name: str,
    t_ns: int,
    targets: Sides,
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> Array | None:
    """Ln of how much likelier each pair is one target than two; None where all would be alike.

    A frame that is applied is held where it is, as surely as it is known. Else it is open, and
    nothing tells pairs apart before a manoeuvre.
    """
    scene = scene_of(state, name, t_ns, targets, WINDOW_S)
    link = state.links[name]
    if link.monitor.state == "applied" and link.estimate is not None:
        frame = corrections.at(link.estimate, scene.prior)
        return log_odds_of_one(*carriers_in(scene, frame), prior_of(frame), MOTIONS, pairs)
    if not has_manoeuvred(scene):
        return None
    return log_odds_of_one(*carriers_of(scene, 0.0), wide_prior(scene), MOTIONS, pairs)
