"""Where an other carrier's frame lies against the own one, from the pairs of one instant.

Memoryless: the pairs of this instant and the prior, by paper 000's closed form or, where the
settings ask for it, by the exact adjustment (and by the closed form where that does not end). The
known difference of the two tangent planes is taken out through ECEF first, so that only the
residual (offset, c1, c2) is left to the paper's flat algebra.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace as with_fields

import numpy as np

from estimation.arrays import Array, transposed
from estimation.consistency import nis
from estimation.frames import on_surface, rotation_clockwise, yaw_rad
from estimation.relative_frame import PolarLogs, RelativeFrame, RelativeFramePrior
from estimation.relative_frame.closed_form import conditions
from estimation.relative_frame.methods import Method, adjustment, linearised_once

from ..navigation import site
from ..sources.sightings import Pair, Sightings
from ..state import Estimate
from .corrections import Misclosure, Poses, estimated

METHODS: Mapping[str, Method] = {"closed_form": linearised_once, "adjustment": adjustment}
LEAST_SIGMA_M, LEAST_SIGMA_RAD = 1e-3, 1e-7
"""A prior is never surer than this, so that every ratio to it exists."""
LEAST_RANGE_M = 1.0
"""A target log nearer to its carrier has no bearing."""


def in_own_plane(other: Sightings, between: Poses) -> Sightings:
    """The other's sightings with their places along the axes of the own tangent plane.

    They stay relative to the other's reported position; what remains between the two frames are
    the errors of the poses alone.
    """
    if not other.log:
        return other
    east, north = other.east_north_m.T
    enu = on_surface(site(between.other), east, north, other.altitude_m)
    turn = rotation_clockwise(yaw_rad(between.own_from_other))
    return with_fields(
        other,
        east_north_m=enu @ between.own_from_other.rotation[:2].T,
        covariance=turn @ other.covariance @ turn.T,
    )


def prior_of(between: Poses, own_covariance: Array, other_covariance: Array) -> RelativeFramePrior:
    """What both carriers' navigation says of the relative frame.

    A stated correlation between a carrier's position and its north is left out: the paper's prior
    has no place for it.

    Args:
        own_covariance, other_covariance: (3, 3) of east, north and north direction, each in its
            carrier's own plane.
    """
    turn = rotation_clockwise(yaw_rad(between.own_from_other))
    offset = own_covariance[:2, :2] + turn @ other_covariance[:2, :2] @ turn.T
    sigma_c1, sigma_c2 = np.sqrt([own_covariance[2, 2], other_covariance[2, 2]])
    return RelativeFramePrior(
        offset_m=between.own_from_other.translation_m[:2],
        offset_covariance=offset + LEAST_SIGMA_M**2 * np.eye(2),
        sigma_c1_rad=max(float(sigma_c1), LEAST_SIGMA_RAD),
        sigma_c2_rad=max(float(sigma_c2), LEAST_SIGMA_RAD),
    )


def with_bearings(pairs: Sequence[Pair], own: Sightings, other: Sightings) -> list[Pair]:
    """The pairs whose logs both stand clear of their carriers."""
    own_range = np.hypot(*own.east_north_m.T)
    other_range = np.hypot(*other.east_north_m.T)
    return [
        pair
        for pair in pairs
        if own_range[pair.own] > LEAST_RANGE_M and other_range[pair.other] > LEAST_RANGE_M
    ]


def register(
    own: Sightings,
    other: Sightings,
    pairs: Sequence[Pair],
    prior: RelativeFramePrior,
    between: Poses,
    method: str = "closed_form",
    plot: Array | None = None,
) -> tuple[Estimate, Array]:
    """The frame from one or more pairs, and each pair's normalised squared misclosure (L,).

    Args:
        other: its places along the axes of the own plane.
        method: one of `METHODS`.
        plot: what one plot tells of the frame, see `directions`.
    """
    own_logs = _polar(own, [pair.own for pair in pairs])
    other_logs = _polar(other, [pair.other for pair in pairs])
    registered = METHODS[method](own_logs, other_logs, prior)
    if not registered.converged:
        method = "closed_form"
        registered = METHODS[method](own_logs, other_logs, prior)
    estimate = estimated(
        registered.own_axes,
        registered.fixed,
        prior,
        between,
        Misclosure(registered.fixed.pairs, float(registered.fixed.chi2), registered.fixed.dof),
        method,
        plot,
    )
    return estimate, _after_correction(own_logs, other_logs, prior, registered.fixed)


def _polar(logs: Sightings, which: list[int]) -> PolarLogs:
    return PolarLogs.from_east_north(logs.east_north_m[which], logs.covariance[which])


def _after_correction(
    own: PolarLogs, other: PolarLogs, prior: RelativeFramePrior, frame: RelativeFrame
) -> Array:
    """Normalised squared misclosures (L,) that the correction leaves, 2 dof each.

    The correction was made of the same pairs: what is left varies by S - H P H', not by S. A
    single pair leaves next to nothing; the billionth of S keeps that from being singular.
    """
    c = conditions(own, other, prior.offset_m)
    theta = np.array([*frame.offset_correction_m, frame.c1_rad, frame.c2_rad])
    h = np.zeros((own.count, 2, 4))
    h[:, 0, 0] = h[:, 1, 1] = -1.0
    h[:, 0, 2], h[:, 1, 2], h[:, 0, 3], h[:, 1, 3] = c.a_b1_x, c.a_b1_y, c.a_b2_x, c.a_b2_y
    left = np.array([c.w_x, c.w_y]).T + h @ theta
    s = np.array([[c.s_xx, c.s_xy], [c.s_xy, c.s_yy]]).transpose(2, 0, 1)
    return nis(left, s * (1 + 1e-9) - h @ frame.covariance @ transposed(h))
