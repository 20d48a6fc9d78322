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
    longest_axis,
    most,
    place_row,
    seen_from,
    timed,
)

_SEAM_RAD = 0.5  # plots nearer to the seam of bearings have a copy beyond it
_REACH = 10.0  # standard deviations that no gate exceeds


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
        return Found(self._places(), covariance, np.maximum(self.range_m, LEAST_M))

    def beside(self, mean: Array) -> list[Row]:
        """See `Measurement`."""
        return self._rate(mean, np.arange(self.size))

    def probes(self, place_m: Array, covariance_m2: Array) -> list[Probe]:
        """In the plane, and by range and bearing in units of their sigmas.

        In the latter the noise is a circle: tracks known better than a plot, far from the sensor,
        meet hardly any plots that are not theirs.
        """
        away = place_m - self.site_m[:, None]
        far = np.maximum(np.hypot(*away), LEAST_M)
        noise = np.stack([np.full_like(far, most(self.sigma_range_m)), far * self._widest_rad()])
        one = np.ones_like(far)
        spread = longest_axis(covariance_m2).max(axis=0) + noise.max(axis=0) ** 2
        plane = Probe(self._places().T, np.arange(self.size), place_m.T, spread, one, one)
        return [plane, self._by_sigmas(away / far, far, covariance_m2, np.maximum(noise, 1e-6))]

    def _places(self) -> Array:
        unit = np.stack([np.sin(self.bearing_rad), np.cos(self.bearing_rad)])
        placed: Array = self.site_m[:, None] + unit * self.range_m
        return placed

    def _widest_rad(self) -> float:
        return max(most(self.sigma_bearing_rad), 1e-9)

    def _by_sigmas(self, unit: Array, far: Array, covariance_m2: Array, noise: Array) -> Probe:
        """Range and bearing by their sigmas; plots near the seam of bearings are there twice.

        Not for tracks that may reach beyond those copies: to them a unit of area is infinite.
        """
        axes = np.stack([unit, np.stack([unit[1], -unit[0]])]) / noise[:, None]
        half = np.einsum("abn,bcmn->acmn", axes, covariance_m2)
        turned = np.einsum("acmn,dcn->admn", half, axes)
        spread = 1.0 + longest_axis(turned).max(axis=0)
        step = self._widest_rad()
        bearing, plot = _unrolled(wrap_pi(self.bearing_rad))
        reach = _REACH * np.sqrt(spread) * step
        return Probe(
            np.stack([self.range_m[plot] / noise[0, :1], bearing / step], axis=-1),
            plot,
            np.stack([far / noise[0], np.arctan2(*unit) / step], axis=-1),
            spread,
            1.0 / noise.min(axis=0),
            np.where(reach < _SEAM_RAD, noise[0] * noise[1], np.inf),
        )

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


def _unrolled(bearing: Array) -> tuple[Array, Indices]:
    """Bearings with copies a turn away of those near the seam, and whose they are."""
    plot = np.arange(len(bearing))
    low = np.flatnonzero(bearing < _SEAM_RAD - np.pi)
    high = np.flatnonzero(bearing > np.pi - _SEAM_RAD)
    turns = np.concatenate([bearing, bearing[low] + 2 * np.pi, bearing[high] - 2 * np.pi])
    return turns, np.concatenate([plot, low, high])


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
