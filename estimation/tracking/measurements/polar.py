"""Bearings with ranges, and range rates where a sensor has them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices
from estimation.frames import wrap_pi
from estimation.tracking.measurements.kinds import Found, Probe, Row
from estimation.tracking.measurements.line_of_sight import (
    LEAST_M,
    columns,
    most,
    place_row,
    seen_from,
    timed,
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

    def rows(self, mean: Array, plot: Indices) -> list[Row]:
        """See `Measurement`."""
        seen = seen_from(self.site_m, mean, self.offset_s[plot])
        along = place_row(
            seen, seen.unit, self.range_m[plot] - seen.range_m, self.sigma_range_m[plot]
        )
        turned = wrap_pi(self.bearing_rad[plot] - seen.bearing_rad)
        across = place_row(seen, seen.across / seen.range_m, turned, self.sigma_bearing_rad[plot])
        late = self.sigma_offset_s[plot]
        return [timed(along, mean, late), timed(across, mean, late), *self._rate(mean, plot)]

    def found(self) -> Found:
        """See `Measurement`."""
        unit = np.stack([np.sin(self.bearing_rad), np.cos(self.bearing_rad)])
        across = np.stack([unit[1], -unit[0]]) * (self.range_m * self.sigma_bearing_rad)
        along = unit * self.sigma_range_m
        covariance = along[:, None] * along + across[:, None] * across
        place = self.site_m[:, None] + unit * self.range_m
        return Found(place, covariance, np.maximum(self.range_m, LEAST_M))

    def beside(self, mean: Array) -> list[Row]:
        """See `Measurement`."""
        return self._rate(mean, np.arange(self.size))

    def probe(self, place_m: Array) -> Probe:
        """See `Measurement`."""
        far = np.hypot(*(place_m - self.site_m[:, None]))
        sigma = np.maximum(far * most(self.sigma_bearing_rad), most(self.sigma_range_m))
        return Probe(self.found().place_m.T, place_m.T, sigma, np.ones_like(far))

    def _rate(self, mean: Array, plot: Indices) -> list[Row]:
        if self.range_rate is None:
            return []
        seen = seen_from(self.site_m, mean, self.offset_s[plot])
        given, sigma = self.range_rate.value_mps[plot], self.range_rate.sigma_mps[plot]
        absent = np.isnan(given)
        velocity = mean[2:] - self.range_rate.carrier_mps[:, None, None]
        rate = (velocity * seen.unit).sum(axis=0)
        turn = (velocity * seen.across).sum(axis=0) / seen.range_m
        gradient = np.concatenate([turn * seen.across, seen.unit])
        gradient[2:] += gradient[:2] * self.offset_s[plot]
        residual = np.where(absent, 0.0, given - rate)
        variance = np.broadcast_to(np.where(absent, 1.0, sigma) ** 2, rate.shape)
        span = math.log(self.range_rate.clutter_span_mps)
        nothing = 0.5 * np.log(2 * np.pi * variance[0])
        return [
            Row(
                np.where(absent, 0.0, gradient), residual, variance, np.where(absent, nothing, span)
            )
        ]


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
