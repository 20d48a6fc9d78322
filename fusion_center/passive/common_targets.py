"""The frame of a carrier from the bearings of targets that it shares with the own one.

Nothing is supposed of how a target moves but that it has inertia. Each is solved by itself with
the frame, as each of several motions of growing freedom; what it says of the frame is the average
of these, each weighed by how well it agrees for as much as it may bend (Schwarz's criterion), the
differences between them counted as doubt. A single motion taken for the true one made frames up to
twice as sure as they were while targets turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_ACCELERATION,
    CONSTANT_JERK,
    CONSTANT_VELOCITY,
    Bearings,
    EachTarget,
    FramePrior,
    bearings,
    each_target,
    spline,
)
from estimation.frames import rotation_clockwise
from estimation.relative_frame import OwnAxesFrame, RelativeFramePrior, prior_in_own_axes

from ..relative_frames.corrections import Misclosure, Poses

MOTIONS = (CONSTANT_VELOCITY, CONSTANT_ACCELERATION, CONSTANT_JERK, spline(4), spline(8))
UNFIT = 1e-3
"""Probability of its chi2 below which no motion of a target is believed, and it is left out."""
MANOEUVRE_SIGMAS = 3.0
"""Of a bearing, across the distance of the carriers: how far a manoeuvre leaves a uniform way."""


class Seen(NamedTuple):
    """Common targets as one carrier has them over the window, along the own plane of now.

    Attributes:
        t_s: (N,) before now, negative.
        way_m: (N, 2) from where it is now.
        bearing_rad, sigma_rad: (T, N); a bearing that there is not is nan.
    """

    t_s: Array
    way_m: Array
    bearing_rad: Array
    sigma_rad: Array


class Scene(NamedTuple):
    """What both carriers have of their common targets, and what navigation says of the frame."""

    own: Seen
    other: Seen
    between: Poses
    prior: RelativeFramePrior

    @property
    def pivot_m(self) -> Array:
        """(2,) middle of the other's way: about it, its place and its north are nearly apart."""
        middle: Array = self.other.way_m.mean(axis=0)
        return middle


def has_manoeuvred(scene: Scene) -> bool:
    """Whether a carrier's way leaves the uniform one by more than bearings err."""
    apart_m = float(np.hypot(*scene.prior.offset_m))
    for seen in (scene.own, scene.other):
        sigma = float(np.median(seen.sigma_rad[np.isfinite(seen.bearing_rad)]))
        uniform = np.column_stack([np.ones_like(seen.t_s), seen.t_s])
        left = seen.way_m - uniform @ np.linalg.lstsq(uniform, seen.way_m, rcond=None)[0]
        if np.hypot(*left.T).max() > MANOEUVRE_SIGMAS * sigma * apart_m:
            return True
    return False


class _Said(NamedTuple):
    """What a target says of the frame at the middle of the other's way, a wide prior included.

    Attributes:
        mean: (3,) yaw, east, north; information: (3, 3).
        chi2, dof: of the likeliest motion.
    """

    mean: Array
    information: Array
    chi2: float
    dof: int


def found_frame(scene: Scene) -> tuple[OwnAxesFrame, Misclosure] | None:
    """The frame that bearings and navigation together make likeliest; None if no target agrees.

    What each target says is summed as information, with navigation's prior, which has
    correlations, in place of the one of the solutions. A first pass finds how the other carrier's
    way is turned.
    """
    turned_rad, prior, wide = 0.0, _about_pivot(scene), wide_prior(scene)
    for _ in range(2):
        carriers = carriers_of(scene, turned_rad)
        solved = [each_target(carriers, [wide], motion) for motion in MOTIONS]
        each = [_averaged(solved, target) for target in range(len(scene.own.bearing_rad))]
        said = [one for one in each if one is not None]
        if not said:
            return None
        mean, covariance, chi2 = _summed(said, wide, prior)
        turned_rad = float(mean[0])
    told = Misclosure(len(said), chi2, sum(one.dof for one in said))
    return _now(scene, mean, covariance), told


def carriers_in(scene: Scene, frame: OwnAxesFrame) -> tuple[Bearings, Bearings]:
    """Bearings of both, the other carrier where a frame has it now."""
    own, other, turned_rad = scene.own, scene.other, float(frame.D_rad)
    way = other.way_m @ rotation_clockwise(turned_rad).T
    bearing = other.bearing_rad + turned_rad
    return (
        bearings(own.t_s, own.way_m, own.bearing_rad, own.sigma_rad),
        bearings(other.t_s, frame.q_m + way, bearing, other.sigma_rad),
    )


def prior_of(frame: OwnAxesFrame) -> FramePrior:
    """How surely a frame is known, without correlations."""
    return _uncorrelated(frame.covariance[np.ix_((2, 0, 1), (2, 0, 1))])


def wide_prior(scene: Scene) -> FramePrior:
    """What navigation says of the frame at the middle of the other's way, without correlations."""
    return _uncorrelated(_about_pivot(scene))


def _uncorrelated(covariance: Array) -> FramePrior:
    """Of a covariance (3, 3) of yaw, east, north."""
    sigma_m = float(np.sqrt(np.trace(covariance[1:, 1:])))
    return FramePrior(float(np.sqrt(covariance[0, 0])), sigma_m)


def _about_pivot(scene: Scene) -> Array:
    """Covariance (3, 3) of yaw, east, north of the frame at the middle of the other's way."""
    known, (east, north) = prior_in_own_axes(scene.prior).covariance, scene.pivot_m
    by_frame = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, north], [0.0, 1.0, -east]])
    covariance: Array = by_frame @ known @ by_frame.T
    return covariance


def carriers_of(scene: Scene, turned_rad: float) -> tuple[Bearings, Bearings]:
    """Bearings of both, the other's way turned about its middle."""
    own, other, pivot = scene.own, scene.other, scene.pivot_m
    way = pivot + (other.way_m - pivot) @ rotation_clockwise(turned_rad).T
    places = own.way_m, scene.prior.offset_m + way
    one, two = (
        bearings(seen.t_s, place, seen.bearing_rad, seen.sigma_rad)
        for seen, place in zip((own, other), places, strict=True)
    )
    return one, two


def _averaged(solved: Sequence[EachTarget], target: int) -> _Said | None:
    """The mixture of all motions of a target as one Gaussian; None where none of them fits.

    Source: G. Schwarz, Annals of Statistics 6 (1978), 461-464.
    """
    from scipy.special import chdtrc  # 0.1 s, kept out of the start

    usable = [
        (float(s.chi2[target] + motion.size * np.log(max(s.dof[target] + motion.size, 2))), s)
        for s, motion in zip(solved, MOTIONS, strict=True)
        if s.converged[target] and s.dof[target] >= 1 and np.isfinite(s.covariance[target]).all()
    ]
    if not usable:
        return None
    least, best = min(usable, key=lambda one: one[0])
    chi2, dof = float(best.chi2[target]), int(best.dof[target])
    if chdtrc(dof, chi2) < UNFIT:
        return None
    weights = np.exp([(least - score) / 2 for score, _ in usable])
    weights /= weights.sum()
    means = np.array([s.frames[target] for _, s in usable])
    mean = weights @ means
    apart = means - mean
    within = np.array([s.covariance[target] for _, s in usable])
    spread = within + apart[:, :, None] * apart[:, None, :]
    return _Said(mean, np.linalg.inv(np.tensordot(weights, spread, 1)), chi2, dof)


def _summed(said: Sequence[_Said], wide: FramePrior, prior: Array) -> tuple[Array, Array, float]:
    """Mean (3,) and covariance (3, 3) of yaw, east, north, and chi2, of all targets together."""
    assumed = np.diag([wide.sigma_yaw_rad, *2 * (max(wide.sigma_offset_m, 1e-3),)]) ** -2.0
    assumed[~np.eye(3, dtype=bool)] = 0.0
    known = np.linalg.inv(prior)
    gained = [_positive(one.information - assumed, assumed) for one in said]
    covariance = np.linalg.inv(known + np.sum(gained, axis=0))
    told = [(g + assumed) @ one.mean for g, one in zip(gained, said, strict=True)]
    mean = covariance @ np.sum(told, axis=0)
    chi2 = float(mean @ known @ mean)
    for one in said:
        apart = mean - one.mean
        chi2 += float(one.chi2 + apart @ one.information @ apart - mean @ assumed @ mean)
    return mean, (covariance + covariance.T) / 2, chi2


def _positive(gained: Array, assumed: Array) -> Array:
    """What bearings add to the wide prior: nothing where motions that differ take more from it."""
    sigma = np.diag(assumed) ** -0.5
    values, vectors = np.linalg.eigh(gained * np.outer(sigma, sigma))
    vectors /= sigma[:, None]
    positive: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return positive


def _now(scene: Scene, mean: Array, covariance: Array) -> OwnAxesFrame:
    """The frame where the other carrier is now, from that at the middle of its way."""
    turn = rotation_clockwise(mean[0])
    gone = turn @ scene.pivot_m
    q = scene.prior.offset_m + scene.pivot_m + mean[1:] - gone
    by_frame = np.array([[-gone[1], 1.0, 0.0], [gone[0], 0.0, 1.0], [1.0, 0.0, 0.0]])
    return OwnAxesFrame(q, np.array(mean[0]), by_frame @ covariance @ by_frame.T)
