"""One Gauss-Helmert step of pairs of target logs: conditions between measurements, in (b, d).

The condition of a pair, in own axes, is p1 - q - R(D) p2 = 0 with p = d (sin b, cos b). It is
linearised at the *adjusted* measurements (observed + v) and the current frame, so that the
iteration ends at the least squares of criterion (5) under the conditions as they are, not as they
look from the reported values. Ranges may change sign on the way: (b, d) passes smoothly through
the carrier, where position has no usable polar derivative, so a target near a carrier does no
harm.

Everything here is flat: N experiments, L pairs, carrier 0 = own, 1 = other. A `point` (N, K) is
(q_x, q_y, D), K = 3, or also the sensor errors (own range bias, other range bias, other range
scale, other clock offset), K = 7.

Source: Lenzmann & Lenzmann, "Strenge Auswertung des nichtlinearen Gauss-Helmert-Modells", 2004:
the misclosure is referred back to the observations, w = f(l + v) - A v.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, transposed
from estimation.relative_frame.logs import PolarLogs
from estimation.relative_frame.matrices import Indices

_FARTHEST = 8.0  # sigmas from what was measured at which a doubtful pair is linearised
FRAME = 3  # parameters of the frame itself; sensor errors follow


class Measured(NamedTuple):
    """What both carriers measured, arrays (2, N, L): own first.

    Attributes:
        q_bb, q_bd, q_dd: covariance of (bearing, range) of every log.
        velocity_mps: (N, L, 2) of the targets in the other's axes, for its clock offset.
        weights: (N, L) of the pairs in the criterion, all one unless given; a pair's own
            corrections and chi2 do not depend on its weight.
    """

    bearing_rad: Array
    range_m: Array
    q_bb: Array
    q_bd: Array
    q_dd: Array
    velocity_mps: Array | None = None
    weights: Array | None = None

    def of(self, which: Indices) -> Measured:
        """The experiments `which` (n,) of the N."""
        velocity = None if self.velocity_mps is None else self.velocity_mps[which]
        weights = None if self.weights is None else self.weights[which]
        bearing, reach, q_bb, q_bd, q_dd = (array[:, which] for array in self[:5])
        return Measured(bearing, reach, q_bb, q_bd, q_dd, velocity, weights)


class Linearised(NamedTuple):
    """The conditions at one point, whitened pair by pair: S = C C', rows times C^-1.

    Attributes:
        white: (N, 2, K + 1, L): rows x and y; columns by the K parameters, then the misclosure.
        slope, scale_x, scale_y: (N, L) C^-1 = [scale_x, 0; -slope scale_x scale_y, scale_y].
        by_b_x, by_b_y, by_d_x, by_d_y: (2, N, L) A: position by bearing and range of its carrier.
    """

    white: Array
    slope: Array
    scale_x: Array
    scale_y: Array
    by_b_x: Array
    by_b_y: Array
    by_d_x: Array
    by_d_y: Array

    def gram(self, weights: Array | None = None) -> Array:
        """(N, K + 1, K + 1): [H w]' S^-1 [H w] summed over the pairs, each by its weight."""
        weighed = self.white if weights is None else self.white * weights[:, None, None]
        total: Array = np.sum(weighed @ transposed(self.white), axis=-3)
        return total


def measured(own: PolarLogs, other: PolarLogs, batch: tuple[int, ...]) -> Measured:
    """Both carriers' logs, broadcast to a batch and made flat.

    Raises:
        ValueError: own and other differ in length.
    """
    if own.count != other.count:
        raise ValueError(f"need the same targets from both: own {own.count}, other {other.count}")
    both = [
        (
            logs.bearing_rad,
            logs.range_m,
            logs.covariance[..., 0, 0],
            logs.covariance[..., 0, 1],
            logs.covariance[..., 1, 1],
        )
        for logs in (own, other)
    ]
    shape, flat = (*batch, own.count), (-1, own.count) if own.count else (int(np.prod(batch)), 0)
    return Measured(
        *(
            np.stack([np.broadcast_to(array, shape).reshape(flat) for array in pair])
            for pair in zip(*both, strict=True)
        )
    )


def linearise(given: Measured, v: Array, point: Array) -> Linearised:
    """The conditions at the adjusted measurements, observed + v (bearing then range, 2, N, L)."""
    v_b, v_d = v[0], v[1]
    bearing, reach = given.bearing_rad + v_b, given.range_m + v_d
    bearing[1] += point[:, 2, None]
    sin, cos = np.sin(bearing), np.cos(bearing)
    by_d_x, by_d_y = sin, cos
    if point.shape[1] > FRAME:
        reach, by_d_x, by_d_y = _with_sensor_errors(point, reach, sin, cos)
    x, y = reach * sin, reach * cos
    x_b, y_b = given.q_bb * y + given.q_bd * by_d_x, given.q_bd * by_d_y - given.q_bb * x
    x_d, y_d = given.q_bd * y + given.q_dd * by_d_x, given.q_dd * by_d_y - given.q_bd * x
    s_xx, s_xy = (x_b * y + x_d * by_d_x).sum(0), (x_d * by_d_y - x_b * x).sum(0)
    s_yy = (y_d * by_d_y - y_b * x).sum(0)
    # where the measurements themselves put the targets, to first order about the adjusted ones
    x_0, y_0 = x - y * v_b - by_d_x * v_d, y + x * v_b - by_d_y * v_d

    white = np.zeros((len(point), 2, point.shape[1] + 1, x.shape[-1]))
    row_x, row_y = white[:, 0], white[:, 1]
    row_x[:, 0] = row_y[:, 1] = -1
    row_x[:, 2], row_y[:, 2] = -y[1], x[1]
    row_x[:, -1] = x_0[0] - x_0[1] - point[:, 0, None]
    row_y[:, -1] = y_0[0] - y_0[1] - point[:, 1, None]
    if point.shape[1] > FRAME:
        _sensor_error_columns(white, given, point, reach, sin, cos)
    scale_x = 1 / np.sqrt(s_xx)
    slope = s_xy * scale_x
    scale_y = 1 / np.sqrt(s_yy - slope**2)
    row_x *= scale_x[:, None]
    row_y -= slope[:, None] * row_x
    row_y *= scale_y[:, None]
    return Linearised(white, slope, scale_x, scale_y, y, -x, by_d_x, by_d_y)


def _with_sensor_errors(
    point: Array, reach: Array, sin: Array, cos: Array
) -> tuple[Array, Array, Array]:
    """Corrected ranges (2, N, L) and the derivatives of position by the measured range."""
    gain = np.stack([np.ones(len(point)), 1 + point[:, 5]])[..., None]
    bias = point[:, 3:5].T[..., None]
    return gain * (reach + bias), gain * sin, gain * cos


def _sensor_error_columns(
    white: Array, given: Measured, point: Array, reach: Array, sin: Array, cos: Array
) -> None:
    """Fill the columns of the sensor errors; a clock offset also moves the other's positions."""
    scale, clock = 1 + point[:, 5, None], point[:, 6, None]
    for row, along in ((white[:, 0], sin), (white[:, 1], cos)):
        row[:, 3] = along[0]
        row[:, 4] = -scale * along[1]
        row[:, 5] = -reach[1] / scale * along[1]
    if given.velocity_mps is None:
        return
    turn_sin, turn_cos = np.sin(point[:, 2, None]), np.cos(point[:, 2, None])
    east, north = given.velocity_mps[..., 0], given.velocity_mps[..., 1]
    v_x, v_y = turn_cos * east + turn_sin * north, turn_cos * north - turn_sin * east
    white[:, 0, 6], white[:, 1, 6] = -v_x, -v_y
    white[:, 0, 2] -= v_y * clock
    white[:, 1, 2] += v_x * clock
    white[:, 0, -1] -= v_x * clock
    white[:, 1, -1] -= v_y * clock


def back_substituted(given: Measured, at: Linearised, step: Array) -> tuple[Array, Array]:
    """Corrections v (2, 2, N, L) of the measurements after a step (N, K), and chi2 (N, L) each.

    v = -Q A' k with the correlates k = S^-1 (w + H step); chi2 = v' Q^-1 v = k' S k.
    """
    full = np.concatenate([step, np.ones((len(step), 1))], axis=1)
    white = (full[:, None, None, :] @ at.white)[:, :, 0]  # (N, 2, L): C^-1 (w + H step)
    k_y = white[:, 1] * at.scale_y
    k_x = (white[:, 0] - at.slope * k_y) * at.scale_x
    along_b, along_d = at.by_b_x * k_x + at.by_b_y * k_y, at.by_d_x * k_x + at.by_d_y * k_y
    v = np.empty((2, *given.bearing_rad.shape))
    v[0] = given.q_bb * along_b + given.q_bd * along_d
    v[1] = given.q_bd * along_b + given.q_dd * along_d
    v[:, 0] *= -1  # the other's position enters the condition with the other sign
    chi2: Array = np.square(white).sum(axis=1)
    if given.weights is not None:  # some pairs are wrong: do not follow them to other geometries
        v *= np.minimum(1.0, _FARTHEST / np.sqrt(np.maximum(chi2, 1e-12)))
    return v, chi2
