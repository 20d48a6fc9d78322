"""How a carrier comes to be wrong about where it is and where north lies.

It reckons its way from its log and its compass: through the water at the speed the log shows,
along the heading it believes, knowing nothing of the current. So its error is that of its first
position, plus the integral of believed less true velocity:

    e(t) = e(0) + integral of (s + ds) u(psi - n) - s u(psi) - c,    u(a) = (sin a, cos a)

with s, psi speed and heading through the water, ds the error of the log, c the current and n the
bearing of its own north, which wanders at random; log and compass are read anew at every step, with
noise. Errors are in the carrier's local east-north.
The carrier declares the covariance of (e, n) that its sigmas make of this, to first order in n.
"""

from __future__ import annotations

from math import radians
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, transposed
from estimation.frames import Site, geodetic_from_enu, rotation_clockwise, wrap_pi

from .clocks import clock_offset_s
from .motion import Kinematics, Paths, path_of
from .noise import generator
from .scenario.file import Carrier, Fix, FrameErrors, NavigationPrior, ScenarioFile

_STILL_MPS = 1e-6
_LEAST_SIGMAS = (1e-3, 1e-3, 1e-8)  # m, m, rad: a covariance on the wire has an inverse
_HOUR_S = 3600.0


class FrameError(NamedTuple):
    """The actual errors a carrier starts with, after drawing; the clock's in s and ppm."""

    position_m: Array
    north_rad: float
    speed_mps: float
    current_mps: Array
    clock_s: float
    clock_drift_ppm: float


class Voyage(NamedTuple):
    """One carrier at every step 0 .. K-1, as it is and as it believes.

    Attributes:
        truth: its motion (K, 3) in the axes of the scenario's origin.
        heading_rad: of the bow, clockwise from true north where it is (K,).
        north_error_rad: bearing of its own north, clockwise from true north (K,).
        clock_offset_s: its clock less true time (K,).
        position_error_m: reported less true position, local east and north (K, 2).
        way_m: what it has reckoned since step 0, local east and north (K, 2).
        log_mps: speed that its log shows (K,).
        compass_rad: heading that its compass shows, clockwise from its own north (K,).
        fixed: whether the position comes of a fix at this very step (K,).
        fix_step: the step that reckoning started from, 0 or that of the last fix (K,).
    """

    truth: Kinematics
    heading_rad: Array
    north_error_rad: Array
    clock_offset_s: Array
    position_error_m: Array
    way_m: Array
    log_mps: Array
    compass_rad: Array
    fixed: np.ndarray
    fix_step: np.ndarray


def sail(file: ScenarioFile, carrier: Carrier, origin: Site, steps: int) -> Voyage:
    """A carrier's whole voyage, steps 0 .. `steps`, from its part of the scenario alone."""
    t = np.arange(steps + 1).astype(float) * file.time.step_s
    error = frame_error(file, carrier)
    truth, course = Paths(origin, [path_of(carrier.motion)]).at(t, np.zeros(steps + 1, dtype=int))
    convergence = _convergence_rad(origin, truth.position_m)
    over_ground = _turned(truth.velocity_mps[:, :2], -convergence)
    through_water = over_ground - error.current_mps
    speed = np.hypot(*through_water.T)
    heading = np.where(speed < _STILL_MPS, course - convergence, np.arctan2(*through_water.T))
    north = error.north_rad + _wander(file, carrier, t)
    read = _reading_noise(file, carrier, steps)
    too_fast = error.speed_mps + read[:, 0]
    compass = wrap_pi(heading - north + read[:, 1])
    believed = _turned(through_water, read[:, 1] - north) + too_fast[:, None] * _unit(compass)
    fixed, fix_step = _fixes(carrier.navigation.fix, t)
    drifted = error.position_m + _integral(believed - over_ground, file.time.step_s)
    return Voyage(
        truth=truth,
        heading_rad=wrap_pi(heading),
        north_error_rad=north,
        clock_offset_s=clock_offset_s(t, error.clock_s, error.clock_drift_ppm),
        position_error_m=_refixed(file, carrier, drifted, fixed, fix_step),
        way_m=_integral(believed, file.time.step_s),
        log_mps=speed + too_fast,
        compass_rad=compass,
        fixed=fixed,
        fix_step=fix_step,
    )


def frame_error(file: ScenarioFile, carrier: Carrier) -> FrameError:
    """The errors given in the file, or drawn from their sigmas; all zero where disabled."""
    prior, given = carrier.navigation, carrier.errors
    sigmas = _sigmas(prior)
    draws = generator(file.seed, "carrier", carrier.name, "errors").standard_normal(len(sigmas))
    values = [
        sigma * draw if value is None else value
        for sigma, draw, value in zip(sigmas, draws, _values(given), strict=True)
    ]
    east, north, turn, speed, current_east, current_north, clock, drift = (
        values if file.errors.enabled else [0.0] * len(values)
    )
    return FrameError(
        position_m=np.array([east, north]),
        north_rad=radians(turn),
        speed_mps=float(speed),
        current_mps=np.array([current_east, current_north]),
        clock_s=float(clock),
        clock_drift_ppm=float(drift),
    )


def declared_covariances(prior: NavigationPrior, voyage: Voyage, step_s: float) -> Array:
    """Covariances (K, 3, 3) of (east, north, own north) as the carrier can honestly claim them.

    Error is what the frame is less what is true: reported less true position, and the bearing of
    own north, clockwise from true north. It is propagated along the way the carrier believes.
    """
    fix = voyage.fix_step
    since_s = (np.arange(len(fix)) - fix) * step_s
    first_m = prior.fix.sigma_m if prior.fix else prior.sigma_position_m
    wander = radians(prior.sigma_north_drift_deg_per_sqrt_h) ** 2 / _HOUR_S
    north_at_fix = radians(prior.sigma_north_deg) ** 2 + wander * fix * step_s
    lever = np.column_stack([-voyage.way_m[:, 1], voyage.way_m[:, 0]])  # d e / d n
    by_north = lever - lever[fix]
    by_speed = _integral(_unit(voyage.compass_rad), step_s)
    by_speed -= by_speed[fix]
    walk, walk_squared = _random_walk(lever, fix, step_s)
    covariance = np.zeros((len(fix), 3, 3))
    covariance[:, :2, :2] = (
        (first_m**2 + (prior.sigma_current_mps * since_s) ** 2)[:, None, None] * np.eye(2)
        + north_at_fix[:, None, None] * _outer(by_north, by_north)
        + prior.sigma_speed_mps**2 * _outer(by_speed, by_speed)
        + wander * walk_squared
        + _of_readings(prior, voyage, step_s)
    )
    covariance[:, :2, 2] = north_at_fix[:, None] * by_north + wander * walk
    covariance[:, 2, :2] = covariance[:, :2, 2]
    covariance[:, 2, 2] = north_at_fix + wander * since_s
    covariance += np.diag(np.square(_LEAST_SIGMAS))
    return covariance


def _of_readings(prior: NavigationPrior, voyage: Voyage, step_s: float) -> Array:
    """Covariances (K, 2, 2) that the noise of log and compass since the fix gives the position.

    A reading counts for half a step on either side: at both ends of the way only one half counts.
    """
    along, read = _unit(voyage.compass_rad), radians(prior.sigma_compass_noise_deg)
    across = voyage.log_mps[:, None] * np.column_stack([along[:, 1], -along[:, 0]])
    of_one = prior.sigma_log_noise_mps**2 * _outer(along, along) + read**2 * _outer(across, across)
    first, total = of_one[voyage.fix_step], np.cumsum(of_one, axis=0)
    since = total - total[voyage.fix_step] + first - 0.75 * (first + of_one)
    since[voyage.fix_step == np.arange(len(since))] = 0.0
    covariance: Array = step_s**2 * since
    return covariance


def _random_walk(lever: Array, fix: np.ndarray, step_s: float) -> tuple[Array, Array]:
    """Sums over the steps j since the fix of (lever - lever_j) and of its square, times a step.

    They are what unit steps of a north that walks at random have added to (e, n) and (e, e).
    """
    count = (np.arange(len(fix)) - fix)[:, None]
    total = np.cumsum(lever, axis=0)
    total -= total[fix]
    squares = np.cumsum(_outer(lever, lever), axis=0)
    squares -= squares[fix]
    crossed = _outer(lever, total)
    walk_squared = count[:, None] * _outer(lever, lever) - crossed - transposed(crossed) + squares
    return step_s * (count * lever - total), step_s * walk_squared


def _sigmas(prior: NavigationPrior) -> tuple[float, ...]:
    return (
        prior.sigma_position_m,
        prior.sigma_position_m,
        prior.sigma_north_deg,
        prior.sigma_speed_mps,
        prior.sigma_current_mps,
        prior.sigma_current_mps,
        prior.sigma_clock_s,
        prior.sigma_clock_drift_ppm,
    )


def _values(given: FrameErrors) -> tuple[float | None, ...]:
    return (
        given.position_east_m,
        given.position_north_m,
        given.north_deg,
        given.speed_mps,
        given.current_east_mps,
        given.current_north_mps,
        given.clock_s,
        given.clock_drift_ppm,
    )


def _wander(file: ScenarioFile, carrier: Carrier, t: Array) -> Array:
    """What own north has wandered since step 0 (K,) [rad], a random walk."""
    sigma = radians(carrier.navigation.sigma_north_drift_deg_per_sqrt_h)
    if not file.errors.enabled or sigma == 0:
        return np.zeros_like(t)
    rng = generator(file.seed, "carrier", carrier.name, "north")
    steps = rng.standard_normal(len(t) - 1) * sigma * np.sqrt(file.time.step_s / _HOUR_S)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _reading_noise(file: ScenarioFile, carrier: Carrier, steps: int) -> Array:
    """What log [m/s] and compass [rad] show too much at every step (K, 2)."""
    prior = carrier.navigation
    sigmas = np.array([prior.sigma_log_noise_mps, radians(prior.sigma_compass_noise_deg)])
    if not file.errors.enabled or not sigmas.any():
        return np.zeros((steps + 1, 2))
    rng = generator(file.seed, "carrier", carrier.name, "readings")
    noise: Array = rng.standard_normal((steps + 1, 2)) * sigmas
    return noise


def _fixes(fix: Fix | None, t: Array) -> tuple[np.ndarray, np.ndarray]:
    """Which steps (K,) bring a fix, and from which step on each of them reckons."""
    if fix is None:
        return np.zeros(len(t), dtype=bool), np.zeros(len(t), dtype=int)
    count = np.floor(t / fix.period_s + 1e-9)
    fixed = np.diff(count, prepend=-1.0) > 0
    return fixed, np.maximum.accumulate(np.where(fixed, np.arange(len(t)), 0))


def _refixed(
    file: ScenarioFile, carrier: Carrier, drifted: Array, fixed: np.ndarray, fix_step: np.ndarray
) -> Array:
    """Position errors (K, 2) when each fix replaces what had drifted until then."""
    if carrier.navigation.fix is None:
        return drifted
    rng = generator(file.seed, "carrier", carrier.name, "fix")
    noise = rng.standard_normal((int(fixed.sum()), 2)) * carrier.navigation.fix.sigma_m
    at_fix: Array = noise[np.cumsum(fixed) - 1] * file.errors.enabled
    since_fix: Array = drifted - drifted[fix_step]
    return at_fix + since_fix


def _convergence_rad(origin: Site, position_m: Array) -> Array:
    """Bearing of the local north (K,) in the axes at the origin."""
    latitude, longitude, _ = geodetic_from_enu(origin, position_m)
    east_of = longitude - origin.longitude_rad
    sin, cos = np.sin(latitude), np.cos(latitude)
    sin_0, cos_0 = np.sin(origin.latitude_rad), np.cos(origin.latitude_rad)
    bearing: Array = np.arctan2(-sin * np.sin(east_of), sin_0 * sin * np.cos(east_of) + cos_0 * cos)
    return bearing


def _turned(vectors: Array, angle_rad: Array) -> Array:
    """East-north vectors (K, 2) turned clockwise by angles (K,)."""
    turned: Array = (rotation_clockwise(angle_rad) @ vectors[..., None])[..., 0]
    return turned


def _unit(bearing_rad: Array) -> Array:
    return np.column_stack([np.sin(bearing_rad), np.cos(bearing_rad)])


def _integral(rate: Array, step_s: float) -> Array:
    """Integral (K, 2) from step 0 on, by the trapezoidal rule."""
    whole = np.zeros_like(rate)
    np.cumsum((rate[1:] + rate[:-1]) * (step_s / 2), axis=0, out=whole[1:])
    return whole


def _outer(a: Array, b: Array) -> Array:
    """Products (K, 2, 2) of vectors (K, 2)."""
    return a[:, :, None] * b[:, None, :]
