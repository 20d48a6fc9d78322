"""Identities that logs bear: what they say of pairs, and whether they can be believed.

A name says more than coordinates do, so one that is wrong does more harm. A source whose names
keep being told of targets that are elsewhere is named in `quality`; where that is the rule, its
names are no longer used, until they have agreed with the picture for a while.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.tracking.bernoulli import PairTerm
from estimation.tracking.tracker import Association, Picture
from schemas.messages import SourceReport

from ..state import Notes

SAME, OTHER = 12.0, -12.0
"""ln of how much likelier two logs are of one target if they bear one name, or two."""
ALIVE = 0.5
"""Existence from which a track that bears a name contradicts a plot elsewhere that does."""
Names = NDArray[np.object_]


class Agreement(NamedTuple):
    """How the names of a report go with those that tracks bear.

    Attributes:
        named: plots whose name a living track bears; astray: of these, that track is not where the
            plot is, or a second one bears the name too.
    """

    named: int = 0
    astray: int = 0


def told(report: SourceReport, log: NDArray[np.intp]) -> Names:
    """Identities (m,) of logs, kind/name; empty where a log has none."""
    identities, kinds = report.identity or [], report.identity_kind or []
    names = [
        f"{kinds[i] if kinds else ''}/{identities[i]}" if identities and identities[i] else ""
        for i in log.tolist()
    ]
    return np.array(names, dtype=object)


def borne(notes: Mapping[str, Notes], picture: Picture) -> Names:
    """Identities (n,) of tracks; empty where none is known."""
    known = (notes.get(str(n), Notes()).identity for n in picture.tracks.identity.tolist())
    return np.array(list(known), dtype=object)


def pair_term(of_track: Names, of_plot: Names) -> PairTerm | None:
    """What names say of a pair of a track and a plot; nothing where either has none."""
    if not of_plot.any():
        return None

    def term(track: NDArray[np.intp], plot: NDArray[np.intp]) -> Array:
        one, other = of_track[track], of_plot[plot]
        both = (one != "") & (other != "")
        return np.where(both, np.where(one == other, SAME, OTHER), 0.0)

    return term


def agreement(of_track: Names, of_plot: Names, before: Picture, done: Association) -> Agreement:
    """How the names of a report's plots go with those of the tracks before it."""
    if not of_plot.any():
        return Agreement()
    near = set(zip(done.identity.tolist(), done.plot.tolist(), strict=True))
    bearers: dict[str, list[int]] = {}
    for row in np.flatnonzero(before.tracks.existence > ALIVE).tolist():
        bearers.setdefault(of_track[row], []).append(int(before.tracks.identity[row]))
    met = [(bearers.get(name, []), plot) for plot, name in enumerate(of_plot.tolist()) if name]
    named = [(tracks, plot) for tracks, plot in met if tracks]
    astray = [True for tracks, plot in named if len(tracks) > 1 or (tracks[0], plot) not in near]
    return Agreement(len(named), len(astray))


def kept(borne_name: str, told_name: str, trusted: bool) -> str:
    """The name of a track after a plot of it: the first told, given up where names are wrong."""
    if trusted:
        return borne_name or told_name
    return "" if told_name and borne_name != told_name else borne_name
