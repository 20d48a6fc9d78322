"""What is known of targets before the first bearing, as rows beside those of the bearings."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.bearings_only.measurements import ComplexArray, Scene
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.normal_equations import directions, products, unpacked

_BEARING_SIGMA_RAD = np.sqrt(2 * np.pi)  # a Gaussian as high as the uniform density 1 / (2 pi)
_MIDDLE_SIGMA = np.sqrt(2 / np.pi)  # likewise 1 / 2, over the whole observation


class MotionPrior(NamedTuple):
    """Sigmas of a target's range and motion; wide, for ships. Aircraft want other numbers.

    Attributes:
        range_m, sigma_log_range: median and logarithmic sigma at the last bearing.
        sigma_speed_mps: of each component of the velocity.
        sigma_acceleration_mps2, sigma_jerk_mps3: of each component, and of the acceleration
            along the course.
        sigma_turn_rate_rad_s: of a turn that lasts.
        sigma_turn_rad: of the angle of a turn that ends.
        turn_duration_s, sigma_log_duration: median and logarithmic sigma.
    """

    range_m: float = 6000.0
    sigma_log_range: float = 1.2
    sigma_speed_mps: float = 8.0
    sigma_acceleration_mps2: float = 0.03
    sigma_jerk_mps3: float = 1e-4
    sigma_turn_rate_rad_s: float = 0.01
    sigma_turn_rad: float = 1.5
    turn_duration_s: float = 45.0
    sigma_log_duration: float = 0.8


class PriorRows(NamedTuple):
    """Residuals of a prior.

    Attributes:
        residual: (R, B).
        jacobian: (M, R, B).
        scaled: rows that speak of metres, the first ones; the others speak of the track's form.
    """

    residual: Array
    jacobian: Array
    scaled: int

    def of_shape(self) -> PriorRows:
        """The rows that hold whatever the range is."""
        return PriorRows(self.residual[self.scaled :], self.jacobian[:, self.scaled :], 0)


def prior_rows(scene: Scene, motion: Motion, prior: MotionPrior, p: Array) -> PriorRows:
    """The rows at p; infinite range and what lies beyond have no residual (NaN)."""
    c, s, shape = unpacked(motion, p)
    at = _Point(scene, prior, motion, c, np.where(s > 0, s, np.nan))
    informed = [k for k, name in enumerate(motion.shape_names) if name in _SHAPE_ROWS]
    scaled = 1 + 2 * motion.degree + ("kappa" in motion.shape_names)
    rows = PriorRows(
        np.zeros((1 + 2 * motion.degree + len(informed), p.shape[1])),
        np.zeros((len(p), 1 + 2 * motion.degree + len(informed), p.shape[1])),
        scaled,
    )
    _range_row(at, p, rows)
    for order in range(1, motion.degree + 1):
        _derivative_rows(at, order, rows)
    for i, k in enumerate(informed, start=1 + 2 * motion.degree):
        parameter = motion.scale_row + 1 + k
        _SHAPE_ROWS[motion.shape_names[k]](at, shape[k], rows, i, parameter)
    return rows


class _Point(NamedTuple):
    """Where the rows are wanted: coefficients (K, B) and scale (B,), with the units."""

    scene: Scene
    prior: MotionPrior
    motion: Motion
    c: ComplexArray
    s: Array

    def unit(self, order: int) -> Array:
        """Metres by seconds to the `order`, of a coefficient over s."""
        return self.scene.length_m / self.scene.half_span_s**order / self.s


def _range_row(at: _Point, p: Array, rows: PriorRows) -> None:
    """The logarithm of the range at the last bearing."""
    d, by = _last_direction(at.scene, at.motion, p)
    sigma = at.prior.sigma_log_range
    median = at.prior.range_m / at.scene.length_m
    rows.residual[0] = np.log(np.abs(d) / (at.s * median)) / sigma
    rows.jacobian[:, 0] = (by / d).real / sigma
    rows.jacobian[at.motion.scale_row, 0] -= 1 / at.s / sigma


def _last_direction(scene: Scene, motion: Motion, p: Array) -> tuple[ComplexArray, ComplexArray]:
    last = scene._replace(time=scene.time[-1:], observer=scene.observer[-1:])
    d, by = directions(last, motion, p)
    return d[0], by[:, 0]


def _derivative_rows(at: _Point, order: int, rows: PriorRows) -> None:
    """Velocity, acceleration or jerk, east and north."""
    prior = at.prior
    sigmas = (prior.sigma_speed_mps, prior.sigma_acceleration_mps2, prior.sigma_jerk_mps3)
    unit = at.unit(order) / sigmas[min(order, 3) - 1]
    value = at.c[order] * unit
    for part, row, parameter in (
        (value.real, 2 * order - 1, order),
        (value.imag, 2 * order, at.motion.degree + 1 + order),
    ):
        rows.residual[row] = part
        rows.jacobian[parameter, row] = unit
        rows.jacobian[at.motion.scale_row, row] = -part / at.s


def _kappa(at: _Point, kappa: Array, rows: PriorRows, row: int, parameter: int) -> None:
    """Acceleration along the course, kappa times the speed."""
    by_kappa = np.abs(at.c[1]) * at.unit(2) / at.prior.sigma_acceleration_mps2
    value = kappa * by_kappa
    by_c = value * at.c[1] / (np.abs(at.c[1]) ** 2 + 1e-300)
    rows.residual[row] = value
    rows.jacobian[[1, 3, 4, parameter], row] = by_c.real, by_c.imag, -value / at.s, by_kappa


def _omega(at: _Point, omega: Array, rows: PriorRows, row: int, parameter: int) -> None:
    by = 1 / (at.scene.half_span_s * at.prior.sigma_turn_rate_rad_s)
    rows.residual[row], rows.jacobian[parameter, row] = omega * by, by


def _angle(at: _Point, angle: Array, rows: PriorRows, row: int, parameter: int) -> None:
    by = 1 / at.prior.sigma_turn_rad
    rows.residual[row], rows.jacobian[parameter, row] = angle * by, by


def _duration(at: _Point, log_duration: Array, rows: PriorRows, row: int, parameter: int) -> None:
    by = 1 / at.prior.sigma_log_duration
    longer = log_duration + np.log(at.scene.half_span_s / at.prior.turn_duration_s)
    rows.residual[row], rows.jacobian[parameter, row] = longer * by, by


_SHAPE_ROWS: dict[str, Callable[[_Point, Array, PriorRows, int, int], None]] = {
    "kappa": _kappa,
    "omega": _omega,
    "angle": _angle,
    "duration": _duration,
}
"""A turn may come at any time: "middle" has none."""


def volume(scene: Scene, motion: Motion, rows: PriorRows, p: Array) -> Array:
    """Information (M, M, B) of all that is known beforehand, uniform priors as well, at p."""
    return products(rows.residual, rows.jacobian)[1] + _flat_information(scene, motion, p)


def _flat_information(scene: Scene, motion: Motion, p: Array) -> Array:
    """Information (M, M, B) as of the uniform priors, of bearing and turn times.

    It is no part of the criterion; it is what makes the prior's volume a number.
    """
    d, by = _last_direction(scene, motion, p)
    row = (by / d).imag / _BEARING_SIGMA_RAD
    information: Array = row[:, None] * row[None, :]
    for k, name in enumerate(motion.shape_names, start=motion.scale_row + 1):
        if name == "middle":
            information[k, k] += 1 / _MIDDLE_SIGMA**2
    return information
