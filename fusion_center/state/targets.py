"""What is remembered of targets: the picture, and bearings alone."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from estimation.tracking.tracker import Picture
from schemas.messages import BearingLine

from .carriers import Told
from .features import Dictionary, Learned


class Notes(Struct, frozen=True, kw_only=True):
    """What a track of the picture rests on.

    Attributes:
        identity: kind/name of the target, once a log has told it.
        logs: newest log of each carrier/source that contributes.
    """

    identity: str = ""
    logs: dict[str, str] = {}


class Watched(Struct, frozen=True, kw_only=True):
    """How a source agrees with the picture; counts of a report fade as more come, see `weight`.

    Attributes:
        reports: all of them; weight: of those that are not forgotten.
        lone: plots of no track.
        nis: of plots and the tracks they are of; dof: its degrees of freedom.
        named: plots with a name that a track bears; astray: of them, where that track is not.
    """

    reports: int = 0
    weight: float = 0.0
    lone: float = 0.0
    nis: float = 0.0
    dof: float = 0.0
    named: float = 0.0
    astray: float = 0.0


class Drawn(Struct, frozen=True, kw_only=True, eq=False):
    """The picture: what the tracker knows, and notes by track number; None before any plot.

    Attributes:
        told: of sources that send tracks, by carrier/boot/source; watched: of all, alike.
        dictionary: the features that its tracks know; learned: of the sources that report them.
    """

    picture: Picture | None = None
    notes: dict[str, Notes] = {}
    told: dict[str, Told] = {}
    watched: dict[str, Watched] = {}
    dictionary: Dictionary = Dictionary()
    learned: dict[str, Learned] = {}


class Line(Struct, frozen=True, kw_only=True, eq=False):
    """The bearings of one target by one passive source, and what they were last said to mean.

    Attributes:
        identity: kind/name that others see too; may be empty.
        t_ns: (n,) in increasing order.
        seen: (n, 4) east and north of the carrier, bearing and its sigma, in the picture.
        solved_t_ns: newest bearing behind `told`; tried_t_ns: when that was worked out.
    """

    identity: str = ""
    t_ns: NDArray[np.int64]
    seen: NDArray[np.float64]
    told: BearingLine | None = None
    solved_t_ns: int = -1
    tried_t_ns: int = -1


class Rays(Struct, frozen=True, kw_only=True, eq=False):
    """The bearings of one target by one carrier, as it took them.

    Attributes:
        t_ns: (n,) in increasing order.
        seen: (n, 4) dead-reckoned way of the carrier, east and north; bearing, clockwise from the
            north of the scenario's origin but for the carrier's own error; its sigma.
    """

    t_ns: NDArray[np.int64]
    seen: NDArray[np.float64]
