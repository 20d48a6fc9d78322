"""The paper's two methods, as baselines: N-bearings and N-polynomials.

Both are unweighted least squares of the equation "the target lies on the line of the bearing".
A target at the observer fulfils it without any residual, so noise pulls the range towards zero:
the error of both is negative on average, and neither knows its covariance. For estimates use
`maximum_likelihood` or `solve`.

Source: the paper, eqs 1 to 14; N-bearings is the method it compares itself with.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike
from estimation.bearings_only.measurements import Bearings

Basis = Callable[[Array, int], Array]


class SeedTrack(NamedTuple):
    """A track in polynomials, without a covariance: the baselines state none.

    Attributes:
        coefficients: (..., n + 1, 2) east and north of each polynomial.
        basis: the polynomials (..., N, n + 1) of reduced time.
        first_s, last_s: (...) of the bearings; reduced time is -1 .. 1 between them, eq. 3.
    """

    coefficients: Array
    basis: Basis
    first_s: Array
    last_s: Array

    def position_m(self, t_s: ArrayLike) -> Array:
        """Places (..., 2) at times (...)."""
        t = np.asarray(t_s, dtype=float)
        values = self.basis(_reduced(t[..., None], self.first_s, self.last_s), self._degree)
        place: Array = np.einsum("...nj,...jk->...nk", values, self.coefficients)[..., 0, :]
        return place

    def velocity_mps(self, t_s: ArrayLike) -> Array:
        """Velocities (..., 2) at times (...), by central differences over 1e-4 of the time."""
        t = np.asarray(t_s, dtype=float)
        tick = 1e-4 * (self.last_s - self.first_s) + 1e-9
        velocity: Array = (self.position_m(t + tick) - self.position_m(t - tick)) / (
            2 * tick[..., None]
        )
        return velocity

    @property
    def _degree(self) -> int:
        return int(self.coefficients.shape[-2]) - 1


def chebyshev_first(tau: Array, degree: int) -> Array:
    """T_0 .. T_n (..., n + 1) of reduced time."""
    return _chebyshev(tau, degree, 1)


def chebyshev_second(tau: Array, degree: int) -> Array:
    """U_0 .. U_n (..., n + 1) of reduced time."""
    return _chebyshev(tau, degree, 2)


def _chebyshev(tau: Array, degree: int, factor: int) -> Array:
    found = [np.ones_like(tau), factor * tau]
    while len(found) <= degree:
        found.append(2 * tau * found[-1] - found[-2])
    return np.stack(found[: degree + 1], axis=-1)


def n_polynomials(given: Bearings, degree: int, basis: Basis = chebyshev_first) -> SeedTrack:
    """The paper's method: both coordinates as Chebyshev polynomials of time, eqs 10 to 14.

    Args:
        given: bearings; sigmas are not used.
        degree: n, at least 0.
        basis: `chebyshev_first` or `chebyshev_second`; the track is the same.
    """
    first, last = given.t_s.min(axis=-1), given.t_s.max(axis=-1)
    values = basis(_reduced(given.t_s, first, last), degree)
    rows, right = pseudo_linear_rows(given, values)
    solution = _least_squares(rows, right)
    coefficients = np.stack([solution[..., : degree + 1], solution[..., degree + 1 :]], axis=-1)
    return SeedTrack(coefficients, basis, first, last)


def n_bearings(given: Bearings) -> SeedTrack:
    """The paper's rival: constant velocity from a point of the first bearing that was seen.

    Unknowns are the first range D0 and the velocity; the target is exactly on the first bearing.
    """
    normal, seen = _normals(given)
    index = seen.argmax(axis=-1)[..., None]
    t, last = np.broadcast_to(given.t_s, seen.shape), given.t_s[..., -1]
    observer = np.broadcast_to(given.observer_m, normal.shape)
    first = np.take_along_axis(t, index, axis=-1)[..., 0]
    start = np.nan_to_num(np.take_along_axis(given.bearing_rad, index, axis=-1)[..., 0])
    from_m = np.take_along_axis(observer, index[..., None], axis=-2)
    along = np.stack([np.sin(start), np.cos(start)], axis=-1)
    moved = observer - from_m
    since = t - first[..., None]
    rows = np.concatenate(
        [
            np.einsum("...nk,...k->...n", normal, along)[..., None],
            normal * (since * seen)[..., None],
        ],
        axis=-1,
    )
    d0, velocity = np.split(_least_squares(rows, (normal * moved).sum(axis=-1)), [1], axis=-1)
    half = ((last - first) / 2)[..., None]
    origin = from_m[..., 0, :] + d0 * along + velocity * half
    coefficients = np.stack(np.broadcast_arrays(origin, velocity * half), axis=-2)
    return SeedTrack(coefficients, chebyshev_first, first, last)


def pseudo_linear_rows(given: Bearings, values: Array) -> tuple[Array, Array]:
    """A (..., N, 2n + 2) and B (..., N) of eqs 11, 13: x cos P - y sin P, from target and observer.

    Args:
        values: (..., N, n + 1) of the polynomials.
    """
    normal, _ = _normals(given)
    rows = np.concatenate([normal[..., :1] * values, normal[..., 1:] * values], axis=-1)
    return rows, (normal * given.observer_m).sum(axis=-1)


def rotated_rows(given: Bearings, values: Array) -> tuple[Array, Array]:
    """The same as the paper derives it, eqs 5 to 9: every bearing turned to k = cot P = 0.

    In axes turned by alpha = pi/2 - P the line of sight is y' = y'o.
    """
    alpha = np.pi / 2 - given.bearing_rad
    seen = np.isfinite(alpha)
    alpha = np.where(seen, alpha, 0.0)
    into = np.stack([-np.sin(alpha), np.cos(alpha)], axis=-1) * seen[..., None]  # y' of (x, y)
    rows = np.concatenate([into[..., :1] * values, into[..., 1:] * values], axis=-1)
    return rows, (into * given.observer_m).sum(axis=-1)


def _normals(given: Bearings) -> tuple[Array, Array]:
    """(cos P, -sin P) (..., N, 2), zero where not seen, and whether seen."""
    seen = np.isfinite(given.bearing_rad)
    bearing = np.where(seen, given.bearing_rad, 0.0)
    normal = np.stack([np.cos(bearing), -np.sin(bearing)], axis=-1)
    return normal * seen[..., None], seen.astype(float)


def _least_squares(rows: Array, right: Array) -> Array:
    """Eq. 14 by a pseudo-inverse: the shortest solution where there are many."""
    solution: Array = np.einsum("...ij,...j->...i", np.linalg.pinv(rows), right)
    return solution


def _reduced(t: Array, first: Array, last: Array) -> Array:
    """Eq. 3; 0 when there is only one time."""
    span = (last - first)[..., None]
    tau: Array = 2 * (t - first[..., None]) / np.where(span > 0, span, 1.0) - 1
    return np.where(span > 0, tau, 0.0)
