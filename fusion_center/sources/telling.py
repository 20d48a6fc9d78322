"""What features tell of tracks of sources: gathered log by log, and compared between carriers.

What is known of n targets is kept as one row each, by the dictionary of the run.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, Indices
from estimation.tracking import features
from estimation.tracking.features import Features, Layout
from schemas.messages import FeatureInfo

from ..state import Dictionary, State
from .features import Heard, dictionary, fitted, is_number, layout


class Telling(NamedTuple):
    """How rows are read and compared.

    Attributes:
        layout: of the features; width: (P,) of the population of each number.
    """

    layout: Layout
    width: Array

    def log_ratio(self, own: Array, other: Array, i: Indices, j: Indices) -> Array:
        """Log-likelihood ratios (k,) that own rows i and the other's rows j are of one target."""
        one, two = unpacked(own, self.layout), unpacked(other, self.layout)
        return features.agreement(one, two, self.width, self.layout, i, j)


NOTHING_TELLS = Telling(Layout(), np.zeros(0))


def telling(state: State) -> Telling:
    """By all features that sources declare, numbers ranging as widely as any of them says."""
    known = run_dictionary(state)
    width = np.zeros(len(known.numbers))
    for carrier in {c.name for c in state.scenario.carriers} | set(state.carriers):
        for source in state.sources(carrier).values():
            for row, name in enumerate(known.numbers):
                info = source.features.get(name)
                if info and is_number(info):
                    width[row] = max(width[row], _width(info))
    return Telling(layout(known), width)


def run_dictionary(state: State) -> Dictionary:
    """The features of the run; none where they do not count."""
    return dictionary(state) if state.settings.features.enabled else Dictionary()


def refitted(rows: Array, before: Dictionary, now: Dictionary) -> Array:
    """Rows by another dictionary."""
    return rows if before == now else packed(fitted(unpacked(rows, layout(before)), before, now))


def after_logs(
    rows: Array, previous: NDArray[np.int64], used: Indices, heard: Heard | None, known: Dictionary
) -> Array:
    """Rows (k,) of the targets of some logs, with what these say taken in.

    Args:
        rows: of the targets before.
        previous: (k,) row of each log's target, -1 where it is new.
        used: (k,) which of the logs of `heard` they are.
    """
    blank = unpacked_nothing(known, len(used))
    old = np.flatnonzero(previous >= 0)
    before = packed(blank)
    before[old] = rows[previous[old]]
    if heard is None:
        return before
    every = np.arange(len(used))
    return packed(features.after(unpacked(before, layout(known)), heard.said, every, used))


def unpacked_nothing(known: Dictionary, count: int) -> Features:
    """Nothing known of so many targets."""
    return features.unknown(layout(known), count)


def packed(known: Features) -> Array:
    """(n, 3 P + R) one row a target."""
    return np.ascontiguousarray(np.concatenate(known, axis=0).T)


def unpacked(rows: Array, of: Layout) -> Features:
    """Columns of (n, 3 P + R) again."""
    p = of.numbers
    return Features(
        rows[:, :p].T, rows[:, p : 2 * p].T, rows[:, 2 * p : 3 * p].T, rows[:, 3 * p :].T
    )


def _width(info: FeatureInfo) -> float:
    least, greatest = info.population or (0.0, 0.0)
    return float(greatest - least)
