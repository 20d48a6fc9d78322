"""Links whose ranges are wrong by the same amount from the first one on.

Such a link looks right to itself: its ranges agree with each other, and no single one is far off.
So each link has a block `link/...` of one slot, by how much its ranges are too long. It is none to
`_SPIKE_M`, or else anything to `_SLAB_M`, which one link in a thousand is. A filter that has the
narrow prior holds all that the data say of the error: its information and its score. With them the
wide prior can be put in the place of the narrow one at any time, exactly as far as the state is
linear, and their evidence compared (a two-stage filter, Friedland 1969; a likelihood ratio of an
error from the start on, Willsky & Jones 1976).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimation.arrays import Array
from estimation.joint_navigation.online import Joint, joined, place_among_free
from estimation.joint_navigation.online_rows import LINK, Range, link_of

_SPIKE_M = 0.03
_SLAB_M = 200.0
_SHARE = 1e-3  # of links that are wrong, before anything is known of them
_DOUBT = 0.5  # probability that any link is wrong, from which the likely ones are released
_LIKELY = 0.02  # of the wrong one to be this, given there is one: it is released
_MOST = 100  # links of a group that are watched; further ones are taken for right


def with_links(joint: Joint, ranges: Sequence[Range]) -> Joint:
    """A group that knows the links of these ranges."""
    watched = sum(name.startswith(LINK) for name in joint.names)
    for name in dict.fromkeys(map(link_of, ranges)):
        if name not in joint.names and watched < _MOST:
            nothing = np.zeros((1, len(joint.mean)))
            joint = joined(joint, name, np.zeros(1), nothing, np.array([[_SPIKE_M**2]]))
            watched += 1
    return joint


def links_of(joint: Joint, carrier: str) -> list[str]:
    """Blocks of the links that a carrier is an end of."""
    named = [name for name in joint.names if name.startswith(LINK)]
    return [name for name in named if carrier in name.removeprefix(LINK).split("|")]


def errors(joint: Joint) -> dict[str, tuple[float, float]]:
    """By how much the ranges of released links are too long, and the sigma of that [m]."""
    found = {}
    for name in joint.names:
        if name.startswith(LINK):
            slot = joint.first(name)
            sigma = float(np.sqrt(joint.of([slot])[0, 0]))
            if sigma > _SPIKE_M:
                found[name] = float(joint.mean[slot]), sigma
    return found


def released(joint: Joint) -> Joint:
    """A group in which links that are likely to be wrong have an error to be found.

    Which of several that contradict each other it is need not be known: all that are likely are
    released, and the covariance says what the rest can tell.
    """
    while True:
        names, odds = _odds(joint)
        if not names or odds.sum() / (1 + odds.sum()) < _DOUBT:
            return joint
        for i in np.flatnonzero(odds >= _LIKELY * odds.sum()).tolist():
            joint = _widened(joint, joint.first(names[i]))


def _odds(joint: Joint) -> tuple[list[str], Array]:
    """Links that are taken for right, and the odds of each to be wrong, all others being as now."""
    names, odds = [], []
    for name in joint.names:
        slot = joint.first(name)
        if name.startswith(LINK) and (variance := joint.of([slot])[0, 0]) <= _SPIKE_M**2:
            information = max(1 / variance - 1 / _SPIKE_M**2, 0.0)
            score = joint.mean[slot] / variance
            narrow, wide = information + 1 / _SPIKE_M**2, information + 1 / _SLAB_M**2
            gain = score**2 * (1 / wide - 1 / narrow)
            bend = np.log(wide * _SLAB_M**2) - np.log(narrow * _SPIKE_M**2)
            names.append(name)
            odds.append(_SHARE * np.exp(min((gain - bend) / 2, 500.0)))
    return names, np.array(odds)


def _widened(joint: Joint, slot: int) -> Joint:
    """A group with the wide prior of a link instead of the narrow one."""
    row = place_among_free(joint, slot)
    tied = joint.covariance[:, row].copy()
    less = 1 / _SLAB_M**2 - 1 / _SPIKE_M**2
    share = less / (1 + less * tied[row])
    mean = joint.mean.copy()
    mean[joint.free] -= share * tied * joint.mean[slot]
    covariance = joint.covariance - share * np.outer(tied, tied)
    return joint._replace(mean=mean, covariance=(covariance + covariance.T) / 2)
