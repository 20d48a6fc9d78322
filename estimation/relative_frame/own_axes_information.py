"""What pairs say of a frame in own axes, in a form that adds up over streams and machines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimation.arrays import Array
from estimation.frames import wrap_pi
from estimation.relative_frame.logs import OwnAxesFrame
from estimation.relative_frame.matrices import inverse, times


@dataclass(frozen=True, eq=False, slots=True)
class OwnAxesInformation:
    """A quadratic in x = (q, D) - point: chi2 - 2 vector' x + x' matrix x.

    Attributes:
        point: (..., 3) where the conditions were linearised.
        matrix: (..., 3, 3) sum of H' S^-1 H.
        vector: (..., 3) minus the sum of H' S^-1 w.
        chi2: (...) of the pairs at the point.
        pairs: how many.
    """

    point: Array
    matrix: Array
    vector: Array
    chi2: Array
    pairs: int

    def about(self, point: Array) -> OwnAxesInformation:
        """The same quadratic about another point (..., 3)."""
        shift = point - self.point
        shift[..., 2] = wrap_pi(shift[..., 2])
        pulled = times(self.matrix, shift)
        chi2 = self.chi2 - np.sum(shift * (2 * self.vector - pulled), axis=-1)
        there = np.asarray(point, dtype=float)
        return OwnAxesInformation(there, self.matrix, self.vector - pulled, chi2, self.pairs)

    def __add__(self, more: OwnAxesInformation) -> OwnAxesInformation:
        there = more.about(self.point)
        return OwnAxesInformation(
            self.point,
            self.matrix + there.matrix,
            self.vector + there.vector,
            self.chi2 + there.chi2,
            self.pairs + more.pairs,
        )

    def with_prior(self, frame: OwnAxesFrame) -> OwnAxesFrame:
        """The frame that this information and a prior (non-singular covariance) leave."""
        at_prior = self.about(np.concatenate([frame.q_m, np.asarray(frame.D_rad)[..., None]], -1))
        covariance = inverse(inverse(frame.covariance) + at_prior.matrix)
        moved = at_prior.point + times(covariance, at_prior.vector)
        return OwnAxesFrame(moved[..., :2], wrap_pi(moved[..., 2]), covariance)
