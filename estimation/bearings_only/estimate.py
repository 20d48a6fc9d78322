"""What one motion says of many targets: places, velocities, ranges, each with its covariance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike
from estimation.bearings_only.linear_algebra import inverted
from estimation.bearings_only.measurements import ComplexArray, Scene
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.normal_equations import directions, unpacked

_QUIET = np.errstate(all="ignore")  # what is not determined may well overflow
_TICK = 1e-4  # half spans, of the differences that make velocities out of places


class InverseRange(NamedTuple):
    """1 / range [1/m], regular where the range is infinite; at or below zero = no bound."""

    value: Array
    sigma: Array


class State(NamedTuple):
    """Places and velocities.

    Attributes:
        position_m: (..., 2) east, north.
        velocity_mps: (..., 2).
        covariance: (..., 4, 4) of both.
    """

    position_m: Array
    velocity_mps: Array
    covariance: Array


class LineOfSight(NamedTuple):
    """What bearings tell of any target, at a time; sigmas alike.

    Attributes:
        bearing_rad: (...) clockwise from north.
        bearing_rate_rad_s: (...).
        range_rate_over_range: (...) [1/s], negative when closing: the inverse time to contact.
        covariance: (..., 3, 3) of the three.
    """

    bearing_rad: Array
    bearing_rate_rad_s: Array
    range_rate_over_range: Array
    covariance: Array

    def one(self) -> LineOfSight:
        """Of the first target."""
        return LineOfSight(*(part[0] for part in self))


class Estimate(NamedTuple):
    """Parameters of one motion for B targets; ask it for what has units.

    Attributes:
        scene, motion: what was solved.
        p: (M, B) homogeneous parameters.
        information: (M, M, B) what the bearings and the prior say of p.
        chi2: (B,) of the bearings alone.
        converged: (B,) False: it went on moving, and is not to be used.
    """

    scene: Scene
    motion: Motion
    p: Array
    information: Array
    chi2: Array
    converged: NDArray[np.bool_]

    @property
    @_QUIET
    def covariance(self) -> Array:
        """(M, M, B) of p; what nothing tells is very large."""
        p = self.p.copy()
        p[self.motion.scale_row + 1 :] = 0
        trace = np.einsum("iib->b", self.information) + 1e-290
        return inverted(self.information + trace * p[:, None] * p[None, :])

    def take(self, columns: NDArray[np.int_]) -> Estimate:
        """Some of the targets."""
        return Estimate(
            self.scene.take(columns),
            self.motion,
            self.p[:, columns],
            self.information[..., columns],
            self.chi2[columns],
            self.converged[columns],
        )

    @_QUIET
    def inverse_range(self) -> InverseRange:
        """1 / range at the last bearing, (B,) each."""
        value, by = inverse_range_at(self.scene, self.motion, self.p)
        return InverseRange(value, np.sqrt(_quadratic(by, self.covariance)))

    @_QUIET
    def line_of_sight(self) -> LineOfSight:
        """Bearing, its rate and range rate by range at the last bearing, (B, ...) each."""
        own = self.own_velocity()
        d, by_d = self._relative(0.0, self.scene.observer[-1])
        ahead, by_ahead = self._relative(_TICK, self.scene.observer[-1] + _TICK * own)
        behind, by_behind = self._relative(-_TICK, self.scene.observer[-1] - _TICK * own)
        span = 2 * _TICK * self.scene.half_span_s
        rate, by_rate = (ahead - behind) / span, (by_ahead - by_behind) / span
        d = d + 1e-290
        by = by_rate / d - rate / d**2 * by_d
        rows = np.stack([-(by_d / d).imag, -by.imag, by.real])
        covariance = np.einsum("imb,mnb,jnb->bij", rows, self.covariance, rows)
        value = rate / d
        return LineOfSight(np.arctan2(d.real, d.imag), -value.imag, value.real, covariance)

    def own_velocity(self) -> ComplexArray:
        """Of the carrier at the last bearing (1 or B,), lengths a half span."""
        time, place = np.broadcast_arrays(self.scene.time, self.scene.observer)
        earlier = time < time[-1] - 1e-9
        index = np.where(earlier.any(axis=0), earlier[::-1].argmax(axis=0), 0)
        rows = len(time) - 1 - index
        columns = np.arange(time.shape[1])
        since = time[-1] - time[rows, columns]
        moved = place[-1] - place[rows, columns]
        return np.where(since > 0, moved / np.where(since > 0, since, 1.0), 0.0)

    def _relative(self, later: float, observer: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Direction d (B,) and its derivatives (M, B), somewhat later than the last bearing."""
        scene = self.scene._replace(time=self.scene.time[-1:] + later, observer=observer[None])
        d, by = directions(scene, self.motion, self.p)
        return d[0], by[:, 0]

    def bearings_rad(self) -> Array:
        """The bearings (B, N) that these parameters predict."""
        d, _ = directions(self.scene, self.motion, self.p)
        predicted: Array = np.arctan2(d.real, d.imag).T
        return predicted

    def _basis(self, time: Array) -> tuple[ComplexArray, ComplexArray]:
        _, _, shape = unpacked(self.motion, self.p)
        everyone = np.broadcast_to(time, self.p.shape[1:])[None]
        f, slopes = self.motion.basis(everyone, shape)
        return f[:, 0], slopes[:, 0]

    @_QUIET
    def state(self, t_s: ArrayLike) -> State:
        """Places and velocities at a time (a number or (B,)), (B, ...) each.

        Where s is not positive the range is not bounded and the numbers mean nothing: ask
        `inverse_range` first.
        """
        time = (np.asarray(t_s, dtype=float) - self.scene.middle_s) / self.scene.half_span_s
        c, s, _ = unpacked(self.motion, self.p)
        (f0, slopes0), (f1, slopes1) = self._basis(time - _TICK), self._basis(time + _TICK)
        bases = (
            ((f0 + f1) / 2, (slopes0 + slopes1) / 2),
            (
                (f1 - f0) / (2 * _TICK * self.scene.half_span_s),
                (slopes1 - slopes0) / (2 * _TICK * self.scene.half_span_s),
            ),
        )
        values, rows = [], []
        for f, slopes in bases:
            value = np.einsum("kb,kb->b", f, c) / s * self.scene.length_m
            unit = self.scene.length_m / s
            by = np.stack([*(f * unit), *(1j * f * unit), -value / s, *(slopes * c[1] * unit)])
            values.append(value)
            rows += [by.real, by.imag]
        place = values[0] + self.scene.centre_m
        jacobian = np.stack(rows)
        covariance = np.einsum("imb,mnb,jnb->bij", jacobian, self.covariance, jacobian)
        return State(_vectors(place), _vectors(values[1]), covariance)


def inverse_range_at(scene: Scene, motion: Motion, p: Array) -> tuple[Array, Array]:
    """1 / range at the last bearing [1/m] (B,) and its derivatives by p, both (M, B)."""
    last = scene._replace(time=scene.time[-1:], observer=scene.observer[-1:])
    d, by_d = (part[..., 0, :] for part in directions(last, motion, p))
    s = p[motion.scale_row]
    far = np.abs(d) * scene.length_m + 1e-290
    by = -s / far * (by_d / (d + 1e-290)).real
    by[motion.scale_row] += 1 / far
    return s / far, by


def _quadratic(by: Array, covariance: Array) -> Array:
    """Variance by' P by for each target, never negative."""
    found: Array = np.maximum(np.einsum("mb,mnb,nb->b", by, covariance, by), 0.0)
    return found


def _vectors(values: ComplexArray) -> Array:
    return np.stack([values.real, values.imag], axis=-1)
