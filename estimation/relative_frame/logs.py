"""What goes into a registration of two carriers and what comes out of it.

Convention of paper 000: corrections are *added*. True bearing = reported bearing + c, with c1 for
the own carrier and c2 for the other; true offset of the other carrier = reported + (x, y).

Two axis systems, and the difference matters. In *fixed axes* (true north) a common turn of both
norths about the own carrier changes no misclosure, so x, y, c1, c2 keep that part of the prior
however many targets there are. In *own axes* (the own sensors' north, wrong by c1) the unknowns
are q = R(-c1) (offset + (x, y)), where the other carrier stands on the own display, and
D = c2 - c1, what to add to its bearings: all three are observable.

All types take leading batch axes `...`, one experiment an entry; L counts associated pairs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, ArrayLike, broadcast, transposed
from estimation.frames import east_north_by_polar, polar_from_east_north, rotation_clockwise


@dataclass(frozen=True, eq=False, slots=True)
class PolarLogs:
    """Target logs of one carrier, the i-th of the same target as the i-th of the other's.

    Attributes:
        bearing_rad: (..., L) clockwise from the carrier's own north.
        range_m: (..., L) level ranges (slant ones go through `frames.level_plane` first).
        covariance: (..., L, 2, 2) of (bearing, range) [rad^2, rad m, m^2].
    """

    bearing_rad: Array
    range_m: Array
    covariance: Array

    @classmethod
    def from_sigmas(
        cls,
        bearing_rad: ArrayLike,
        range_m: ArrayLike,
        sigma_bearing_rad: ArrayLike,
        sigma_range_m: ArrayLike,
    ) -> Self:
        """Logs with independent errors; sigmas broadcast against the (..., L) logs.

        Raises:
            ValueError: bearings and ranges differ in shape, or a sigma is not above zero.
        """
        bearing, ranges = np.asarray(bearing_rad, dtype=float), np.asarray(range_m, dtype=float)
        if bearing.shape != ranges.shape or bearing.ndim == 0:
            raise ValueError(
                "need a bearing and a range of every target, shape (..., L): "
                f"bearings {bearing.shape}, ranges {ranges.shape}"
            )
        _, sigma_bearing, sigma_range = broadcast(bearing, sigma_bearing_rad, sigma_range_m)
        if not ((sigma_bearing > 0).all() and (sigma_range > 0).all()):
            raise ValueError("every sigma of a target log must be above zero")
        # Each entry of the matrices contiguous over the logs: a million pairs in 7 % less time.
        covariance = np.moveaxis(np.zeros((2, 2, *bearing.shape)), (0, 1), (-2, -1))
        covariance[..., 0, 0] = sigma_bearing**2
        covariance[..., 1, 1] = sigma_range**2
        return cls(bearing, ranges, covariance)

    @classmethod
    def from_east_north(cls, east_north_m: ArrayLike, covariance: ArrayLike) -> Self:
        """Logs given as positions (..., L, 2) [m] in carrier axes, covariances (..., L, 2, 2).

        Raises:
            ValueError: a target stands on the carrier, where it has no bearing.
        """
        bearing, ranges = polar_from_east_north(east_north_m)
        if not (ranges > 0).all():
            raise ValueError("a target log at the carrier itself has no bearing")
        to_polar = np.linalg.inv(east_north_by_polar(bearing, ranges)).astype(float)
        return cls(bearing, ranges, to_polar @ np.asarray(covariance) @ transposed(to_polar))

    @property
    def count(self) -> int:
        """L, the number of target logs."""
        return int(self.bearing_rad.shape[-1])

    def take(self, which: slice | NDArray[Any]) -> PolarLogs:
        """The logs that a slice, mask or index array along L names, in its order."""
        return PolarLogs(
            self.bearing_rad[..., which],
            self.range_m[..., which],
            self.covariance[..., which, :, :],
        )


@dataclass(frozen=True, eq=False, slots=True)
class RelativeFramePrior:
    """What navigation says of the other carrier's frame before any target is compared.

    Attributes:
        offset_m: (..., 2) reported position of the other carrier from the own, east and north.
        offset_covariance: (..., 2, 2) [m^2] of it.
        sigma_c1_rad: (...) of the own carrier's north; 0 when it is known.
        sigma_c2_rad: (...) of the other carrier's north.
    """

    offset_m: Array
    offset_covariance: Array
    sigma_c1_rad: ArrayLike
    sigma_c2_rad: ArrayLike

    @classmethod
    def from_sigmas(
        cls,
        offset_m: ArrayLike,
        sigma_x_m: float,
        sigma_y_m: float,
        sigma_c1_rad: float,
        sigma_c2_rad: float,
    ) -> Self:
        """The paper's prior: independent errors east and north.

        Raises:
            ValueError: a sigma is negative.
        """
        if min(sigma_x_m, sigma_y_m, sigma_c1_rad, sigma_c2_rad) < 0:
            raise ValueError("no sigma of the relative frame may be negative")
        covariance = np.diag([sigma_x_m**2, sigma_y_m**2])
        return cls(np.asarray(offset_m, dtype=float), covariance, sigma_c1_rad, sigma_c2_rad)

    @property
    def covariance(self) -> Array:
        """P0 (..., 4, 4) of (x, y, c1, c2)."""
        variances = np.square(self.sigma_c1_rad), np.square(self.sigma_c2_rad)
        return _block_diagonal(self.offset_covariance, *variances)

    @property
    def root(self) -> Array:
        """A square root (..., 4, 4) of P0, root @ root.T = P0; P0 may be singular."""
        variances, axes = np.linalg.eigh(self.offset_covariance)
        offset_root = axes * np.sqrt(np.maximum(variances, 0))[..., None, :]
        return _block_diagonal(offset_root, self.sigma_c1_rad, self.sigma_c2_rad)


class RelativeFrame(NamedTuple):
    """Corrections in fixed axes, theta = (x, y, c1, c2), and how well the pairs agree.

    Attributes:
        offset_correction_m: (..., 2) x and y, to add to the reported offset.
        c1_rad, c2_rad: (...) to add to the own and to the other carrier's bearings.
        covariance: (..., 4, 4) of theta [m^2, m rad, rad^2].
        chi2: (...) misclosure; chi-squared of `dof` when the sigmas are honest.
        dof: 2 L.
        pairs: L.
    """

    offset_correction_m: Array
    c1_rad: Array
    c2_rad: Array
    covariance: Array
    chi2: Array
    dof: int
    pairs: int


class OwnAxesFrame(NamedTuple):
    """The other carrier's frame in own (biased) sensor axes; nothing here needs true north.

    Attributes:
        q_m: (..., 2) position of the other carrier, east and north of own axes.
        D_rad: (...) c2 - c1, to add to its bearings.
        covariance: (..., 3, 3) of (q, D) [m^2, m rad, rad^2].
    """

    q_m: Array
    D_rad: Array
    covariance: Array


def in_own_axes(frame: RelativeFrame, prior: RelativeFramePrior) -> OwnAxesFrame:
    """The frame as q = R(-c1) (offset + (x, y)) and D = c2 - c1; covariance to first order."""
    offset = prior.offset_m + frame.offset_correction_m
    return _seen_from_own(offset, frame.c1_rad, frame.c2_rad, frame.covariance)


def prior_in_own_axes(prior: RelativeFramePrior) -> OwnAxesFrame:
    """The prior alone: q = the reported offset, D = 0, and how uncertain c1 and c2 make them."""
    zero = np.zeros(prior.offset_m.shape[:-1])
    return _seen_from_own(prior.offset_m, zero, zero, prior.covariance)


def _seen_from_own(
    offset_m: Array, c1_rad: Array, c2_rad: Array, covariance: Array
) -> OwnAxesFrame:
    """(q, D) of an offset and two norths, with the 4x4 covariance of (x, y, c1, c2) mapped."""
    own_from_fixed = rotation_clockwise(-c1_rad)
    q = (own_from_fixed @ offset_m[..., None])[..., 0]
    by_theta = np.zeros((*q.shape[:-1], 3, 4))
    by_theta[..., :2, :2] = own_from_fixed
    by_theta[..., 0, 2] = -q[..., 1]  # c1 more, q less: it turns counter-clockwise
    by_theta[..., 1, 2] = q[..., 0]
    by_theta[..., 2, 2:] = -1, 1
    return OwnAxesFrame(q, c2_rad - c1_rad, by_theta @ covariance @ transposed(by_theta))


def _block_diagonal(offset_block: Array, c1: ArrayLike, c2: ArrayLike) -> Array:
    """(..., 4, 4) with a 2x2 block for (x, y) and one entry each for c1 and c2."""
    batch = np.broadcast_shapes(offset_block.shape[:-2], np.shape(c1), np.shape(c2))
    matrix = np.zeros((*batch, 4, 4))
    matrix[..., :2, :2] = offset_block
    matrix[..., 2, 2], matrix[..., 3, 3] = c1, c2
    return matrix
