"""What carriers say: their sources, reports, navigation and ranges (role `input`)."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from typing import Annotated, Literal

from msgspec import Meta, Struct
from msgspec.structs import astuple

from .values import (
    Angle,
    Count,
    Id,
    Latitude,
    Longitude,
    Metres,
    MetresPerSecond,
    Range,
    Real,
    Seconds,
    Share,
    Sigma,
    Text,
    TimeNs,
    Triangle,
    require_covariance,
)


class Input(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The envelope of every input.

    Attributes:
        carrier: who sends.
        boot: one life of the sender; new at every start.
        stream: the source id of a report, or `info`, `navigation`, `ranging`.
        seq: counts from 1 without a hole within (boot, stream).
        step: the simulated step in lock-step runs, else 0.
        t_ns: when what is said holds, Unix nanoseconds by the sender's own clock.
    """

    carrier: Id
    boot: Id
    stream: Id
    seq: Annotated[int, Meta(ge=1, le=2**63 - 1)]
    t_ns: TimeNs
    step: Count = 0


class Sector(Struct, frozen=True, kw_only=True):
    """A sector of bearings, clockwise from `start_rad` over `width_rad` (a full turn: 2 pi)."""

    start_rad: Angle
    width_rad: Angle


class FeatureInfo(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One feature a source can report of a target.

    Attributes:
        kind: parametric (a property, such as a length) or behavioural (a manner, such as speed).
        unit: SI unit of the values; empty for categories.
        sigma: one sigma of a value, where the report gives none.
        population: least and greatest value among all targets.
        categories: the names a categorical feature can take.
        confusion: row i = probabilities of reporting each category when i is true.
    """

    kind: Literal["parametric", "behavioural"]
    unit: Text = ""
    sigma: Sigma | None = None
    population: Annotated[list[Real], Meta(min_length=2, max_length=2)] | None = None
    categories: list[Text] = []
    confusion: list[list[Share]] = []


class SourceProperties(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a source declares of itself; a scenario declares the same of a simulated one.

    Attributes:
        kind: what it is, such as radar, passive, ais, lidar.
        coordinates: what a target log of it holds.
        period_s: time between two reports.
        sigma_bearing_rad, sigma_range_m, sigma_elevation_rad, sigma_position_m: defaults for logs
            that bring no sigma of their own.
        detection_probability: of a target within limits, at one report.
        clutter_per_scan: expected number of false logs in a report.
        range_min_m, range_max_m, sector: where it can see.
        resolution_bearing_rad, resolution_range_m: closer targets merge.
        sigma_range_bias_m, sigma_range_scale, sigma_azimuth_bias_rad, sigma_clock_s: prior sigmas
            of the source's systematic errors; 0 = none.
        sends_tracks: logs are a filter's output, not single measurements.
        filter_memory_s: time after which such a log has forgotten its past.
        features: name -> what is reported under it.
    """

    kind: Id = "radar"
    coordinates: Literal["bearing_range", "bearing", "cartesian", "geodetic"] = "bearing_range"
    period_s: Annotated[float, Meta(gt=0, le=1e6)] = 1.0
    sigma_bearing_rad: Sigma | None = None
    sigma_range_m: Sigma | None = None
    sigma_elevation_rad: Sigma | None = None
    sigma_position_m: Sigma | None = None
    detection_probability: Share = 1.0
    clutter_per_scan: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    range_min_m: Range = 0.0
    range_max_m: Range = 1e9
    sector: Sector | None = None
    resolution_bearing_rad: Angle = 0.0
    resolution_range_m: Range = 0.0
    sigma_range_bias_m: Range = 0.0
    sigma_range_scale: Share = 0.0
    sigma_azimuth_bias_rad: Angle = 0.0
    sigma_clock_s: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    sends_tracks: bool = False
    filter_memory_s: Seconds = 0.0
    features: dict[Id, FeatureInfo] = {}


class SourceInfo(Input, frozen=True, kw_only=True, omit_defaults=True):
    """What a source is; sent once at the start and again when it changes (stream `info`, latched).

    Attributes:
        source: the id under which its reports come.
        properties: what it declares of itself.
    """

    source: Id
    properties: SourceProperties


class FeatureColumn(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Values of one feature, one a log (nil = not reported), with sigmas where they are numbers."""

    values: list[Real | Text | None]
    sigmas: list[Sigma | None] | None = None


class TrackFilter(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The filter behind a log of kind `track`, so that its new information can be taken out.

    Attributes:
        model: constant_velocity or constant_acceleration, per axis.
        q: spectral density of its process noise [m^2/s^3 or m^2/s^5].
        previous_t_ns: time of the state it was predicted from.
        state: (east, north, their velocities, ...) in the carrier's frame [m, m/s].
        covariance: upper triangle in the order of `state`.
    """

    model: Id
    q: Annotated[float, Meta(ge=0, le=1e9)]
    previous_t_ns: TimeNs
    state: Annotated[list[Real], Meta(min_length=2, max_length=12)]
    covariance: Triangle

    def __post_init__(self) -> None:
        require_covariance("covariance", self.covariance, (len(self.state),))


class Increment(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """New information since the last report: y = Y x, with Y the information matrix.

    Attributes:
        frame: the axes of the state, `carrier` or `ecef`.
        y: information vector.
        information: upper triangle of Y.
    """

    frame: Id
    y: Annotated[list[Real], Meta(min_length=2, max_length=12)]
    information: Triangle


Column = list[Real | None] | None
Reals = list[Metres | None] | None
Speeds = list[MetresPerSecond | None] | None
Angles = list[Angle | None] | None
Sigmas = list[Sigma | None] | None
Triangles = list[Triangle | None] | None


MAX_LOGS = 10_000
"""Target logs in one report."""


class SourceReport(Input, frozen=True, kw_only=True, omit_defaults=True):
    """The target logs of one source at one instant, as columns of equal length.

    An absent column is an absent field of every log, nil in a column an absent field of one log. A
    report without a column says that the source looked and saw nothing; it must be sent too.

    Attributes:
        swept: the sector this report covers; absent = all the source can see.
        correction_id: the correction that these logs already hold, see `Navigation`.
        turned_rad: what it added to their bearings; east and north, velocities, filters and the
            swept sector are turned alike. Latitudes and longitudes never hold a correction.
        kind: plot (default), track or increment.
        track_id: the source's own name of the target, stable over reports.
        time_offset_s: when the log was measured, after `t_ns`.
        bearing_rad: clockwise from the carrier's own north.
        range_m: slant range.
        elevation_rad: up from the carrier's horizon.
        covariance_polar: of (bearing, range) or (bearing, range, elevation).
        east_m, north_m, up_m: from the carrier's reported position in its own axes.
        covariance_position: of (east, north) or (east, north, up) [m^2].
        latitude_rad, longitude_rad, altitude_m: WGS84; sigma_position_m is per horizontal axis.
        velocity_east_mps, velocity_north_mps, velocity_up_mps: over ground, in the carrier's axes.
        covariance_velocity: of (east, north) or (east, north, up) [m^2/s^2].
        range_rate_mps: growth of the range.
        features: name -> values, one a log.
        classes: the class or classes the source takes the target for; confidence in them.
        identity, identity_kind: a name that other carriers see too, such as an MMSI.
        filter: of logs of kind track.
        increment: of logs of kind increment.
    """

    swept: Sector | None = None
    correction_id: Text = ""
    turned_rad: Angle = 0.0
    kind: list[Literal["plot", "track", "increment"]] | None = None
    track_id: list[Text | None] | None = None
    time_offset_s: list[Seconds | None] | None = None
    sigma_time_offset_s: Sigmas = None
    bearing_rad: Angles = None
    sigma_bearing_rad: Sigmas = None
    range_m: list[Range | None] | None = None
    sigma_range_m: Sigmas = None
    elevation_rad: Angles = None
    sigma_elevation_rad: Sigmas = None
    covariance_polar: Triangles = None
    east_m: Reals = None
    north_m: Reals = None
    up_m: Reals = None
    covariance_position: Triangles = None
    latitude_rad: list[Latitude | None] | None = None
    longitude_rad: list[Longitude | None] | None = None
    altitude_m: Reals = None
    sigma_position_m: Sigmas = None
    velocity_east_mps: Speeds = None
    velocity_north_mps: Speeds = None
    velocity_up_mps: Speeds = None
    covariance_velocity: Triangles = None
    range_rate_mps: Speeds = None
    sigma_range_rate_mps: Sigmas = None
    features: dict[Id, FeatureColumn] = {}
    classes: list[list[Text] | None] | None = None
    class_confidence: list[Share | None] | None = None
    identity: list[Text | None] | None = None
    identity_kind: list[Text | None] | None = None
    filter: list[TrackFilter | None] | None = None
    increment: list[Increment | None] | None = None

    def __len__(self) -> int:
        """Number of target logs."""
        return next((len(column) for column in _columns(self) if column is not None), 0)

    def __post_init__(self) -> None:
        if not self._is_even():
            self._require_lengths()
        for triangle in self.covariance_polar or ():
            require_covariance("covariance_polar", triangle, (2, 3))
        for triangle in self.covariance_position or ():
            require_covariance("covariance_position", triangle, (2, 3))
        for triangle in self.covariance_velocity or ():
            require_covariance("covariance_velocity", triangle, (2, 3))

    def _is_even(self) -> bool:
        """Whether all columns are clearly of one length, without features.

        Every message that comes is looked at: a loop over the columns took as long as decoding.
        """
        values = astuple(self)[_FIRST_COLUMN:]
        filled = tuple(filter(None, values))
        if self.features or len(filled) + values.count(None) != len(values) - 1:
            return False
        return not filled or (len(set(map(len, filled))) == 1 and len(filled[0]) <= MAX_LOGS)

    def _require_lengths(self) -> None:
        columns = _columns(self)
        most = max((len(column) for column in columns if column is not None), default=0)
        if most > MAX_LOGS:
            raise ValueError(f"got {most} logs, expected at most {MAX_LOGS}: send several reports")
        count = len(self)
        for name, column in zip(COLUMNS, columns, strict=True):
            _require_length(name, column, count)
        for name, feature in self.features.items():
            _require_length(f"features.{name}.values", feature.values, count)
            _require_length(f"features.{name}.sigmas", feature.sigmas, count)


COLUMNS = tuple(
    name
    for name in SourceReport.__struct_fields__
    if name not in (*Input.__struct_fields__, "swept", "features", "correction_id", "turned_rad")
)
"""Every column of a report, in the order of the message."""
_columns = attrgetter(*COLUMNS)
_FIRST_COLUMN = SourceReport.__struct_fields__.index(COLUMNS[0])
"""From here on all fields are columns, but for the features."""


def _require_length(name: str, column: Sequence[object] | None, count: int) -> None:
    if column is not None and len(column) != count:
        raise ValueError(f"{name}: got {len(column)} logs, expected {count} as in the first column")


class Pose(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Where a carrier believes it is, and how it believes it is turned.

    Attributes:
        heading_rad: of the bow, clockwise from the carrier's own north.
        covariance: of (east, north, north direction) [m, rad] or, six by six, of (east, north, up,
            yaw, pitch, roll): the error of the carrier's frame. Absent = the declared prior.
    """

    latitude_rad: Latitude
    longitude_rad: Longitude
    altitude_m: Metres = 0.0
    heading_rad: Angle = 0.0
    covariance: Triangle | None = None

    def __post_init__(self) -> None:
        require_covariance("covariance", self.covariance, (3, 6))


class Navigation(Input, frozen=True, kw_only=True, omit_defaults=True):
    """The carrier's own navigation (stream `navigation`).

    Attributes:
        pose: as reported, corrections in `correction_id` included.
        kind: whether the pose came of a position fix or of dead reckoning alone.
        correlation_time_s: of the error of the pose; 0 = constant.
        reckoned_east_m, reckoned_north_m: dead-reckoned way since this boot, cumulative: the
            difference of two messages is the way between them, and losing one costs nothing. It
            never holds a correction.
        speed_mps: through what it moves in, along `heading_rad` of the pose.
        sigma_speed_mps, sigma_heading_rad: of the dead reckoning.
        correction_id: the correction of the fusion centre that this pose already holds.
        uncorrected: the pose without it, which is what the fusion centre works with.
    """

    pose: Pose
    kind: Literal["fix", "dead_reckoning"] = "dead_reckoning"
    correlation_time_s: Annotated[float, Meta(ge=0, le=1e9)] = 0.0
    reckoned_east_m: Metres = 0.0
    reckoned_north_m: Metres = 0.0
    speed_mps: MetresPerSecond = 0.0
    sigma_speed_mps: Sigma | None = None
    sigma_heading_rad: Sigma | None = None
    correction_id: Text = ""
    uncorrected: Pose | None = None


class Ranging(Input, frozen=True, kw_only=True, omit_defaults=True):
    """A range to another carrier or to a beacon (stream `ranging`).

    Attributes:
        peer: the carrier or beacon at the other end.
        kind: two_way, pseudorange (with the clocks in it) or difference (range to peer less range
            to `reference`).
        t_tx_ns: by the sender's clock; t_rx_ns: by the receiver's.
    """

    peer: Id
    kind: Literal["two_way", "pseudorange", "difference"]
    value_m: Metres
    sigma_m: Sigma
    reference: Id | None = None
    t_tx_ns: TimeNs = 0
    t_rx_ns: TimeNs = 0
