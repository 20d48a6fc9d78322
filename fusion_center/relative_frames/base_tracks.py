"""What a frame just found has in common with those that are followed: the tracks of its base."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.relative_frame import OwnAxesFrame
from estimation.relative_frame.common_tracks import Tracks, shared

from ..sources.sightings import Pair
from ..sources.telling import telling
from ..state import Frames, State
from . import frames
from .common import common_targets
from .moment import Moment


class Pairs(NamedTuple):
    """The pairs a frame was found from.

    Attributes:
        base: the carrier of the former of each pair; `frame` is in its axes.
        gain: (L, 3, 2) by what the frame moves with the base's place of each pair.
    """

    base: str
    frame: OwnAxesFrame
    pairs: list[Pair]
    gain: Array


def shared_by(state: State, known: Frames | None, moment: Moment, found: Pairs) -> Array | None:
    """Covariance (7 N, 3) of the followed frames with one just found; None = nothing in common."""
    if known is None or not found.pairs:
        return None
    with suppress(np.linalg.LinAlgError, ValueError):  # numbers that make no sense say nothing
        return _shared_by(state, known, moment, found)
    return None


def _shared_by(state: State, known: Frames, moment: Moment, found: Pairs) -> Array | None:
    names = [name for name in known.carriers if name in moment.names]
    views = [moment.own, *(moment.others[name] for name in names)]
    rows = [0, *(frames.row(known, name) for name in names)]
    base = 0 if found.base == state.own else 1 + names.index(found.base)
    expected = [frames.frame_of(known, name) for name in names]
    gate = state.settings.association.gate
    pair_of = {pair.own: number for number, pair in enumerate(found.pairs)}
    members = [
        (member, pair_of[by_base[0]])
        for target in common_targets(views, expected, state.orders, gate, telling(state))
        if (by_base := [m.row for m in target if m.carrier == base and m.row in pair_of])
        for member in target
    ]
    if not members:
        return None
    tracks = Tracks(
        carrier=np.array([rows[member.carrier] for member, _ in members], dtype=np.intp),
        target=np.array([number for _, number in members], dtype=np.intp),
        places_m=np.array([views[m.carrier].east_north_m[m.row] for m, _ in members]),
        covariance=np.array([views[m.carrier].covariance[m.row] for m, _ in members]),
    )
    return shared(frames.joint(known), tracks, rows[base], found.frame, found.gain)
