"""Beacons, and what measures ranges to them and to other carriers, key by key."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from schemas.messages.values import Id, Metres, Share

from .table import NonNegative, Positive, Table

Scale = Annotated[float, Meta(ge=0, lt=1)]
Drift = Annotated[float, Meta(ge=-1e5, le=1e5)]


class BeaconErrors(Table, frozen=True, kw_only=True):
    """Declared less true place of a beacon; what is absent is drawn from its declared sigma."""

    east_m: Metres | None = None
    north_m: Metres | None = None
    up_m: Metres | None = None


class Beacon(Table, frozen=True, kw_only=True):
    """A beacon: where it truly is, and how well its place is known beforehand.

    Attributes:
        sigma_position_m: of its declared place, per horizontal axis.
        sigma_altitude_m: of its declared altitude.
    """

    name: Id
    east_m: Metres
    north_m: Metres
    altitude_m: Annotated[float, Meta(ge=-500, le=1e5)] = 0.0
    sigma_position_m: NonNegative = 0.0
    sigma_altitude_m: NonNegative = 0.0
    errors: BeaconErrors = BeaconErrors()


class RangingErrors(Table, frozen=True, kw_only=True):
    """The actual errors of a ranging device; what is absent is drawn from its declared sigma."""

    range_bias_m: Metres | None = None
    range_scale: Annotated[float, Meta(gt=-1, lt=1)] | None = None
    clock_m: Metres | None = None
    clock_drift_mps: Drift | None = None


class Ranging(Table, frozen=True, kw_only=True):
    """What a carrier measures ranges with, one of a kind.

    measured = true slant range * (1 + range_scale) + range_bias_m + clocks + noise.

    Attributes:
        kind: two_way needs no clock; a pseudorange holds the receiver's clock less the sender's (a
            beacon's is right); a difference is the range to a peer less that to the first of `to`.
        to: names of beacons and carriers, in this order.
        phase_s: time of the first ranges; without it one period after the start.
        sigma_m: of one range; a difference has that of two.
        range_max_m: a peer further away is not heard.
        outlier_share, outlier_m: share of the ranges that a reflection lengthens, and by how much.
        sigma_clock_m, sigma_clock_drift_mps: of the clock behind pseudoranges, at speed of light.
    """

    kind: Literal["two_way", "pseudorange", "difference"] = "two_way"
    to: Annotated[list[Id], Meta(min_length=1)]
    period_s: Annotated[float, Meta(ge=1e-3, le=1e6)] = 1.0
    phase_s: NonNegative = 0.0
    sigma_m: Positive
    range_max_m: Positive = 1e9
    detection_probability: Share = 1.0
    outlier_share: Share = 0.0
    outlier_m: tuple[NonNegative, NonNegative] = (30.0, 300.0)
    sigma_range_bias_m: NonNegative = 0.0
    sigma_range_scale: Scale = 0.0
    sigma_clock_m: NonNegative = 0.0
    sigma_clock_drift_mps: NonNegative = 0.0
    errors: RangingErrors = RangingErrors()
