"""What is remembered of time and of each carrier: its lives, navigation, sources and their logs."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from schemas.messages import Navigation, SourceProperties, StreamSpan

from .features import Dictionary


class Boots(Struct, frozen=True):
    """Lives of one carrier as the Closed messages named them.

    Attributes:
        count: how many there have been.
        recent: the newest of them, oldest first; the last one has ordinal `count`.
    """

    count: int = 0
    recent: tuple[str, ...] = ()


class Timeline(Struct, frozen=True, kw_only=True):
    """How far time is closed.

    Attributes:
        t_ns: of the last Closed; -1 before the first.
        boots: by carrier.
        seen: last seq that a Closed named, by carrier/boot/stream.
        gave_up: spans given up that no manifest has reached yet.
    """

    t_ns: int = -1
    boots: dict[str, Boots] = {}
    seen: dict[str, int] = {}
    gave_up: tuple[StreamSpan, ...] = ()


class SourceLogs(Struct, frozen=True, kw_only=True, eq=False):
    """The last two logs of every target of one source, and its track; as columns, n targets.

    A place is the target's position relative to the carrier plus the carrier's dead-reckoned way,
    all in the carrier's believed axes: in it a target moves as over ground, but for the carrier's
    unknown drift, which the way takes out again.

    Attributes:
        report_seq, report_t_ns: of the newest report, which may have held nothing.
        born: how many tracks the source's nameless plots have begun.
        key: names the target within the source.
        identity, track: kind/name that others see too; the source's own name, or #k of the k-th
            track of nameless plots; either may be empty.
        seq, index: of the newest log.
        t_ns: (2, n) instants of the newest and of the one before, -1 where there is none.
        place_m: (2, n, 2) east and north.
        covariance: (2, n, 2, 2) of it [m^2].
        altitude_m: (n,) above the ellipsoid.
        state: (n, 4) of the filter at the newest log: place and velocity.
        state_covariance: (n, 4, 4).
        existence: (n,) probability that there is such a target.
        hits: (n,) logs so far.
        used_t_ns: (n,) newest log that has served to follow frames; -1 = none.
        features: (n, columns) what is known of them, see `sources.telling`; by `dictionary`.
    """

    report_seq: int
    report_t_ns: int
    born: int
    key: tuple[str, ...]
    identity: tuple[str, ...]
    track: tuple[str, ...]
    seq: NDArray[np.int64]
    index: NDArray[np.int64]
    t_ns: NDArray[np.int64]
    place_m: NDArray[np.float64]
    covariance: NDArray[np.float64]
    altitude_m: NDArray[np.float64]
    state: NDArray[np.float64]
    state_covariance: NDArray[np.float64]
    existence: NDArray[np.float64]
    hits: NDArray[np.int64]
    used_t_ns: NDArray[np.int64]
    features: NDArray[np.float64]
    dictionary: Dictionary = Dictionary()


class Told(Struct, frozen=True, kw_only=True, eq=False):
    """What a source that tracks by itself has said last, as columns; n tracks.

    Attributes:
        names: of its tracks.
        t_ns: (n,) of their last logs; used_ns: until when what they know has been used.
        state: (n, 4) place over ground and velocity of their filters, along the carrier's axes;
            nan where no filter was sent. covariance: (n, 4, 4).
    """

    names: tuple[str, ...]
    t_ns: NDArray[np.int64]
    used_ns: NDArray[np.int64]
    state: NDArray[np.float64]
    covariance: NDArray[np.float64]


class CarrierState(Struct, frozen=True, kw_only=True):
    """What is known of one carrier.

    Attributes:
        boot: ordinal of the life it is in; 0 = not heard of yet.
        lost: out until it joins or boots again.
        navigation: the last two messages, oldest first.
        sources: what its SourceInfo messages declare.
        logs: by source; told: by source that tracks, what its frame was sought with.
        report_t_ns: newest instant at which a source able to place targets reported; -1 = none.
    """

    boot: int = 0
    lost: bool = False
    navigation: tuple[Navigation, ...] = ()
    sources: dict[str, SourceProperties] = {}
    logs: dict[str, SourceLogs] = {}
    told: dict[str, Told] = {}
    report_t_ns: int = -1
