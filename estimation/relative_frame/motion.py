"""The error of a frame as the motion that leads from the estimate to the truth.

Two targets close together leave the orientation uncertain by tens of degrees, and then q lies
along an arc about them: (q, D) is bent like a banana and no covariance of it can be honest. The
motion (a turn about some point of the plane) is Gaussian there: in its own coordinates, those of
the exponential map, every turn about the same point lies on one straight line. For small errors
both are the same.

Source: Barfoot & Furgale, "Associating uncertainty with three-dimensional poses for use in
estimation problems", IEEE T-RO 30, 2014; Long et al., "The banana distribution is Gaussian", 2012.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, ArrayLike, transposed
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.relative_frame.logs import OwnAxesFrame


class Motion(NamedTuple):
    """A motion of own axes (..., 3): shift [m, m] and turn [rad], and its covariance."""

    vector: Array
    covariance: Array


def motion_to(frame: OwnAxesFrame, q_m: Array, D_rad: ArrayLike) -> Motion:  # noqa: N803
    """The motion from an estimated frame to the true one, and the covariance that it should have.

    Args:
        frame: the estimate (...).
        q_m: (..., 2) true position of the other carrier in own axes.
        D_rad: (...) true turn.
    """
    turn = wrap_pi(np.asarray(D_rad) - frame.D_rad)
    shift = q_m - (rotation_clockwise(turn) @ frame.q_m[..., None])[..., 0]
    # exp([shift, turn]) moves by V shift, V = integral of the rotation from 0 to turn
    half = turn / 2
    ratio = half / np.where(half == 0, 1, np.tan(half)) + (half == 0)
    inverse = np.stack([ratio, -half, half, ratio], axis=-1).reshape(*np.shape(turn), 2, 2)
    straight = (inverse @ shift[..., None])[..., 0]
    vector = np.concatenate([straight, turn[..., None]], axis=-1)

    by_frame = np.zeros((*np.shape(turn), 3, 3))
    by_frame[..., range(3), range(3)] = 1
    by_frame[..., 0, 2], by_frame[..., 1, 2] = -frame.q_m[..., 1], frame.q_m[..., 0]
    return Motion(vector, by_frame @ frame.covariance @ transposed(by_frame))
