"""Everything the fusion remembers from one Closed to the next: explicit, bounded, serialisable.

Nothing here is ever changed in place; a step makes a new `State` that shares what stayed.
`pack` and `unpack` lose no bit, so a run may be cut anywhere and taken up elsewhere.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from estimation.tracking.tracker import Picture
from schemas.messages import (
    BearingLine,
    DeclaredCarrier,
    DeclaredScenario,
    Direction,
    FixedAxes,
    Navigation,
    OwnAxes,
    Pose,
    SourceProperties,
    SourceTerm,
    StreamSpan,
)
from schemas.messages.outputs import CorrectionState

from .settings import Settings


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


class CarrierState(Struct, frozen=True, kw_only=True):
    """What is known of one carrier.

    Attributes:
        boot: ordinal of the life it is in; 0 = not heard of yet.
        lost: out until it joins or boots again.
        navigation: the last two messages, oldest first.
        sources: what its SourceInfo messages declare.
        logs: by source.
        report_t_ns: newest instant at which a source able to place targets reported; -1 = none.
    """

    boot: int = 0
    lost: bool = False
    navigation: tuple[Navigation, ...] = ()
    sources: dict[str, SourceProperties] = {}
    logs: dict[str, SourceLogs] = {}
    report_t_ns: int = -1


class Estimate(Struct, frozen=True, kw_only=True):
    """One registration of a carrier's frame against the own one; the fields of a Correction."""

    valid_t_ns: int
    own_pose: Pose
    other_pose: Pose
    own_axes: OwnAxes
    fixed_axes: FixedAxes
    directions: tuple[Direction, ...]
    pairs: int
    chi2: float
    dof: int
    method: str = "closed_form"
    mode_probability: float = 1.0
    since_t_ns: int = 0
    valid_for_s: float = 0.0
    terms: tuple[SourceTerm, ...] = ()


class Monitor(Struct, frozen=True, kw_only=True):
    """How far a correction has come.

    Attributes:
        good, undetermined, excessive: report events in a row that were so.
    """

    state: CorrectionState = "observing"
    reason: str = "nothing to compare yet"
    good: int = 0
    undetermined: int = 0
    excessive: int = 0


class WatchColumns(Struct, frozen=True, kw_only=True, eq=False):
    """`estimation.relative_frame.Watch` of one frame, as columns; w scans in its window.

    Attributes:
        t_ns: of the last scan; way_m: (2, 2) of the own and of the other carrier then.
        before, before_covariance: (3,), (3, 3) the frame before the window.
        elapsed_s: (w,); own_m, other_m: (w, 2) travel to each scan from the one before.
        point, vector: (w, 3), matrix: (w, 3, 3), chi2: (w,), pairs: (w,) what each scan said.
        suspected: the last scan was out of line.
    """

    t_ns: int
    way_m: NDArray[np.float64]
    before: NDArray[np.float64]
    before_covariance: NDArray[np.float64]
    elapsed_s: NDArray[np.float64]
    own_m: NDArray[np.float64]
    other_m: NDArray[np.float64]
    point: NDArray[np.float64]
    matrix: NDArray[np.float64]
    vector: NDArray[np.float64]
    chi2: NDArray[np.float64]
    pairs: NDArray[np.int64]
    suspected: bool


class Frames(Struct, frozen=True, kw_only=True, eq=False):
    """Frames of carriers followed together: `estimation.relative_frame.JointFrames`, and of when.

    Attributes:
        t_ns: the instant.
        carriers: whose, in the order of the rows after the own carrier's, which is the first.
        mean: (N, 6); covariance: (6 N, 6 N).
        way_m: (N, 2) dead-reckoned way of each at that instant.
        heading_rad: (N,) of each bow.
        north_variance: (N,) stated for each north [rad^2].
    """

    t_ns: int
    carriers: tuple[str, ...]
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    way_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    north_variance: NDArray[np.float64]


class Link(Struct, frozen=True, kw_only=True):
    """An other carrier as seen from the own one.

    Attributes:
        own_news, other_news: who has reported since the last registration.
        followed: the frame has been found and is followed over time.
        found_t_ns: when it was; -1 before.
        mode_probability: of the association it was found with.
        events: report events so far; tries: searches in vain since the last success.
        doubts: searches in a row that found another frame than the one followed.
        usual_pairs: at an event, on average over the last ones.
        watch: what the alarm remembers.
        bearings_t_ns: last attempt to find the frame of bearings alone; -1 = none.
        estimate: what is published: the newest, or while applied the last good one.
    """

    own_news: bool = False
    other_news: bool = False
    followed: bool = False
    found_t_ns: int = -1
    mode_probability: float = 0.0
    events: int = 0
    tries: int = 0
    doubts: int = 0
    usual_pairs: float = 0.0
    watch: WatchColumns | None = None
    bearings_t_ns: int = -1
    monitor: Monitor = Monitor()
    estimate: Estimate | None = None


class Orders(Struct, frozen=True, kw_only=True):
    """What operators have decided so far.

    Attributes:
        seq: of the last event that was taken.
        suspended: carriers whose correction is not to be applied.
        bound, forbidden: pairs of tracks, each carrier/source/track_id.
    """

    seq: int = 0
    suspended: tuple[str, ...] = ()
    bound: tuple[tuple[str, str], ...] = ()
    forbidden: tuple[tuple[str, str], ...] = ()


class Notes(Struct, frozen=True, kw_only=True):
    """What a track of the picture rests on.

    Attributes:
        identity: kind/name of the target, once a log has told it.
        logs: newest log of each carrier/source that contributes.
    """

    identity: str = ""
    logs: dict[str, str] = {}


class Told(Struct, frozen=True, kw_only=True, eq=False):
    """What a source that tracks by itself has said last, as columns; n tracks.

    Attributes:
        names: of its tracks.
        t_ns: (n,) of their last logs; used_ns: until when what they know is in the picture.
        state: (n, 4) place over ground and velocity of their filters, along the carrier's axes;
            nan where no filter was sent. covariance: (n, 4, 4).
    """

    names: tuple[str, ...]
    t_ns: NDArray[np.int64]
    used_ns: NDArray[np.int64]
    state: NDArray[np.float64]
    covariance: NDArray[np.float64]


class Watched(Struct, frozen=True, kw_only=True):
    """How a source agrees with the picture; counts of a report fade as more come, see `weight`.

    Attributes:
        reports: all of them; weight: of those that are not forgotten.
        lone: plots of no track.
        nis: of plots and the tracks they are of; dof: its degrees of freedom.
    """

    reports: int = 0
    weight: float = 0.0
    lone: float = 0.0
    nis: float = 0.0
    dof: float = 0.0


class Drawn(Struct, frozen=True, kw_only=True, eq=False):
    """The picture: what the tracker knows, and notes by track number; None before any plot.

    Attributes:
        told: of sources that send tracks, by carrier/boot/source; watched: of all, alike.
    """

    picture: Picture | None = None
    notes: dict[str, Notes] = {}
    told: dict[str, Told] = {}
    watched: dict[str, Watched] = {}


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


class Aligned(Struct, frozen=True, kw_only=True, eq=False):
    """A carrier among its beacons: `estimation.system_alignment.Filtered`, and of when.

    Attributes:
        boot: ordinal of the life it is of.
        beacons: names, in the order of the constants.
        start_t_ns: since when; t_ns: of validity.
        start_m: (2,) place at the start; way_m: (2,) reckoned at t_ns, as the carrier says it.
        place, theta, covariance, free: of the filter.
        prior_mean, prior_sigma: (7 + 4 J,) of the constants before the first range.
        ranges: used so far.
        ratio: posterior over prior sigma of the least determined combination.
        hidden: names of combinations that are undetermined; touched: the beacons in each of them.
        diagnosed_t_ns: when these were worked out; -1 = never.
    """

    boot: int
    beacons: tuple[str, ...]
    start_t_ns: int
    t_ns: int
    start_m: NDArray[np.float64]
    way_m: NDArray[np.float64]
    place: NDArray[np.float64]
    theta: NDArray[np.float64]
    covariance: NDArray[np.float64]
    free: NDArray[np.int64]
    prior_mean: NDArray[np.float64]
    prior_sigma: NDArray[np.float64]
    ranges: int = 0
    ratio: float = 1.0
    hidden: tuple[str, ...] = ()
    touched: tuple[tuple[str, ...], ...] = ()
    diagnosed_t_ns: int = -1


class Rays(Struct, frozen=True, kw_only=True, eq=False):
    """The bearings of one target by one carrier, as it took them.

    Attributes:
        t_ns: (n,) in increasing order.
        seen: (n, 4) dead-reckoned way of the carrier, east and north; bearing, clockwise from the
            north of the scenario's origin but for the carrier's own error; its sigma.
    """

    t_ns: NDArray[np.int64]
    seen: NDArray[np.float64]


class Past(Struct, frozen=True, kw_only=True, eq=False):
    """One instant that has been fused, in case something older still comes.

    Attributes:
        before: the state until then, without a past; only some instants keep it.
        messages: names of their types, and payloads.
    """

    t_ns: int
    before: State | None
    messages: tuple[tuple[str, bytes], ...]


class State(Struct, frozen=True, kw_only=True):
    """The whole memory of the fusion.

    Attributes:
        own: the carrier whose frame is the gauge.
        window: sources that have reported since the last report event, carrier/source -> when.
        frames: of the carriers that are followed; None while there is none.
        past: the last few seconds, oldest first, for what comes late.
        lines: by carrier/source/name of the target there.
        aligned: carriers that range to beacons.
        rays: by carrier/kind/name of the target; only while some carrier sees bearings only.
        published: messages so far, by key.
    """

    centre: str
    own: str
    scenario: DeclaredScenario
    settings: Settings
    timeline: Timeline = Timeline()
    orders: Orders = Orders()
    carriers: dict[str, CarrierState] = {}
    links: dict[str, Link] = {}
    window: dict[str, int] = {}
    frames: Frames | None = None
    picture: Drawn = Drawn()
    lines: dict[str, Line] = {}
    aligned: dict[str, Aligned] = {}
    rays: dict[str, Rays] = {}
    past: tuple[Past, ...] = ()
    published: dict[str, int] = {}

    def declared(self, carrier: str) -> DeclaredCarrier | None:
        """What the scenario says of a carrier beforehand."""
        return next((c for c in self.scenario.carriers if c.name == carrier), None)

    def sources(self, carrier: str) -> dict[str, SourceProperties]:
        """What is known of a carrier's sources; its own SourceInfo overrides the scenario."""
        declared = self.declared(carrier)
        known = self.carriers.get(carrier, CarrierState())
        return {**(declared.sources if declared else {}), **known.sources}


def pack(state: State) -> bytes:
    """The state as bytes."""
    return _ENCODER.encode(state)


def unpack(data: bytes) -> State:
    """The state that `pack` made into these bytes."""
    return _DECODER.decode(data)


def _from_array(value: Any) -> tuple[str, tuple[int, ...], bytes]:
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"no {type(value).__name__} in a state")
    return value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes()


def _to_array(kind: Any, value: Any) -> Any:
    dtype, shape, data = value
    return np.frombuffer(data, dtype).reshape(shape).copy()  # aligned, as it was


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_from_array)
_DECODER = msgspec.msgpack.Decoder(State, dec_hook=_to_array)
