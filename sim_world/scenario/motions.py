"""How targets and carriers move, key by key: the motions and recorded tracks of a scenario file.

A motion starts where its target does: at `start_s`.
"""

from __future__ import annotations

from datetime import datetime
from math import inf
from typing import Annotated, Literal

from msgspec import Meta

from schemas.messages.values import Metres

from .table import Degrees, NonNegative, Point, Positive, Speed, Table

Instant = Annotated[datetime, Meta(tz=True)]


class Motion(Table, frozen=True, kw_only=True, tag_field="kind"):
    """How something moves; `kind` chooses among the motions below."""

    altitude_m: Annotated[float, Meta(ge=-500, le=1e5)] = 0.0


class ConstantVelocity(Motion, frozen=True, kw_only=True, tag="constant_velocity"):
    """Straight on; speed 0 stands still, its bow along `course_deg`."""

    east_m: Metres
    north_m: Metres
    course_deg: Degrees = 0.0
    speed_mps: Speed = 0.0


class ConstantAcceleration(Motion, frozen=True, kw_only=True, tag="constant_acceleration"):
    """Straight on, faster or slower, until `speed_limit_mps` (default when slowing down: 0)."""

    east_m: Metres
    north_m: Metres
    course_deg: Degrees
    speed_mps: Speed
    acceleration_mps2: Annotated[float, Meta(ge=-1e3, le=1e3)]
    speed_limit_mps: Speed | None = None


class CoordinatedTurn(Motion, frozen=True, kw_only=True, tag="coordinated_turn"):
    """A circle, clockwise where the rate is positive; straight before and after the turn.

    Attributes:
        from_s, until_s: of the turn, counted from the start of the motion.
    """

    east_m: Metres
    north_m: Metres
    course_deg: Degrees
    speed_mps: Speed
    turn_rate_deg_s: Annotated[float, Meta(ge=-90, le=90)]
    from_s: NonNegative = 0.0
    until_s: Positive = inf


class Waypoints(Motion, frozen=True, kw_only=True, tag="waypoints"):
    """Along a line of points at constant speed, corners rounded; on past the last one.

    Attributes:
        turn_radius_m: of the corners; smaller where the legs are too short for it.
        closed: the last point leads back to the first, round and round.
        start_along_m: how far along the line it is at the start.
    """

    points_m: Annotated[list[Point], Meta(min_length=2)]
    speed_mps: Annotated[float, Meta(gt=0, le=3e4)]
    turn_radius_m: Positive = 200.0
    closed: bool = False
    start_along_m: NonNegative = 0.0


class Columns(Table, frozen=True, kw_only=True):
    """Which column of a CSV file holds what; times are ISO 8601 (UTC) or Unix seconds."""

    time: str
    id: str
    latitude_deg: str
    longitude_deg: str
    altitude_m: str = ""
    speed_mps: str = ""
    speed_knots: str = ""
    course_deg: str = ""


class TrackFile(Table, frozen=True, kw_only=True):
    """A file of recorded tracks and how to read it.

    Attributes:
        file: CSV, also gzipped; sought beside the scenario, then in the data folder.
        start: time in the file that is second 0 of the scenario.
        resample: cubic (Hermite, through reported velocities where there are any) or linear.
        min_interval_s: closer reports are thinned, their time stamps jitter.
        max_gap_s: in a longer silence there is no target.
        altitude_m: where no column says it.
    """

    file: Annotated[str, Meta(min_length=1)]
    columns: Columns
    start: Instant
    resample: Literal["cubic", "linear"] = "cubic"
    min_interval_s: NonNegative = 10.0
    max_gap_s: Positive = 300.0
    altitude_m: Annotated[float, Meta(ge=-500, le=1e5)] = 0.0


class Track(TrackFile, frozen=True, kw_only=True, tag_field="kind", tag="track"):
    """The recorded track with this `id`; the target exists only while it was reported."""

    id: str | int


PathMotion = ConstantVelocity | ConstantAcceleration | CoordinatedTurn | Waypoints
AnyMotion = ConstantVelocity | ConstantAcceleration | CoordinatedTurn | Waypoints | Track
