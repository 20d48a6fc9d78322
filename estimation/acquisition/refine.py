"""The frame of a mode when some of its pairs are in doubt: every pair by its probability.

Where two logs vie for a third, the likelier takes it in the assignment and pulls the frame towards
itself. Weighing every pair by its probability, and these by the frame, in turn, is the EM method:
it ends at the maximum of the likelihood summed over assignments. What the doubt costs is taken off
the information (Louis), so that the covariance stays honest.
"""

from __future__ import annotations

import numpy as np

from estimation.acquisition.innovation import (
    Frames,
    fitted,
    linearised,
    with_covariance_along_own,
)
from estimation.acquisition.problem import Problem, Side
from estimation.arrays import Array

_NEGLIGIBLE = 0.01  # probability of a pair below which it pulls at nothing


def weighed_fit(given: Problem, prior: Frames, start: Frames, probability: Array) -> Frames:
    """The frame (B = 1) that fits every pair as far as it is probable (N1, N2)."""
    i, j = np.nonzero(probability > _NEGLIGIBLE)
    share = probability[i, j]
    own, other = given.own.take(i), given.other.take(j)
    found = fitted(prior, start.t[0], _diluted(own, share), _diluted(other, share), steps=2)

    w, h = linearised(found.t[0], own, other)
    s = own.covariance + with_covariance_along_own(other, float(found.t[0, 2])).covariance
    score = (np.swapaxes(np.linalg.solve(s, h), -1, -2) @ w[..., None])[..., 0]
    mean = np.zeros((given.own.count, 3))
    np.add.at(mean, i, share[:, None] * score)
    doubt = (share[:, None] * score).T @ score - mean.T @ mean
    return Frames(found.t, _less(found.covariance, doubt))


def _diluted(side: Side, share: Array) -> Side:
    """Logs that count for a share each."""
    return Side(side.state, side.covariance / share[:, None, None], side.moving)


def _less(covariance: Array, doubt: Array) -> Array:
    """Covariance (1, 3, 3) of an information less by `doubt`, a tenth of it left at the least."""
    root = np.linalg.cholesky(covariance[0])
    values, axes = np.linalg.eigh(root.T @ doubt @ root)
    grown = root @ axes / np.sqrt(np.maximum(1 - values, 0.1))
    less: Array = (grown @ grown.T)[None]
    return less
