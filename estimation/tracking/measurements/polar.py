"""Bearings with ranges, and range rates where a sensor has them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.tracking.measurements.kinds import Expected, Found, Readings
from estimation.tracking.measurements.line_of_sight import (
    LEAST_M,
    Seen,
    by_state,
    columns,
    independent,
    seen_from,
)


class RangeRate(NamedTuple):
    """Rate of range of m plots [m/s]; nan where a plot has none.

    Attributes:
        value_mps, sigma_mps: (m,).
        carrier_mps: (2,) velocity of the sensor; zeros if the values are compensated for it.
        clutter_span_mps: false plots are spread evenly over this width, which makes the density of
            a value comparable with that of no value.
    """

    value_mps: Array
    sigma_mps: Array
    carrier_mps: Array
    clutter_span_mps: float = 600.0


class Polar(NamedTuple):
    """Bearings and ranges of m plots; all arrays (m,), see `polar`."""

    site_m: Array
    bearing_rad: Array
    range_m: Array
    sigma_bearing_rad: Array
    sigma_range_m: Array
    offset_s: Array
    sigma_offset_s: Array
    range_rate: RangeRate | None = None

    @property
    def size(self) -> int:
        """See `Measurement`."""
        return len(self.bearing_rad)

    def readings(self) -> Readings:
        """See `Measurement`."""
        values = [self.range_m, self.bearing_rad]
        sigmas = [self.sigma_range_m, self.sigma_bearing_rad]
        span = 1.0
        if self.range_rate is not None:
            values.append(self.range_rate.value_mps)
            sigmas.append(self.range_rate.sigma_mps)
            span = self.range_rate.clutter_span_mps
        return Readings(
            np.stack(values),
            independent(*sigmas),
            (False, True, False)[: len(values)],
            (0.0, 0.0, math.log(span))[: len(values)],
            self.offset_s,
            self.sigma_offset_s,
        )

    def expected(self, mean: Array, offset_s: Array | float) -> Expected:
        """See `Measurement`."""
        seen = seen_from(self.site_m, mean, offset_s)
        values = [seen.range_m, seen.bearing_rad]
        slopes = [by_state(slope, offset_s) for slope in (seen.unit, seen.across / seen.range_m)]
        if self.range_rate is not None:
            rate, slope = _rate(seen, mean[2:] - self.range_rate.carrier_mps[:, None, None])
            slope[2:] += slope[:2] * offset_s
            values.append(rate)
            slopes.append(slope)
        return Expected(np.stack(values), np.stack(slopes))

    def found(self) -> Found:
        """See `Measurement`."""
        unit = np.stack([np.sin(self.bearing_rad), np.cos(self.bearing_rad)])
        across = np.stack([unit[1], -unit[0]]) * (self.range_m * self.sigma_bearing_rad)
        along = unit * self.sigma_range_m
        covariance = along[:, None] * along + across[:, None] * across
        place = self.site_m[:, None] + unit * self.range_m
        return Found(place, covariance, np.maximum(self.range_m, LEAST_M))


def _rate(seen: Seen, velocity: Array) -> tuple[Array, Array]:
    """Rate of range (2, k) by velocities (2, 2, k), and its gradient by place and velocity."""
    turn = (velocity * seen.across).sum(axis=0) / seen.range_m
    slope = np.concatenate([turn * seen.across, seen.unit])
    return (velocity * seen.unit).sum(axis=0), slope


def polar(
    site_m: Array,
    bearing_rad: Array,
    range_m: Array,
    sigma_bearing_rad: Array | float,
    sigma_range_m: Array | float,
    offset_s: Array | float = 0.0,
    sigma_offset_s: Array | float = 0.0,
    range_rate: RangeRate | None = None,
) -> Polar:
    """Plots of a sensor at `site_m` (2,); sigmas and time offsets (m,) or one for all."""
    bearing, far, sigma_bearing, sigma_range, offset, sigma_offset = columns(
        bearing_rad, range_m, sigma_bearing_rad, sigma_range_m, offset_s, sigma_offset_s
    )
    site = np.asarray(site_m, dtype=float)
    return Polar(site, bearing, far, sigma_bearing, sigma_range, offset, sigma_offset, range_rate)
