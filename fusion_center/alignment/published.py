"""What an alignment of a carrier and its beacons knows, in words, and as it is published."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import polar_from_east_north
from estimation.system_alignment import Filtered, Prior, dead_reckoning, ranges
from estimation.system_alignment.model import Model
from estimation.system_alignment.observability import diagnosis
from estimation.system_alignment.parameters import (
    CLOCK_DRIFT,
    CLOCK_OFFSET,
    HEADING_BIAS,
    RANGE_SCALE,
    SPEED_SCALE,
    WIND,
    places_of,
)
from schemas.messages import AlignedBeacon, AlignedCarrier

from ..navigation import NS, triangle_of
from ..state import Aligned, State

_DETERMINED, _WEAK = 0.5, 0.9  # posterior over prior sigma
_TOUCHED = 0.3  # prior sigmas of a beacon's place, from which it takes part in a direction
_NOTHING = ranges([], [], [], [])


def prior_of(known: Aligned) -> Prior:
    """What was known of the constants before the first range."""
    return Prior(known.prior_mean, np.diag(known.prior_sigma**2))


def filter_of(known: Aligned) -> Filtered:
    """The filter as the estimation has it."""
    since_s = (known.t_ns - known.start_t_ns) * NS
    return Filtered(known.place, known.theta, known.covariance, since_s, known.free)


def diagnosed(known: Aligned, height_m: float) -> Aligned:
    """With what the ranges so far do not tell, in words.

    The filter's own covariance is asked; the way so far, as one step, only gives motions names.
    """
    if len(known.free) == 0:
        return replace(known, ratio=0.0, diagnosed_t_ns=known.t_ns)
    b, now, before = len(known.place), filter_of(known), prior_of(known)
    passed_s = max(now.time_s, 1.0)
    bearing, length = polar_from_east_north(known.place[:2] - known.start_m)
    way = dead_reckoning(
        [passed_s], length / passed_s, bearing, 0, 0, height_m=height_m, start_m=known.start_m
    )
    model = Model(way, _NOTHING, before)
    information: Array = np.linalg.inv(known.covariance[b:, b:]).astype(float)
    found = diagnosis(model, known.theta[known.free], information)
    names, where = known.beacons, places_of(known.theta)
    sigma = np.where(known.prior_sigma > 0, known.prior_sigma, np.inf)
    shares = [
        np.abs(direction.motion / sigma)[where].max(axis=1) for direction in found.undetermined
    ]
    return replace(
        known,
        ratio=float(found.ratios[0]),
        hidden=tuple(_in_words(direction.name, names) for direction in found.undetermined),
        touched=tuple(
            tuple(name for name, part in zip(names, share, strict=True) if part > _TOUCHED)
            for share in shares
        ),
        diagnosed_t_ns=known.t_ns,
    )


def _in_words(name: str, beacons: Sequence[str]) -> str:
    """A direction with its beacons by name instead of by number, and the wind as a current."""
    for i in reversed(range(len(beacons))):
        name = name.replace(f"beacon {i + 1}", f"beacon {beacons[i]}")
    return name.replace("wind", "current")


def beacons(state: State) -> list[AlignedBeacon]:
    """Every beacon as each carrier that ranges to it finds it."""
    each = sorted(state.aligned.items())
    return [beacon for carrier, known in each for beacon in _beacons(carrier, known)]


def carriers(state: State) -> list[AlignedCarrier]:
    """The carriers that range to beacons."""
    return [_carrier(name, known) for name, known in sorted(state.aligned.items())]


def _beacons(carrier: str, known: Aligned) -> Iterator[AlignedBeacon]:
    covariance = filter_of(known).theta_covariance
    for name, where in zip(known.beacons, places_of(known.theta), strict=True):
        directions = zip(known.hidden, known.touched, strict=True)
        yield AlignedBeacon(
            beacon=name,
            position_m=known.theta[where].tolist(),
            covariance=triangle_of(covariance[np.ix_(where, where)]),
            unobservable=[words for words, touched in directions if name in touched],
            carrier=carrier,
        )


def _carrier(name: str, known: Aligned) -> AlignedCarrier:
    now = filter_of(known)
    covariance = now.theta_covariance
    sigma, theta = np.sqrt(np.diag(covariance)), known.theta
    north_rad, sigma_north_rad = _north(known, covariance)
    return AlignedCarrier(
        carrier=name,
        status=_status(known),
        t_ns=known.t_ns,
        position_m=known.place[:2].tolist(),
        covariance=triangle_of(known.covariance[:2, :2]),
        current_mps=theta[WIND].tolist(),
        current_covariance=triangle_of(covariance[WIND, WIND]),
        north_rad=north_rad,
        sigma_north_rad=sigma_north_rad,
        speed_scale=float(theta[SPEED_SCALE]),
        sigma_speed_scale=float(sigma[SPEED_SCALE]),
        range_scale=float(theta[RANGE_SCALE]),
        sigma_range_scale=float(sigma[RANGE_SCALE]),
        range_bias_m=float(theta[CLOCK_OFFSET]),
        sigma_range_bias_m=float(sigma[CLOCK_OFFSET]),
        clock_drift_mps=float(theta[CLOCK_DRIFT]),
        sigma_clock_drift_mps=float(sigma[CLOCK_DRIFT]),
        ranges=known.ranges,
        unobservable=list(known.hidden),
    )


def _north(known: Aligned, covariance: Array) -> tuple[float, float]:
    """Bearing of the carrier's own north and its sigma: the constant, and what it has wandered."""
    value, variance = known.theta[HEADING_BIAS], covariance[HEADING_BIAS, HEADING_BIAS]
    if len(known.place) == 3:
        tied = known.covariance[2, 3 + np.flatnonzero(known.free == HEADING_BIAS)].sum()
        value += known.place[2]
        variance += known.covariance[2, 2] + 2 * tied
    return float(value), float(np.sqrt(max(variance, 0.0)))


def _status(known: Aligned) -> Literal["determined", "weak", "undetermined"]:
    if known.ratio < _DETERMINED:
        return "determined"
    return "weak" if known.ratio < _WEAK else "undetermined"
