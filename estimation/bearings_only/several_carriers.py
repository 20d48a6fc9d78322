"""Bearings of several carriers to common targets, each carrier's north and place in doubt.

The own carrier, the first, is the gauge. The unknowns are yaw and offset of every other carrier
and the motion of every target; targets are eliminated one by one (Schur complement), so that the
system to solve has three unknowns a carrier however many targets there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.criterion import Criterion, criterion
from estimation.bearings_only.estimate import Estimate
from estimation.bearings_only.linear_algebra import cholesky, solved
from estimation.bearings_only.measurements import Bearings, Scene, padded, scene_of
from estimation.bearings_only.motions import CONSTANT_VELOCITY, Motion
from estimation.bearings_only.normal_equations import directions
from estimation.bearings_only.starts import lines_of, taubin

_STEPS = 40
_SETTLED = 1e-6


class FramePrior(NamedTuple):
    """What is known of another carrier's frame: sigmas of its yaw and of its place."""

    sigma_yaw_rad: float
    sigma_offset_m: float = 0.0


class JointSolution(NamedTuple):
    """Frames of the carriers and motions of the targets.

    Attributes:
        yaw_rad: (C,) to add to a carrier's bearings; the own carrier's is 0.
        offset_m: (C, 2) to add to its places.
        covariance: (3 (C - 1), 3 (C - 1)) of yaw, east, north of each other carrier.
        targets: the T targets, their covariances with the frames' uncertainty; `inverse_range` is
            from the carrier of the last bearing, at equal times the own one.
        chi2, dof: of all bearings.
        converged: False: it is not to be used.
    """

    yaw_rad: Array
    offset_m: Array
    covariance: Array
    targets: Estimate
    chi2: float
    dof: int
    converged: bool


class Frames(NamedTuple):
    """Who took each row, and what is known of the others, in units of the scene.

    Attributes:
        carrier: (N,) 0 = the own one.
        sigmas: (G,) yaw [rad], east, north [lengths] of each other carrier.
    """

    carrier: NDArray[np.int_]
    sigmas: Array

    @property
    def others(self) -> int:
        """How many carriers there are but the own."""
        return len(self.sigmas) // 3


class _System(NamedTuple):
    """The criterion at a point, targets and frames apart.

    Attributes:
        cost: of bearings and prior.
        gradient, matrix: (M, T), (M, M, T) of the targets.
        frame_gradient, frame_matrix: (G,), (G, G).
        coupling: (M, G, T).
    """

    cost: float
    gradient: Array
    matrix: Array
    frame_gradient: Array
    frame_matrix: Array
    coupling: Array


def jointly(
    carriers: Sequence[Bearings],
    priors: Sequence[FramePrior],
    motion: Motion = CONSTANT_VELOCITY,
) -> JointSolution:
    """Targets and frames together, from bearings alone.

    Args:
        carriers: of each carrier, the own first: times (N,), places (N, 2), bearings (T, N) of
            the T targets, not finite where it does not see one.
        priors: of each carrier but the own.
        motion: of the targets; a polynomial.

    Raises:
        ValueError: not one prior for every other carrier, or not the same targets.
    """
    if len(priors) != len(carriers) - 1 or len({c.bearing_rad.shape[0] for c in carriers}) != 1:
        raise ValueError("need the same targets from all carriers and a prior of each but the own")
    scene, frames = together(carriers, priors)
    problem = criterion(scene, motion)
    with np.errstate(all="ignore"):
        p = problem.admissible(taubin(lines_of(scene, motion, np.zeros((0, 1, 1)))))
        p, g, system, converged = _descended(problem, frames, p)
        return _told(problem, frames, p, g, system, converged)


def together(carriers: Sequence[Bearings], priors: Sequence[FramePrior]) -> tuple[Scene, Frames]:
    """One scene of all rows in order of time, at equal times the own carrier's last."""
    carriers = [padded(c) for c in carriers]
    t = np.concatenate([c.t_s for c in carriers])
    who = np.repeat(np.arange(len(carriers)), [len(c.t_s) for c in carriers])
    order = np.lexsort((-who, t))
    everyone = [np.broadcast_to(c.sigma_rad, c.bearing_rad.shape) for c in carriers]
    scene = scene_of(
        Bearings(
            t[order],
            np.concatenate([c.observer_m for c in carriers])[order],
            np.concatenate([c.bearing_rad for c in carriers], axis=1)[:, order],
            np.concatenate(everyone, axis=1)[:, order],
        )
    )
    length = scene.length_m[0]
    sigmas = [
        s
        for prior in priors
        for s in (prior.sigma_yaw_rad, *2 * (max(prior.sigma_offset_m, 1e-3) / length,))
    ]
    return scene, Frames(who[order], np.array(sigmas))


def _descended(problem: Criterion, frames: Frames, p: Array) -> tuple[Array, Array, _System, bool]:
    """Levenberg-Marquardt over targets and frames together."""
    g = np.zeros(len(frames.sigmas))
    here = _system(problem, frames, p, g)
    damping = 1e-4
    for _ in range(_STEPS):
        step_p, step_g, gain = _step(problem, here, p, damping)
        trial_p, trial_g = problem.admissible(p + step_p), g + step_g
        trial = _system(problem, frames, trial_p, trial_g)
        if trial.cost <= here.cost:
            p, g, here, damping = trial_p, trial_g, trial, damping * 0.1
        else:
            damping *= 10
        if gain < _SETTLED:
            return p, g, here, True
    return p, g, here, False


def _system(problem: Criterion, frames: Frames, p: Array, g: Array) -> _System:
    """Residuals of all bearings with the carriers' frames as g says, and their derivatives."""
    residual, rows, frame_rows = rows_of(problem, frames, p, g[:, None])
    white = g / frames.sigmas
    return _System(
        float((residual**2).sum() + white @ white),
        np.einsum("mnt,nt->mt", rows, residual),
        np.einsum("int,jnt->ijt", rows, rows),
        np.einsum("gnt,nt->g", frame_rows, residual) + white / frames.sigmas,
        np.einsum("int,jnt->ij", frame_rows, frame_rows) + np.diag(1 / frames.sigmas**2),
        np.einsum("mnt,gnt->mgt", rows, frame_rows),
    )


def rows_of(problem: Criterion, frames: Frames, p: Array, g: Array) -> tuple[Array, Array, Array]:
    """Residuals (N, T) of all bearings, and their derivatives by targets and by frames.

    Args:
        p: (M, T) of the targets.
        g: (G, T) yaw and offset of each other carrier as each target has them; or (G, 1).

    Returns:
        (N, T), (M, N, T), (G, N, T).
    """
    each = np.concatenate([np.zeros((1, 3, g.shape[1])), g.reshape(-1, 3, g.shape[1])])
    yaw, east, north = np.moveaxis(each[frames.carrier], 1, 0)
    scene = problem.scene._replace(observer=problem.scene.observer + (east + 1j * north))
    d, by = directions(scene, problem.motion, p)
    reciprocal = scene.weight / (d + 1e-300)
    turned = scene.toward * np.exp(-1j * yaw)
    residual = scene.weight * np.angle(d * turned.conj())
    moved = -p[problem.motion.scale_row] * reciprocal
    by_frames = np.zeros((len(g), *residual.shape))
    for k in range(frames.others):
        mine = (frames.carrier == k + 1)[:, None]
        by_frames[3 * k] = scene.weight * mine
        by_frames[3 * k + 1] = moved.imag * mine
        by_frames[3 * k + 2] = moved.real * mine
    return residual, (by * reciprocal).imag, by_frames


def _step(
    problem: Criterion, here: _System, p: Array, damping: float
) -> tuple[Array, Array, float]:
    """A damped step of targets and frames, and what it should gain."""
    factor = cholesky(_regular(problem, here, p, damping))
    reduced, by_frames = _reduced(here, factor)
    free = solved(factor, here.gradient)
    right = here.frame_gradient - np.einsum("mgt,mt->g", here.coupling, free)
    diagonal = np.diag(np.diag(here.frame_matrix)) * damping
    step_g = -np.linalg.solve(reduced + diagonal, right) if len(right) else np.zeros(0)
    step_p = -free - np.einsum("mgt,g->mt", by_frames, step_g)
    gain = -float((step_p * here.gradient).sum() + step_g @ here.frame_gradient)
    return step_p, step_g, gain


def _regular(problem: Criterion, here: _System, p: Array, damping: float) -> Array:
    """The targets' matrices with the gauge held and the diagonal damped."""
    gauge, diagonal = problem.gauge(p), np.einsum("iit->it", here.matrix)
    regular: Array = here.matrix + diagonal.sum(axis=0) * gauge[:, None] * gauge[None]
    np.einsum("iit->it", regular)[...] += (damping + 1e-12) * diagonal
    return regular


def _reduced(here: _System, factor: Array) -> tuple[Array, Array]:
    """The frames' matrix less what the targets take, and targets by frames (M, G, T)."""
    columns = [solved(factor, here.coupling[:, k]) for k in range(here.coupling.shape[1])]
    by_frames = np.stack(columns, axis=1) if columns else np.zeros_like(here.coupling)
    taken = np.einsum("mgt,mht->gh", here.coupling, by_frames)
    return here.frame_matrix - taken, by_frames


def _told(
    problem: Criterion, frames: Frames, p: Array, g: Array, system: _System, converged: bool
) -> JointSolution:
    """The result in metres, each target's information with the frames integrated out."""
    factor = cholesky(_regular(problem, system, p, 0.0))
    reduced, by_frames = _reduced(system, factor)
    own = np.einsum("mgt,mht->tgh", system.coupling, by_frames)
    if len(g):
        inner = np.linalg.inv(reduced + own)
        lost = np.einsum("mgt,tgh,nht->mnt", system.coupling, inner, system.coupling)
    else:
        lost = np.zeros_like(system.matrix)
    covariance = np.asarray(np.linalg.inv(reduced), dtype=float)
    length = problem.scene.length_m[0]
    units = np.tile([1.0, length, length], frames.others)
    each = np.concatenate([np.zeros((1, 3)), (g * units).reshape(-1, 3)])
    everyone = np.full(p.shape[1], converged)
    chi2 = problem.of_bearings(p).cost
    return JointSolution(
        each[:, 0],
        each[:, 1:],
        covariance * np.outer(units, units),
        Estimate(problem.scene, problem.motion, p, system.matrix - lost, chi2, everyone),
        system.cost,
        int(problem.scene.seen.sum()) - p.shape[1] * (problem.motion.size - 1),
        converged,
    )
