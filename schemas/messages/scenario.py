"""The declared part of a scenario: what anyone may know before the run."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from .inputs import SourceProperties
from .values import Angle, Count, Id, Latitude, Longitude, Metres, Range, Share, Text, TimeNs


class Origin(Struct, frozen=True, kw_only=True):
    """Where the axes of the run touch the WGS84 ellipsoid."""

    latitude_rad: Latitude
    longitude_rad: Longitude
    altitude_m: Metres = 0.0


class DeclaredRanging(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a carrier measures ranges with, one of a kind; see `Ranging`.

    Attributes:
        to: beacons and carriers it ranges to.
        sigma_m: of one range.
        sigma_range_bias_m, sigma_range_scale: prior sigmas of the device's systematic errors.
        sigma_clock_m, sigma_clock_drift_mps: prior sigmas of the clock behind its pseudoranges, as
            the way light goes in that time.
    """

    kind: Literal["two_way", "pseudorange", "difference"]
    to: list[Id]
    period_s: Annotated[float, Meta(gt=0, le=1e6)] = 1.0
    sigma_m: Annotated[float, Meta(gt=0, le=1e9)]
    sigma_range_bias_m: Range = 0.0
    sigma_range_scale: Share = 0.0
    sigma_clock_m: Range = 0.0
    sigma_clock_drift_mps: Range = 0.0


class DeclaredCarrier(Struct, frozen=True, kw_only=True):
    """What is declared of a carrier before it speaks.

    Attributes:
        sigma_position_m: prior sigma per axis of its reported position.
        sigma_north_rad: prior sigma of its north.
        sigma_clock_s: prior sigma of its clock at the epoch; sigma_clock_drift: of what it gains in
            every second after that.
        sigma_north_drift_rad_per_sqrt_s: how its north wanders, as a random walk.
        sigma_speed_mps, sigma_current_mps: prior sigmas of the constant errors of its dead
            reckoning: of the log, and of the current per axis.
        sigma_log_noise_mps, sigma_compass_noise_rad: of one reading, anew at every step.
        sources: id -> properties.
        ranging: what it measures ranges with.
        use_corrections: it applies the corrections it is sent.
    """

    name: Id
    sigma_position_m: Range
    sigma_north_rad: Angle
    sigma_clock_s: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    sigma_clock_drift: Range = 0.0
    sigma_north_drift_rad_per_sqrt_s: Range = 0.0
    sigma_speed_mps: Range = 0.0
    sigma_current_mps: Range = 0.0
    sigma_log_noise_mps: Range = 0.0
    sigma_compass_noise_rad: Angle = 0.0
    sources: dict[Id, SourceProperties] = {}
    ranging: list[DeclaredRanging] = []
    use_corrections: bool = False


class DeclaredBeacon(Struct, frozen=True, kw_only=True):
    """A beacon and how well its place is known beforehand, per horizontal axis and in altitude."""

    name: Id
    latitude_rad: Latitude
    longitude_rad: Longitude
    altitude_m: Metres = 0.0
    sigma_position_m: Range
    sigma_altitude_m: Range = 0.0


class DeclaredScenario(Struct, frozen=True, kw_only=True):
    """What anyone may fetch of a run's scenario.

    Attributes:
        epoch_ns: scenario time of step 0.
        step_ns: length of a step; steps: how many there are.
        max_clock_error_s: stamps further from the closing time than this are refused or late.
        fusion: settings of the fusion centre as the file has them, validated by it alone.
    """

    name: Id
    title: Text = ""
    origin: Origin
    epoch_ns: TimeNs
    step_ns: Count
    steps: Count
    max_clock_error_s: Annotated[float, Meta(ge=0, le=1e6)] = 1.0
    carriers: list[DeclaredCarrier]
    beacons: list[DeclaredBeacon] = []
    fusion: dict[str, Any] = {}
