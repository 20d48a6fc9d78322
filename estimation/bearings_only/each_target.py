"""What the bearings of each target alone say of the frames of the carriers that took them.

`jointly` makes all targets move alike. Here every target has its own motion: each is solved by
itself together with the frames, all in one batch, and what they say of the frames is to be summed
as information.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.criterion import Criterion, criterion
from estimation.bearings_only.levenberg_marquardt import minimised
from estimation.bearings_only.linear_algebra import inverted
from estimation.bearings_only.measurements import Bearings
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.normal_equations import Normal, products
from estimation.bearings_only.several_carriers import FramePrior, Frames, rows_of, together
from estimation.bearings_only.starts import lines_of, taubin


class EachTarget(NamedTuple):
    """Frames of the other carriers as each of T targets has them, the prior included.

    Attributes:
        frames: (T, G) yaw [rad], east, north [m] of each other carrier.
        covariance: (T, G, G).
        chi2: (T,) of bearings and prior.
        dof: (T,) bearings less parameters of the motion.
        converged: (T,) False: it is not to be used.
    """

    frames: Array
    covariance: Array
    chi2: Array
    dof: NDArray[np.int_]
    converged: NDArray[np.bool_]


class _Framed(NamedTuple):
    """The criterion over the parameters of a target (M) and, after them, of the frames (G)."""

    motion: Criterion
    frames: Frames

    def evaluate(self, p: Array) -> Normal:
        """Cost, half gradient and J'J at p (M + G, T)."""
        size = self.motion.motion.size
        g = p[size:]
        residual, rows, by_frames = rows_of(self.motion, self.frames, p[:size], g)
        gradient, matrix = products(residual, np.concatenate([rows, by_frames]))
        white = g / self.frames.sigmas[:, None]
        gradient[size:] += white / self.frames.sigmas[:, None]
        matrix[size:, size:] += np.diag(1 / self.frames.sigmas**2)[..., None]
        return Normal((residual**2).sum(axis=0) + (white**2).sum(axis=0), gradient, matrix)

    def admissible(self, p: Array) -> Array:
        """The target's parameters of unit length."""
        size = self.motion.motion.size
        return np.concatenate([self.motion.admissible(p[:size]), p[size:]])

    def gauge(self, p: Array) -> Array:
        """The homogeneous parameters: their length means nothing."""
        return self.motion.gauge(p)

    def take(self, columns: NDArray[np.int_]) -> _Framed:
        """The same for some of the targets."""
        return self._replace(motion=self.motion.take(columns))


def each_target(
    carriers: Sequence[Bearings], priors: Sequence[FramePrior], motion: Motion
) -> EachTarget:
    """Every target by itself, with the frames of the other carriers.

    Args:
        carriers, priors, motion: as of `jointly`.
    """
    scene, frames = together(carriers, priors)
    problem = _Framed(criterion(scene, motion), frames)
    with np.errstate(all="ignore"):
        start = taubin(lines_of(scene, motion, np.zeros((0, 1, 1))))
        none = np.zeros((len(frames.sigmas), scene.targets))
        end = minimised(problem, np.concatenate([start, none]))
        h = problem.gauge(end.p)
        trace = np.einsum("iit->t", end.normal.matrix) + 1e-290
        covariance = inverted(end.normal.matrix + trace * h[:, None] * h[None])
    size, length = motion.size, scene.length_m[0]
    units = np.tile([1.0, length, length], frames.others)
    return EachTarget(
        end.p[size:].T * units,
        np.moveaxis(covariance[size:, size:], 2, 0) * np.outer(units, units),
        end.normal.cost,
        scene.seen - (size - 1),
        end.converged & np.isfinite(end.normal.cost),
    )
