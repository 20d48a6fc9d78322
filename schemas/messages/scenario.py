"""The declared part of a scenario: what anyone may know before the run."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta, Struct

from .inputs import SourceProperties
from .values import Angle, Count, Id, Latitude, Longitude, Metres, Range, Text, TimeNs


class Origin(Struct, frozen=True, kw_only=True):
    """Where the axes of the run touch the WGS84 ellipsoid."""

    latitude_rad: Latitude
    longitude_rad: Longitude
    altitude_m: Metres = 0.0


class DeclaredCarrier(Struct, frozen=True, kw_only=True):
    """What is declared of a carrier before it speaks.

    Attributes:
        sigma_position_m: prior sigma per axis of its reported position.
        sigma_north_rad: prior sigma of its north.
        sigma_clock_s: prior sigma of its clock.
        sources: id -> properties.
        use_corrections: it applies the corrections it is sent.
    """

    name: Id
    sigma_position_m: Range
    sigma_north_rad: Angle
    sigma_clock_s: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    sources: dict[Id, SourceProperties] = {}
    use_corrections: bool = False


class DeclaredBeacon(Struct, frozen=True, kw_only=True):
    """A beacon and how well its place is known beforehand."""

    name: Id
    latitude_rad: Latitude
    longitude_rad: Longitude
    sigma_position_m: Range


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
