"""A frame as it is published: in own and in fixed axes, with what is determined and what is not."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from estimation.arrays import Array
from estimation.frames import RigidTransform, target_from_source, wrap_pi
from estimation.relative_frame import (
    OwnAxesFrame,
    RelativeFrame,
    RelativeFramePrior,
    directions,
    in_own_axes,
    prior_in_own_axes,
)
from schemas.messages import Direction, FixedAxes, OwnAxes, Pose

from ..navigation import site, symmetric, triangle_of
from ..state import Estimate

MOST_CHI2 = 1e18


class Poses(NamedTuple):
    """Reported poses of two carriers at one instant, and the transform between their planes."""

    t_ns: int
    own: Pose
    other: Pose
    own_from_other: RigidTransform


def poses(t_ns: int, own: Pose, other: Pose) -> Poses:
    """Two poses with the known transform between their tangent planes."""
    return Poses(t_ns, own, other, target_from_source(site(own), site(other)))


class Misclosure(NamedTuple):
    """How well the pairs behind a frame agree."""

    pairs: int
    chi2: float
    dof: int


def estimated(
    frame: OwnAxesFrame,
    fixed: RelativeFrame,
    prior: RelativeFramePrior,
    between: Poses,
    misclosure: Misclosure,
    method: str,
    plot: Array | None = None,
) -> Estimate:
    """A frame found at an instant, with its directions against what navigation knew.

    Args:
        plot: what one plot tells of the frame, see `directions`.
    """
    found = directions(frame.covariance, prior_in_own_axes(prior).covariance, plot)
    return Estimate(
        valid_t_ns=between.t_ns,
        own_pose=between.own,
        other_pose=between.other,
        own_axes=_own_axes(frame, prior),
        fixed_axes=_fixed_axes(fixed),
        directions=tuple(
            Direction(name=d.name, ratio=min(d.ratio, 1e6), status=d.status) for d in found
        ),
        pairs=misclosure.pairs,
        chi2=min(max(misclosure.chi2, 0.0), MOST_CHI2),
        dof=misclosure.dof,
        method=method,
    )


def at(estimate: Estimate, prior: RelativeFramePrior, moved_m: float = 0.0) -> OwnAxesFrame:
    """An estimate at the reported poses of another instant: its errors of frames stay.

    Args:
        prior: of that instant; only its reported offset is used.
        moved_m: sigma per axis by which the reported offset may have gone astray since.
    """
    return in_own_axes(_frame(estimate.fixed_axes, moved_m), prior)


def predicted(
    estimate: Estimate, prior: RelativeFramePrior, between: Poses, moved_m: float
) -> Estimate:
    """An estimate carried on to an instant at which nothing was measured; see `at`."""
    frame = _frame(estimate.fixed_axes, moved_m)
    return replace(
        estimate,
        valid_t_ns=between.t_ns,
        own_pose=between.own,
        other_pose=between.other,
        own_axes=_own_axes(in_own_axes(frame, prior), prior),
        fixed_axes=_fixed_axes(frame),
    )


def within_bounds(estimate: Estimate) -> Estimate:
    """The estimate itself, if the wire can carry it.

    Raises:
        ValueError: a number of it is not finite, or lies beyond what the wire allows.
    """
    return msgspec.convert(msgspec.to_builtins(estimate), Estimate)


def frame_of(estimate: Estimate) -> OwnAxesFrame:
    """The frame in own axes, as `estimation` has it."""
    axes = estimate.own_axes
    q = np.array([axes.east_m, axes.north_m])
    return OwnAxesFrame(q, np.array(axes.rotation_rad), symmetric(axes.covariance, 3))


def _own_axes(frame: OwnAxesFrame, prior: RelativeFramePrior) -> OwnAxes:
    return OwnAxes(
        east_m=float(frame.q_m[0]),
        north_m=float(frame.q_m[1]),
        rotation_rad=float(wrap_pi(frame.D_rad)),
        covariance=triangle_of(frame.covariance),
        reported_east_m=float(prior.offset_m[0]),
        reported_north_m=float(prior.offset_m[1]),
    )


def _fixed_axes(frame: RelativeFrame) -> FixedAxes:
    return FixedAxes(
        offset_east_m=float(frame.offset_correction_m[0]),
        offset_north_m=float(frame.offset_correction_m[1]),
        c1_rad=float(wrap_pi(frame.c1_rad)),
        c2_rad=float(wrap_pi(frame.c2_rad)),
        covariance=triangle_of(frame.covariance),
    )


def _frame(fixed: FixedAxes, moved_m: float) -> RelativeFrame:
    """The estimate of a message as `estimation` has it, its offset less sure by `moved_m`."""
    covariance = symmetric(fixed.covariance, 4)
    covariance[(0, 1), (0, 1)] += moved_m**2
    offset = np.array([fixed.offset_east_m, fixed.offset_north_m])
    c1, c2 = np.array(fixed.c1_rad), np.array(fixed.c2_rad)
    return RelativeFrame(offset, c1, c2, covariance, np.array(0.0), 0, 0)
