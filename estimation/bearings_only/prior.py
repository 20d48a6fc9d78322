"""What is known of targets before the first bearing, as rows beside those of the bearings."""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from estimation.arrays import Array
from estimation.bearings_only.measurements import ComplexArray, Scene
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.normal_equations import directions, unpacked

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


Kind: TypeAlias = Literal["scale", "shape", "flat"]
"""What a row speaks of: metres; the form of the track; nothing but the volume of the prior."""


class PriorRows(NamedTuple):
    """Residuals of a prior; with the flat ones there is one row a degree of freedom.

    Attributes:
        residual: (R, B).
        jacobian: (M, R, B).
        kinds: R of them.
    """

    residual: Array
    jacobian: Array
    kinds: tuple[Kind, ...]

    def only(self, *kinds: Kind) -> PriorRows:
        """The rows of some kinds."""
        kept = [i for i, kind in enumerate(self.kinds) if kind in kinds]
        return PriorRows(
            self.residual[kept], self.jacobian[:, kept], tuple(self.kinds[i] for i in kept)
        )


class _Row(NamedTuple):
    """One row: its residual (B,) and its derivatives by some of the parameters."""

    kind: Kind
    residual: Array
    by: dict[int, Array]


class _Point(NamedTuple):
    """Where the rows are wanted: coefficients (K, B) and scale (B,), with the units."""

    scene: Scene
    prior: MotionPrior
    c: ComplexArray
    s: Array

    def unit(self, order: int) -> Array:
        """Metres by seconds to the `order`, of a coefficient over s."""
        return self.scene.length_m / self.scene.half_span_s**order


def prior_rows(scene: Scene, motion: Motion, prior: MotionPrior, p: Array) -> PriorRows:
    """The rows at p; infinite range and what lies beyond have no residual (NaN)."""
    c, s, shape = unpacked(motion, p)
    at = _Point(scene, prior, c, np.where(s > 0, s, np.nan))
    first = motion.scale_row + 1
    rows = _place_rows(at, motion, p)
    for order in range(1, motion.degree + 1):
        rows += _derivative_rows(at, order)
    for k, name in enumerate(motion.shape_names):
        rows.append(_SHAPE_ROWS[name](at, shape[k], first + k))
    jacobian = np.zeros((len(p), len(rows), p.shape[1]))
    for i, row in enumerate(rows):
        for parameter, derivative in row.by.items():
            jacobian[parameter, i] = derivative
    residual = np.stack([np.broadcast_to(row.residual, s.shape) for row in rows])
    return PriorRows(residual, jacobian, tuple(row.kind for row in rows))


def _place_rows(at: _Point, motion: Motion, p: Array) -> list[_Row]:
    """Range and bearing at the last bearing, by the logarithm of d."""
    last = at.scene._replace(time=at.scene.time[-1:], observer=at.scene.observer[-1:])
    d, by = (values[..., 0, :] for values in directions(last, motion, p))
    of = by / d
    sigma = at.prior.sigma_log_range
    median = at.prior.range_m / at.scene.length_m
    by_range = of.real / sigma
    by_range[motion.scale_row] -= 1 / at.s / sigma
    log_range = (np.log(np.abs(d)) - np.log(at.s * median)) / sigma
    return [
        _Row("scale", log_range, dict(enumerate(by_range))),
        _Row("flat", np.zeros(1), dict(enumerate(of.imag / _BEARING_SIGMA_RAD))),
    ]


def _derivative_rows(at: _Point, order: int) -> list[_Row]:
    """Velocity, acceleration or jerk, east and north."""
    prior = at.prior
    sigmas = (prior.sigma_speed_mps, prior.sigma_acceleration_mps2, prior.sigma_jerk_mps3)
    unit = at.unit(order) / sigmas[min(order, 3) - 1] / at.s
    value = at.c[order] * unit
    size = len(at.c)
    return [
        _Row("scale", part, {row: unit, 2 * size: -part / at.s})
        for part, row in ((value.real, order), (value.imag, size + order))
    ]


def _kappa(at: _Point, kappa: Array, index: int) -> _Row:
    """Acceleration along the course, kappa times the speed."""
    by_kappa = np.abs(at.c[1]) * at.unit(2) / at.s / at.prior.sigma_acceleration_mps2
    value = kappa * by_kappa
    by_c = value * at.c[1] / (np.abs(at.c[1]) ** 2 + 1e-300)
    return _Row("scale", value, {1: by_c.real, 3: by_c.imag, 4: -value / at.s, index: by_kappa})


def _omega(at: _Point, omega: Array, index: int) -> _Row:
    by = 1 / (at.scene.half_span_s * at.prior.sigma_turn_rate_rad_s)
    return _Row("shape", omega * by, {index: by})


def _angle(at: _Point, angle: Array, index: int) -> _Row:
    by = 1 / at.prior.sigma_turn_rad
    return _Row("shape", angle * by, {index: np.array(by)})


def _duration(at: _Point, log_duration: Array, index: int) -> _Row:
    by = 1 / at.prior.sigma_log_duration
    longer = log_duration + np.log(at.scene.half_span_s / at.prior.turn_duration_s)
    return _Row("shape", longer * by, {index: np.array(by)})


def _middle(at: _Point, middle: Array, index: int) -> _Row:
    return _Row("flat", np.zeros(1), {index: np.array(1 / _MIDDLE_SIGMA)})


_SHAPE_ROWS = {
    "kappa": _kappa,
    "omega": _omega,
    "angle": _angle,
    "middle": _middle,
    "duration": _duration,
}
