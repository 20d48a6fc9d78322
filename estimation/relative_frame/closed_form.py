"""The paper's corrections of a relative frame: one linearisation, two ways to the same answer.

`closed_form` sums 4x4 normal equations over the pairs, O(L); `closed_form_dense` solves the
paper's 2L correlates, O(L^3), and is kept as the named baseline and as the check of the other.

Source: Muzychenko & Savchenko, "Correction algorithm for relative location and coordinate
orientation of carriers based on targets data fed by their sources", eqs 1-11.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, transposed
from estimation.relative_frame.logs import PolarLogs, RelativeFrame, RelativeFramePrior

_CHUNK = 8192  # pairs at a time: the intermediate arrays stay in cache, extra memory is 2 MB


class Conditions(NamedTuple):
    """The linearised condition equations (7) of L pairs, one array (..., L) a coefficient.

    w_x + a_b1_x (v_b1 + c1) + a_b2_x (v_b2 + c2) + (ranges) - x = 0, and the same with y. The
    four measurements of a pair meet no other pair: of their coefficients and variances only the
    covariance `s` [m^2] that they give the misclosure is ever needed.
    """

    w_x: Array
    w_y: Array
    a_b1_x: Array
    a_b1_y: Array
    a_b2_x: Array
    a_b2_y: Array
    s_xx: Array
    s_xy: Array
    s_yy: Array


@dataclass(frozen=True, eq=False, slots=True)
class Information:
    """What L pairs say of theta = (x, y, c1, c2), about the reported values; it adds up.

    The pairs' part of the criterion (5) is chi2 - 2 vector' theta + theta' matrix theta, so pairs
    may come in streams, from several machines, in any order: add their informations and `solve`.
    Each may have its own reported offset, as carriers move: theta is what they have in common.

    Attributes:
        matrix: (..., 4, 4) sum of H' S^-1 H.
        vector: (..., 4) minus the sum of H' S^-1 w.
        chi2: (...) sum of w' S^-1 w, the misclosure before any correction.
        pairs: L.
    """

    matrix: Array
    vector: Array
    chi2: Array
    pairs: int

    def __add__(self, more: Information) -> Information:
        return Information(
            self.matrix + more.matrix,
            self.vector + more.vector,
            self.chi2 + more.chi2,
            self.pairs + more.pairs,
        )


def closed_form(own: PolarLogs, other: PolarLogs, prior: RelativeFramePrior) -> RelativeFrame:
    """Corrections of the other carrier's relative frame from L associated target logs, in O(L).

    Exact for the conditions linearised once, at the reported values: enough for north errors of a
    degree or so and L up to about 100. L = 0 gives the prior back.

    Args:
        own: (..., L) logs in own axes.
        other: (..., L) logs of the same targets in the other carrier's axes.
        prior: reported offset and the sigmas of it and of both norths.

    Raises:
        ValueError: own and other differ in length.
    """
    return solve(information(own, other, prior), prior)


def information(own: PolarLogs, other: PolarLogs, prior: RelativeFramePrior) -> Information:
    """The additive form: J = P0^-1 + `matrix`; of the prior, only the reported offset enters.

    Raises:
        ValueError: own and other differ in length.
    """
    _need_pairs(own, other)
    total = _information_of(own.take(slice(_CHUNK)), other.take(slice(_CHUNK)), prior.offset_m)
    for start in range(_CHUNK, own.count, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        total += _information_of(own.take(chunk), other.take(chunk), prior.offset_m)
    return total


def solve(given: Information, prior: RelativeFramePrior) -> RelativeFrame:
    """The corrections that minimise criterion (5).

    In units of the prior's sigmas (theta = root z) the normal matrix is I + root' matrix root: it
    cannot be singular, whatever the geometry and however sure the prior.
    """
    root = prior.root
    normal = np.eye(4) + transposed(root) @ given.matrix @ root
    half = np.linalg.solve(np.linalg.cholesky(normal), transposed(root))  # P = half' half
    gain = half @ given.vector[..., None]
    theta = (transposed(half) @ gain)[..., 0]
    chi2 = given.chi2 - np.sum(gain**2, axis=(-2, -1))
    return _frame(theta, transposed(half) @ half, chi2, given.pairs)


def closed_form_dense(own: PolarLogs, other: PolarLogs, prior: RelativeFramePrior) -> RelativeFrame:
    """The same corrections through the 2L correlates, as the paper prints them; O(L^3).

    Errata of the paper, corrected here: (7) prints a_y^x = -1 and a_y^y = 0, which are 0 and -1,
    as (10) has them; the diagonals of (11), see `correlate_matrix`.

    Args:
        own: (..., L) logs in own axes.
        other: (..., L) logs of the same targets in the other carrier's axes.
        prior: reported offset and the sigmas of it and of both norths.

    Raises:
        ValueError: own and other differ in length.
    """
    _need_pairs(own, other)
    c = conditions(own, other, prior.offset_m)
    p0 = prior.covariance
    h = theta_columns(c)  # (..., 4, 2 L), the paper's a_x, a_y, a_b1, a_b2
    w = np.concatenate([c.w_x, c.w_y], axis=-1)
    m = correlate_matrix(c, h, p0)
    p0_h = p0 @ h
    solved = np.linalg.solve(m, np.concatenate([-w[..., None], transposed(p0_h)], axis=-1))
    k = solved[..., 0]  # eq. 11
    theta = (p0_h @ k[..., None])[..., 0]  # eq. 10, rows 5 to 8
    covariance = p0 - p0_h @ solved[..., 1:]
    return _frame(theta, covariance, -np.sum(w * k, axis=-1), own.count)


def conditions(own: PolarLogs, other: PolarLogs, offset_m: Array) -> Conditions:
    """Misclosures (3) of the reported values and coefficients (7), for an offset (..., 2)."""
    d1, sin1, cos1 = own.range_m, np.sin(own.bearing_rad), np.cos(own.bearing_rad)
    d2, sin2, cos2 = other.range_m, np.sin(other.bearing_rad), np.cos(other.bearing_rad)
    x1, y1, x2, y2 = d1 * sin1, d1 * cos1, d2 * sin2, d2 * cos2
    s1_xx, s1_xy, s1_yy = _spread(own.covariance, x1, y1, sin1, cos1)
    s2_xx, s2_xy, s2_yy = _spread(other.covariance, x2, y2, sin2, cos2)
    return Conditions(
        w_x=x1 - offset_m[..., 0, None] - x2,  # eqs 2, 3
        w_y=y1 - offset_m[..., 1, None] - y2,
        a_b1_x=y1,  # eq. 7: a_b1^x = d1 cos b1
        a_b1_y=-x1,  # a_b1^y = -d1 sin b1
        a_b2_x=-y2,
        a_b2_y=x2,
        s_xx=s1_xx + s2_xx,
        s_xy=s1_xy + s2_xy,
        s_yy=s1_yy + s2_yy,
    )


def _spread(
    covariance: Array, x: Array, y: Array, sin: Array, cos: Array
) -> tuple[Array, Array, Array]:
    """xx, xy, yy of the covariance that one carrier's (b, d) give the misclosures, A Q A'.

    A has the columns (y, -x) by bearing and (sin, cos) by range, eq. 7; the other carrier's have
    the other sign, which the square forgets.
    """
    q_bb, q_bd, q_dd = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    x_b, y_b = q_bb * y + q_bd * sin, q_bd * cos - q_bb * x
    x_d, y_d = q_bd * y + q_dd * sin, q_dd * cos - q_bd * x
    return x_b * y + x_d * sin, x_d * cos - x_b * x, y_d * cos - y_b * x


def _information_of(own: PolarLogs, other: PolarLogs, offset_m: Array) -> Information:
    """Information of one chunk: the Gram matrix of [H w], its rows whitened pair by pair."""
    c = conditions(own, other, offset_m)
    pairs = c.w_x.shape[-1]
    white = np.zeros((*c.w_x.shape[:-1], 2, 5, pairs))  # rows x and y; columns of [H w]; pairs
    x, y = white[..., 0, :, :], white[..., 1, :, :]
    x[..., 0, :] = y[..., 1, :] = -1
    x[..., 2, :], x[..., 3, :], x[..., 4, :] = c.a_b1_x, c.a_b2_x, c.w_x
    y[..., 2, :], y[..., 3, :], y[..., 4, :] = c.a_b1_y, c.a_b2_y, c.w_y

    scale_x = 1 / np.sqrt(c.s_xx)  # S = C C', C lower triangular: apply C^-1
    slope = c.s_xy * scale_x
    scale_y = 1 / np.sqrt(c.s_yy - slope**2)
    x *= scale_x[..., None, :]
    y -= slope[..., None, :] * x
    y *= scale_y[..., None, :]
    gram = np.sum(white @ transposed(white), axis=-3)
    return Information(gram[..., :4, :4], -gram[..., :4, 4], gram[..., 4, 4], pairs)


def theta_columns(c: Conditions) -> Array:
    """H' (..., 4, 2 L): derivatives of all x misclosures, then all y, by x, y, c1, c2."""
    ones, zeros = np.ones_like(c.w_x), np.zeros_like(c.w_x)
    by_x = np.concatenate([-ones, zeros], axis=-1)
    by_y = np.concatenate([zeros, -ones], axis=-1)
    by_c1 = np.concatenate([c.a_b1_x, c.a_b1_y], axis=-1)
    by_c2 = np.concatenate([c.a_b2_x, c.a_b2_y], axis=-1)
    return np.stack([by_x, by_y, by_c1, by_c2], axis=-2)


def correlate_matrix(c: Conditions, h: Array, p0: Array) -> Array:
    """M (..., 2 L, 2 L) of eq. (11), blocks xx, xy / yx, yy, from H' and the prior covariance P0.

    The paper prints the diagonals of M^xx and M^yy with each variance times a coefficient once
    where it belongs twice, (a_b1^x)^2 (sigma_c1^2 + sigma_b1^2) and so on, and leaves
    a_b2^x sigma_c2^2 a_b2^y out of the diagonal of M^xy. Right, one formula serves both cases:
    H P0 H', plus on the diagonals the pair's own A Q A'.
    """
    m = transposed(h) @ p0 @ h
    pairs = c.w_x.shape[-1]
    x, y = np.arange(pairs), np.arange(pairs, 2 * pairs)
    m[..., x, x] += c.s_xx
    m[..., y, y] += c.s_yy
    m[..., x, y] += c.s_xy
    m[..., y, x] += c.s_xy
    return m


def _frame(theta: Array, covariance: Array, chi2: Array, pairs: int) -> RelativeFrame:
    """Name the parts of theta."""
    return RelativeFrame(
        theta[..., :2], theta[..., 2], theta[..., 3], covariance, chi2, 2 * pairs, pairs
    )


def _need_pairs(own: PolarLogs, other: PolarLogs) -> None:
    """Refuse logs that cannot be pairs."""
    if own.count != other.count:
        raise ValueError(f"need the same targets from both: own {own.count}, other {other.count}")
