"""What a scenario file may hold, key by key: the one place where degrees are spoken.

Declared (anyone may fetch it): name, title, time, origin, fusion; of a carrier `name`,
`use_corrections`, `navigation`, `sensors` and `ranging`; of a beacon where it is said to be. Truth
(never for the fusion centre): seed, every `motion` and `errors` table, classes, targets,
target_groups, tracks.

Places are east and north [m] of the origin; courses and bearings clockwise from north.
"""

from __future__ import annotations

from datetime import UTC, datetime
from math import inf
from typing import Annotated, Any, Literal

from msgspec import Meta, field

from schemas.messages.values import Id, Metres, Real, Share, Text

from .features import FeatureReports, WordErrors, WordReports
from .motions import AnyMotion, Instant, PathMotion, TrackFile
from .ranging import Beacon, Ranging
from .table import Degrees, Interval, NonNegative, Positive, Table

EPOCH = datetime(2026, 1, 1, tzinfo=UTC)
EARLIEST = datetime(1970, 1, 1, tzinfo=UTC)


class Time(Table, frozen=True, kw_only=True):
    """When the run takes place and in which steps.

    Attributes:
        epoch: scenario time of step 0.
        step_s: between two steps.
        duration_s: of the whole run.
        max_clock_error_s: messages stamped later than the closing time by more are refused.
    """

    epoch: Instant = EPOCH
    step_s: Annotated[float, Meta(ge=1e-3, le=3600)] = 1.0
    duration_s: Positive
    max_clock_error_s: NonNegative = 1.0


class OriginPoint(Table, frozen=True, kw_only=True):
    """Where the axes of the run touch the WGS84 ellipsoid.

    Attributes:
        latitude_deg, longitude_deg: geodetic.
        altitude_m: above the ellipsoid.
    """

    latitude_deg: Annotated[float, Meta(ge=-89, le=89)]
    longitude_deg: Annotated[float, Meta(ge=-180, le=180)]
    altitude_m: Metres = 0.0


class Errors(Table, frozen=True, kw_only=True):
    """Whether carriers err at all; false gives known frames and the same sensor noise."""

    enabled: bool = True


class Fix(Table, frozen=True, kw_only=True):
    """Position fixes, as of a satellite receiver: dead reckoning starts anew at each."""

    period_s: Positive
    sigma_m: Positive


class NavigationPrior(Table, frozen=True, kw_only=True):
    """What a carrier declares of its navigation, one sigma each; 0 = it has no such error.

    Attributes:
        sigma_position_m: of the position at the start, per axis.
        sigma_north_deg: of its north at the start, which then wanders by
            `sigma_north_drift_deg_per_sqrt_h` in an hour.
        sigma_speed_mps: of the speed through the water, constant over a run.
        sigma_current_mps: of the unknown current, per axis, constant over a run.
        sigma_log_noise_mps, sigma_compass_noise_deg: of what log and compass show, anew at every
            step.
        sigma_clock_s: of its clock at the start, which then gains `sigma_clock_drift_ppm`, constant
            over a run.
    """

    sigma_position_m: NonNegative = 0.0
    sigma_north_deg: Annotated[float, Meta(ge=0, le=180)] = 0.0
    sigma_north_drift_deg_per_sqrt_h: Annotated[float, Meta(ge=0, le=180)] = 0.0
    sigma_speed_mps: NonNegative = 0.0
    sigma_current_mps: NonNegative = 0.0
    sigma_log_noise_mps: NonNegative = 0.0
    sigma_compass_noise_deg: Annotated[float, Meta(ge=0, le=180)] = 0.0
    sigma_clock_s: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    sigma_clock_drift_ppm: NonNegative = 0.0
    fix: Fix | None = None


class FrameErrors(Table, frozen=True, kw_only=True):
    """The actual errors of a carrier; what is absent is drawn from its declared sigma.

    Attributes:
        position_east_m, position_north_m: reported less true position at the start.
        north_deg: bearing of its own north, clockwise from true north, at the start.
        speed_mps: speed its log shows less speed through the water.
        current_east_mps, current_north_mps: the current it does not know of.
        clock_s, clock_drift_ppm: its clock less true time.
    """

    position_east_m: Metres | None = None
    position_north_m: Metres | None = None
    north_deg: Degrees | None = None
    speed_mps: Metres | None = None
    current_east_mps: Metres | None = None
    current_north_mps: Metres | None = None
    clock_s: Annotated[float, Meta(ge=-1e6, le=1e6)] | None = None
    clock_drift_ppm: Annotated[float, Meta(ge=-1e6, le=1e6)] | None = None


class SensorErrors(Table, frozen=True, kw_only=True):
    """The actual systematic errors of a sensor; what is absent is drawn from its declared sigma.

    measured range = true * (1 + range_scale) + range_bias_m; measured bearing = true +
    azimuth_bias_deg; stamp = carrier's clock + clock_s.
    """

    range_bias_m: Metres | None = None
    range_scale: Annotated[float, Meta(gt=-1, lt=1)] | None = None
    azimuth_bias_deg: Degrees | None = None
    clock_s: Annotated[float, Meta(ge=-1e6, le=1e6)] | None = None


class ClassReports(Table, frozen=True, kw_only=True):
    """A sensor that tells classes: the right one with `accuracy`, else any other."""

    accuracy: Share
    errors: WordErrors = WordErrors()


class Tracking(Table, frozen=True, kw_only=True):
    """A sensor that sends tracks instead of plots.

    Attributes:
        process_noise: q of the targets' velocities that its filters assume [m^2/s^3].
        sigma_velocity_mps: of a new target's velocity about zero, per axis, as they assume it.
        report: whole tracks with their filter, or what they have learnt since the last report.
    """

    process_noise: Annotated[float, Meta(gt=0, le=1e6)] = 0.1
    sigma_velocity_mps: Annotated[float, Meta(gt=0, le=1e4)] = 30.0
    report: Literal["track", "increment"] = "track"


class Sensor(Table, frozen=True, kw_only=True):
    """One source of a carrier, simulated as it declares itself.

    Attributes:
        name: of the source; kind: what it is, such as radar, passive, ais.
        coordinates: bearing and range, or the bearing alone.
        period_s: between two reports.
        sigma_bearing_deg, sigma_range_m, sigma_elevation_deg: of a plot; without the last it
            measures no elevation.
        detection_probability: of a target within limits, at one report.
        clutter_per_scan: expected false plots in a report.
        range_min_m, range_max_m: where it sees.
        resolution_bearing_deg, resolution_range_m: targets nearer to each other than both merge.
        identity_kind: what kind of name it reads, such as name or mmsi.
        classes: it tells classes; features: it measures features.
        sigma_range_bias_m, sigma_range_scale, sigma_azimuth_bias_deg, sigma_clock_s: of its
            systematic errors; 0 = it has none.
        errors: the actual ones.
        phase_s: time of the first report; without it one period after the start.
        sector_deg: first bearing and width, clockwise from the carrier's own north.
        rotating: logs carry the offset at which the turning antenna passed them.
        identity_share: share of the targets with an identity whose identity it reads.
        tracking: it sends tracks; its sigmas and false alarms are those of the plots behind them.
    """

    name: Id
    kind: Id = "radar"
    coordinates: Literal["bearing_range", "bearing"] = "bearing_range"
    period_s: Annotated[float, Meta(ge=1e-3, le=1e6)] = 1.0
    phase_s: NonNegative = 0.0
    sigma_bearing_deg: Annotated[float, Meta(gt=0, le=360)]
    sigma_range_m: Positive | None = None
    sigma_elevation_deg: Annotated[float, Meta(gt=0, le=180)] | None = None
    detection_probability: Share = 1.0
    clutter_per_scan: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    range_min_m: NonNegative = 0.0
    range_max_m: Positive = 1e9
    sector_deg: tuple[Degrees, Annotated[float, Meta(gt=0, le=360)]] | None = None
    resolution_bearing_deg: Annotated[float, Meta(ge=0, le=360)] = 0.0
    resolution_range_m: NonNegative = 0.0
    rotating: bool = False
    identity_share: Share = 0.0
    identity_kind: Text = "name"
    tracking: Tracking | None = None
    classes: ClassReports | None = None
    features: list[FeatureReports] = []
    words: list[WordReports] = []
    sigma_range_bias_m: NonNegative = 0.0
    sigma_range_scale: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    sigma_azimuth_bias_deg: Annotated[float, Meta(ge=0, le=180)] = 0.0
    sigma_clock_s: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    errors: SensorErrors = SensorErrors()


class Carrier(Table, frozen=True, kw_only=True):
    """A carrier: what it declares, and how it truly moves and errs.

    Attributes:
        use_corrections: it applies the corrections it is sent, and says all in the frame so
            corrected.
    """

    name: Id
    use_corrections: bool = False
    motion: PathMotion
    navigation: NavigationPrior = NavigationPrior()
    errors: FrameErrors = FrameErrors()
    sensors: list[Sensor] = []
    ranging: list[Ranging] = []


class TargetClass(Table, frozen=True, kw_only=True):
    """A class of targets.

    Attributes:
        features: name -> mean and sigma over the class.
        words: name -> weight of each word.
    """

    name: Id
    features: dict[Id, Interval] = {}
    words: dict[Id, dict[Text, NonNegative]] = {}


class Target(Table, frozen=True, kw_only=True):
    """One target.

    Attributes:
        class_name: key `class`; one of [[classes]].
        identity: a name that sensors may read, such as an MMSI; empty = none.
        start_s, end_s: when it is there.
        features, words: actual values, instead of draws from its class.
    """

    name: Id
    class_name: Text = field(name="class", default="")
    identity: Text = ""
    start_s: NonNegative = 0.0
    end_s: Positive = inf
    features: dict[Id, Real] = {}
    words: dict[Id, Text] = {}
    motion: AnyMotion


class TargetGroup(Table, frozen=True, kw_only=True):
    """Many targets drawn at random, named `<name>-0000` and on.

    Attributes:
        box_m: east from, east to, north from, north to.
        classes, motions: name -> weight; motions among constant_velocity (default) and
            coordinated_turn.
        course_deg, speed_mps, altitude_m, turn_rate_deg_s: uniform from .. to.
        identity_share: share of them whose name is an identity as well.
    """

    name: Id
    count: Annotated[int, Meta(ge=1, le=1_000_000)]
    box_m: tuple[Metres, Metres, Metres, Metres]
    classes: dict[Id, NonNegative] = {}
    motions: dict[Id, NonNegative] = {}
    course_deg: Interval = (0.0, 360.0)
    speed_mps: Interval = (0.0, 0.0)
    altitude_m: Interval = (0.0, 0.0)
    turn_rate_deg_s: Interval = (-3.0, 3.0)
    identity_share: Share = 1.0
    start_s: NonNegative = 0.0
    end_s: Positive = inf


class Tracks(TrackFile, frozen=True, kw_only=True):
    """All recorded tracks of a file as targets; their ids are their identities.

    Attributes:
        name: the targets are called `<name>-<id>`.
        min_reports: tracks with fewer are left out.
        ids: only these, where given.
    """

    name: Id
    class_name: Text = field(name="class", default="")
    min_reports: Annotated[int, Meta(ge=2)] = 2
    ids: list[str | int] = []


class ScenarioFile(Table, frozen=True, kw_only=True):
    """A whole scenario; `fusion` is passed on unread, the fusion centre validates it.

    Attributes:
        name: of the scenario, and of its runs unless they are given another.
        title: for people.
        seed: of every random draw; the same seed gives the same run, to the bit.
        fusion: settings of the fusion, see below.
        carriers: who observes; the first is the own carrier, unless `fusion.own` names another.
        beacons: known places to range to.
        classes: kinds of target with their features.
        targets: one by one; target_groups: many, drawn at random; tracks: from recorded files.
    """

    name: Id
    title: Text = ""
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1
    time: Time
    origin: OriginPoint
    fusion: dict[str, Any] = {}
    errors: Errors = Errors()
    carriers: Annotated[list[Carrier], Meta(min_length=1)]
    beacons: list[Beacon] = []
    classes: list[TargetClass] = []
    targets: list[Target] = []
    target_groups: list[TargetGroup] = []
    tracks: list[Tracks] = []
