"""Bearings of one or many targets, and the same in the units in which they are solved."""

from __future__ import annotations

from math import prod
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike

ComplexArray: TypeAlias = NDArray[np.complex128]

_Kind = TypeVar("_Kind", np.float64, np.complex128)

_SMALLEST_SIGMA_RAD = 1e-7  # a bearing better than 0.02 arc seconds is a mistake of its sender


class Bearings(NamedTuple):
    """Bearings taken by one carrier; make it by `bearings`, which checks.

    Leading axes `...` are targets. When times and places have none, all targets share them, and
    solving is several times faster.

    Attributes:
        t_s: (..., N) seconds from any origin, in increasing order.
        observer_m: (..., N, 2) east and north of the carrier.
        bearing_rad: (..., N) clockwise from north; not finite = not seen.
        sigma_rad: (..., N).
    """

    t_s: Array
    observer_m: Array
    bearing_rad: Array
    sigma_rad: Array

    @property
    def batch(self) -> tuple[int, ...]:
        """The leading shape: () for one target."""
        return np.broadcast_shapes(
            self.t_s.shape[:-1],
            self.observer_m.shape[:-2],
            self.bearing_rad.shape[:-1],
            self.sigma_rad.shape[:-1],
        )


def bearings(
    t_s: ArrayLike, observer_m: ArrayLike, bearing_rad: ArrayLike, sigma_rad: ArrayLike
) -> Bearings:
    """Bearings [rad] from places [m] at times [s]; shapes as in `Bearings`, sigma may be a number.

    Raises:
        ValueError: the shapes do not agree, or a sigma of a seen bearing is not positive.
    """
    t, o, b = (np.asarray(value, dtype=float) for value in (t_s, observer_m, bearing_rad))
    sigma = np.asarray(sigma_rad, dtype=float)
    if t.ndim < 1 or o.ndim < 2 or b.ndim < 1 or o.shape[-1] != 2:
        raise ValueError(f"need (..., N), (..., N, 2), (..., N): {t.shape}, {o.shape}, {b.shape}")
    count = b.shape[-1]
    if t.shape[-1] != count or o.shape[-2] != count:
        raise ValueError(
            f"need as many times and places as bearings: {t.shape}, {o.shape}, {count}"
        )
    sigma = np.broadcast_to(sigma, np.broadcast_shapes(sigma.shape, (count,)))
    if not np.all((sigma > 0) | ~np.isfinite(b)):
        raise ValueError("need positive sigmas")
    found = Bearings(t, o, b, sigma)
    np.broadcast_shapes(found.batch, ())
    return found


class Scene(NamedTuple):
    """Bearings in units of their own, targets B in the last axis, places as east + i north.

    Attributes:
        time: (N, 1 or B) in half spans from the middle: -1 .. 1.
        observer: (N, 1 or B) in lengths, from the middle of the carrier's track.
        toward: (N, B) unit vectors along the bearings.
        weight: (N, B) 1 / sigma; 0 = not seen.
        middle_s, half_span_s, length_m: (1 or B,) the units.
        centre_m: (1 or B,) the origin.
    """

    time: Array
    observer: ComplexArray
    toward: ComplexArray
    weight: Array
    middle_s: Array
    half_span_s: Array
    length_m: Array
    centre_m: ComplexArray

    @property
    def targets(self) -> int:
        """B."""
        return int(self.toward.shape[1])

    @property
    def shared(self) -> bool:
        """Whether all targets are seen at the same times from the same places."""
        return bool(self.time.shape[1] == 1 and self.observer.shape[1] == 1)

    @property
    def seen(self) -> NDArray[np.int_]:
        """(B,) bearings that count."""
        counted: NDArray[np.int_] = (self.weight > 0).sum(axis=0)
        return counted

    def take(self, columns: NDArray[np.int_]) -> Scene:
        """Some of the targets."""
        return Scene(
            _shared(self.time, columns),
            _shared(self.observer, columns),
            self.toward[:, columns],
            self.weight[:, columns],
            _shared(self.middle_s, columns),
            _shared(self.half_span_s, columns),
            _shared(self.length_m, columns),
            _shared(self.centre_m, columns),
        )


def scene_of(given: Bearings) -> Scene:
    """The scene of bearings, batch flattened. Nothing in it is infinite or NaN."""
    given = padded(given)
    time = _last(given.t_s)
    place = _last(given.observer_m[..., 0]) + 1j * _last(given.observer_m[..., 1])
    everyone = (*given.batch, given.bearing_rad.shape[-1])
    bearing, sigma = (
        _last(np.broadcast_to(field, everyone)) for field in (given.bearing_rad, given.sigma_rad)
    )
    known = np.isfinite(time) & np.isfinite(place)
    time, place = np.where(known, time, 0.0), np.where(known, place, 0.0)
    middle = (time.max(axis=0) + time.min(axis=0)) / 2
    half_span = np.abs(time - middle).max(axis=0)
    half_span = np.where(half_span > 0, half_span, 1.0)
    centre = place.mean(axis=0)
    length = np.sqrt(np.mean(np.abs(place - centre) ** 2, axis=0))
    length = np.where(length > 1e-3, length, 1.0)
    seen = known & np.isfinite(bearing) & np.isfinite(sigma)
    bearing = np.where(seen, bearing, 0.0)
    weight = np.where(seen, 1 / np.maximum(sigma, _SMALLEST_SIGMA_RAD), 0.0)
    return Scene(
        time=(time - middle) / half_span,
        observer=(place - centre) / length,
        toward=np.sin(bearing) + 1j * np.cos(bearing),
        weight=weight,
        middle_s=middle,
        half_span_s=half_span,
        length_m=length,
        centre_m=centre,
    )


def padded(given: Bearings) -> Bearings:
    """No bearing at all is one that was not seen."""
    if given.bearing_rad.shape[-1]:
        return given
    none = np.full((*given.batch, 1), np.nan)
    return Bearings(np.zeros(1), np.zeros((1, 2)), none, none)


def _last(values: Array) -> Array:
    """(..., N) as (N, B)."""
    return np.ascontiguousarray(values.reshape(prod(values.shape[:-1]), values.shape[-1]).T)


def _shared(field: NDArray[_Kind], columns: NDArray[np.int_]) -> NDArray[_Kind]:
    """Columns of a field that all targets may share."""
    return field if field.shape[-1] == 1 else field[..., columns]
