"""What is remembered of targets: the picture, and bearings alone."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from estimation.bearings_only import BearingTracks
from estimation.tracking.tracker import Picture
from schemas.messages import BearingLine

from .carriers import Told
from .features import Dictionary, Learned


class Notes(Struct, frozen=True, kw_only=True):
    """What a track of the picture rests on.

    Attributes:
        identity: kind/name of the target, once a log has told it.
        line: of a target without one, what its bearings are called, see `naming`.
        logs: newest log of each carrier/source that contributes.
    """

    identity: str = ""
    line: str = ""
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
        identity: what its target is called at its carrier, see `naming`.
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


class Nameless(Struct, frozen=True, kw_only=True, eq=False):
    """The nameless bearings of one passive source, told apart.

    Attributes:
        boot: of the carrier; seq: of the last report, which is the last look.
        t_ns, way_m: its time, and (2,) the carrier's way then.
        tracks: of its bearings.
        rows: (n,) number of the track of each bearing of the last look; -1 = open, or named.
    """

    boot: int
    seq: int
    t_ns: int
    way_m: NDArray[np.float64]
    tracks: BearingTracks
    rows: NDArray[np.int64]


class Paired(Struct, frozen=True, kw_only=True):
    """What another carrier's target is called by the own one; agreed: attempts in a row."""

    target: str
    agreed: int = 1
