"""Misclosure of pairs under many frames at once: the arithmetic of the whole acquisition.

Frames t = (q, D) with covariances P come as stacks; the misclosure w = p - q - R(D) r of a pair
has the derivative -H = -(I, g) by t, with g = dR/dD r, and the covariance V = S + H P H' with
S = S1 + R S2 R'. Velocities obey v1 = R(D) v2 likewise, so they say a little of D and, once D is
known, much of the pair. Two by two matrices are written out: a search makes many small steps.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.acquisition.problem import Side
from estimation.arrays import Array, transposed
from estimation.frames import rotation_clockwise

_LN_2PI = float(np.log(2 * np.pi))


class Frames(NamedTuple):
    """A stack of B frames t = (east, north, D) with covariances."""

    t: Array  # (B, 3) [m, m, rad]
    covariance: Array  # (B, 3, 3)

    def take(self, which: NDArray[Any]) -> Frames:
        """The frames an index array names."""
        return Frames(self.t[which], self.covariance[which])


class _Symmetric(NamedTuple):
    """A stack of symmetric 2x2 matrices by their entries."""

    xx: Array
    xy: Array
    yy: Array

    def solve(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """The determinant, and the inverse times (x, y)."""
        det = self.xx * self.yy - self.xy * self.xy
        return det, (self.yy * x - self.xy * y) / det, (self.xx * y - self.xy * x) / det


def with_covariance_along_own(other: Side, turn_rad: float) -> Side:
    """The other's logs with their covariances turned to own axes, their states left alone.

    In a search D changes by its prior sigma at most, which does not change S; places it changes.
    """
    parts = other.state.shape[-1]
    turn = np.zeros((parts, parts))
    for at in range(0, parts, 2):
        turn[at : at + 2, at : at + 2] = rotation_clockwise(turn_rad)
    return Side(other.state, turn @ other.covariance @ turn.T, other.moving)


def log_likelihood(frames: Frames, own: Side, other: Side, sigma_speed_mps: float) -> Array:
    """Log density [1/m^2] of a pair's misclosure, the frame's error integrated out.

    Velocities enter as a ratio: same target against two of a population of `sigma_speed_mps`.

    Args:
        frames: B of them, their axis before those of the pairs.
        own, other: logs whose leading shapes broadcast, (n) or, for B = 1, (N1, N2); the other's
            covariances along own axes.

    Returns:
        (B, n), or the shape of the pairs for B = 1.
    """
    q_x, q_y, turn = (frames.t[:, k, None] for k in range(3))
    p = frames.covariance
    p_xx, p_xy, p_yy = p[:, 0, 0, None], p[:, 0, 1, None], p[:, 1, 1, None]
    p_xd, p_yd, p_dd = p[:, 0, 2, None], p[:, 1, 2, None], p[:, 2, 2, None]
    cos, sin = np.cos(turn), np.sin(turn)

    x, y = _turned(other.state[..., 0], other.state[..., 1], cos, sin)
    g_x, g_y = y, -x
    w_x, w_y = own.state[..., 0] - q_x - x, own.state[..., 1] - q_y - y
    h_x, h_y = p_xd + p_dd * g_x, p_yd + p_dd * g_y  # what w shares with the error of D
    s_xx, s_xy, s_yy = _spread(own, other, 0)
    v = _Symmetric(
        s_xx + p_xx + (p_xd + h_x) * g_x,
        s_xy + p_xy + p_xd * g_y + h_y * g_x,
        s_yy + p_yy + (p_yd + h_y) * g_y,
    )
    det, k_x, k_y = v.solve(w_x, w_y)
    place: Array = -_LN_2PI - 0.5 * (np.log(det) + w_x * k_x + w_y * k_y)
    if own.state.shape[-1] == 2:
        return place

    _, a_x, a_y = v.solve(h_x, h_y)  # the place has already told of D
    moved, p_dd = a_x * w_x + a_y * w_y, p_dd - a_x * h_x - a_y * h_y
    x, y = _turned(other.state[..., 2], other.state[..., 3], cos, sin)
    w_x, w_y = own.state[..., 2] - x - y * moved, own.state[..., 3] - y + x * moved
    s_xx, s_xy, s_yy = _spread(own, other, 2)
    v = _Symmetric(s_xx + p_dd * y * y, s_xy - p_dd * x * y, s_yy + p_dd * x * x)
    det, k_x, k_y = v.solve(w_x, w_y)
    speeds = np.square(own.state[..., 2]) + np.square(own.state[..., 3])
    same = -0.5 * (np.log(det) + w_x * k_x + w_y * k_y)
    ratio = same + 2 * np.log(sigma_speed_mps) + 0.5 * speeds / sigma_speed_mps**2
    return place + np.where(own.moving & other.moving, ratio, 0.0)


def _turned(x: Array, y: Array, cos: Array, sin: Array) -> tuple[Array, Array]:
    """East and north turned clockwise."""
    return cos * x + sin * y, cos * y - sin * x


def _spread(own: Side, other: Side, at: int) -> tuple[Array, Array, Array]:
    """xx, xy, yy of S1 + S2, of places (at = 0) or of velocities (2)."""
    block = own.covariance[..., at : at + 2, at : at + 2]
    more = other.covariance[..., at : at + 2, at : at + 2]
    return (
        block[..., 0, 0] + more[..., 0, 0],
        block[..., 0, 1] + more[..., 0, 1],
        block[..., 1, 1] + more[..., 1, 1],
    )


def linearised(t: Array, own: Side, other: Side) -> tuple[Array, Array]:
    """Misclosures w (n, m) and H (n, m, 3) of n pairs, each under its own frame t (n, 3) or one."""
    turn = rotation_clockwise(t[..., 2])
    quarter = rotation_clockwise(np.pi / 2)
    blocks = range(0, own.state.shape[-1], 2)
    seen = [(turn @ other.state[..., at : at + 2, None])[..., 0] for at in blocks]
    h = np.zeros((*own.state.shape, 3))
    h[..., 0, 0] = h[..., 1, 1] = 1.0
    h[..., 2] = np.concatenate([each @ quarter.T for each in seen], axis=-1)
    w = own.state - np.concatenate(seen, axis=-1)
    w[..., :2] -= t[..., :2]
    return w, h


def updated(frames: Frames, own: Side, other: Side) -> Frames:
    """Each of B frames after its own pair, the i-th with the i-th; Kalman's step."""
    w, h = linearised(frames.t, own, other)
    p_h = frames.covariance @ transposed(h)
    v = own.covariance + other.covariance + h @ p_h
    gain: Array = np.swapaxes(np.linalg.solve(v, transposed(p_h)), -1, -2)
    moved = frames.t + (gain @ w[..., None])[..., 0]
    return Frames(moved, frames.covariance - gain @ transposed(p_h))


def fitted(prior: Frames, start: Array, own: Side, other: Side, steps: int = 4) -> Frames:
    """The one frame (B = 1) that best fits the prior and L pairs; Gauss-Newton from `start` (3,).

    S is turned with the frame at every step: exact for the places as Gaussian.
    """
    t, weight = start, np.linalg.inv(prior.covariance[0])
    covariance = prior.covariance[0]
    for _ in range(steps):
        w, h = linearised(t, own, other)
        s = own.covariance + with_covariance_along_own(other, float(t[2])).covariance
        h_s: Array = np.swapaxes(np.linalg.solve(s, h), -1, -2)
        covariance = np.linalg.inv(weight + (h_s @ h).sum(axis=0))
        step = covariance @ ((h_s @ w[..., None]).sum(axis=0)[:, 0] + weight @ (prior.t[0] - t))
        t = t + step
    return Frames(t[None], covariance[None])
