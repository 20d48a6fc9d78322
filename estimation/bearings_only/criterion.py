"""The criterion of one motion for many targets: bearings, prior, loss."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.measurements import Scene
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.normal_equations import (
    Loss,
    Normal,
    Tables,
    general_normal,
    polynomial_normal,
    products,
    tables_of,
)
from estimation.bearings_only.prior import MotionPrior, prior_rows

_BOUNDS = {
    "kappa": (-20.0, 20.0),
    "omega": (-12.0, 12.0),
    "angle": (-3.6, 3.6),
    "middle": (-0.97, 0.97),
    "duration": (-4.0, 0.7),
}


class Criterion(NamedTuple):
    """Sum of squared standardised residuals (or their loss) of bearings and prior."""

    scene: Scene
    motion: Motion
    prior: MotionPrior | None = None
    loss: Loss | None = None
    tables: Tables | None = None

    def evaluate(self, p: Array) -> Normal:
        """Cost, half gradient and J'J at p (M, B)."""
        of_bearings = self.of_bearings(p)
        if self.prior is None:
            return of_bearings
        rows = prior_rows(self.scene, self.motion, self.prior, p)
        gradient, matrix = products(rows.residual, rows.jacobian)
        squared = np.einsum("rb,rb->b", rows.residual, rows.residual)
        return Normal(
            of_bearings.cost + squared, of_bearings.gradient + gradient, of_bearings.matrix + matrix
        )

    def of_bearings(self, p: Array) -> Normal:
        """The same of the bearings alone."""
        if self.tables is not None:
            return polynomial_normal(self.scene, self.tables, p, self.loss)
        return general_normal(self.scene, self.motion, p, self.loss)

    def admissible(self, p: Array) -> Array:
        """Parameters of unit length, its shape within bounds."""
        first = self.motion.scale_row + 1
        length = np.sqrt(np.einsum("mb,mb->b", p[:first], p[:first])) + 1e-300
        inside = [
            np.clip(p[first + k], *_BOUNDS[name]) for k, name in enumerate(self.motion.shape_names)
        ]
        return np.concatenate([p[:first] / length, *(row[None] for row in inside)])

    def gauge(self, p: Array) -> Array:
        """The homogeneous parameters: their length means nothing."""
        gauge = p.copy()
        gauge[self.motion.scale_row + 1 :] = 0
        return gauge

    def take(self, columns: NDArray[np.int_]) -> Criterion:
        """The same for some of the targets."""
        return self._replace(scene=self.scene.take(columns))


def criterion(
    scene: Scene, motion: Motion, prior: MotionPrior | None = None, loss: Loss | None = None
) -> Criterion:
    """The criterion, with tables when the motion and the scene allow them."""
    fast = motion.path is None and scene.shared
    return Criterion(scene, motion, prior, loss, tables_of(scene, motion) if fast else None)
