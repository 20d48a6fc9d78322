"""Errors of tracks that served two frames: what a frame just found has in common with the others.

A frame is found from the tracks of a base, such as the own carrier's. Their plots have served the
frames that are followed by then, so that the errors of all of them hang together: of N carriers
found at once the mean is no surer than the base's own tracks, however many they are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estimation.arrays import Array, Indices, transposed
from estimation.frames import rotation_clockwise
from estimation.relative_frame.joint import LOGS, WIDTH, JointFrames
from estimation.relative_frame.logs import OwnAxesFrame
from estimation.relative_frame.range_errors import along

_MOST = 0.98
"""Of the variance of a new frame, in any direction, that the others may explain."""


class Tracks(NamedTuple):
    """M tracks of T targets at one instant, each target seen by the base and others.

    Attributes:
        carrier: (M,) whose, numbered as the frames; target: (M,) from 0.
        places_m: (M, 2) relative to the carrier, along its axes.
        covariance: (M, 2, 2).
    """

    carrier: Indices
    target: Indices
    places_m: Array
    covariance: Array


def shared(
    joint: JointFrames, tracks: Tracks, base: int, frame: OwnAxesFrame, gain: Array
) -> Array:
    """(7 N, 3) covariance of frames that are followed with one found from tracks of a base.

    Frames that do not change are P sum(H' W v) of all plots ever, v their errors; the tracks are
    the sum of the latest of these. So of the errors n of the base's tracks of a target there is
    P (sum_k H_k' W_k inv(W) - H_base') n in them, W the sum of the inverse covariances W_k.

    Args:
        frame: in the axes of the base; gain: (T, 3, 2) of each target, see `range_errors.gains`.
    """
    turn = rotation_clockwise(joint.mean[tracks.carrier, 2])
    weight = np.linalg.inv(turn @ tracks.covariance @ transposed(turn))
    seen = (turn @ tracks.places_m[..., None])[..., 0]
    by = np.zeros((len(seen), 2, len(LOGS)))
    by[:, 0, 0] = by[:, 1, 1] = 1.0
    by[:, 0, 2], by[:, 1, 2] = seen[:, 1], -seen[:, 0]
    by[:, :, 3:] = along(seen)
    total = np.zeros((len(gain), 2, 2))
    np.add.at(total, tracks.target, weight)
    total[np.trace(total, axis1=1, axis2=2) == 0] = np.eye(2)  # nobody's
    by_base = transposed(by) @ weight @ np.linalg.inv(total)[tracks.target]
    of_base = tracks.carrier == base
    by_base[of_base] -= transposed(by[of_base])
    pulled = by_base @ rotation_clockwise(joint.mean[base, 2]) @ transposed(gain)[tracks.target]
    pull = np.zeros((WIDTH * joint.carriers, 3))
    np.add.at(pull, WIDTH * tracks.carrier[:, None] + LOGS, pulled)
    together: Array = joint.covariance @ pull
    root = np.linalg.inv(np.linalg.cholesky(frame.covariance))
    explained = float(np.linalg.eigvalsh(root @ pull.T @ together @ root.T)[-1])
    return np.asarray(together * min(1.0, np.sqrt(_MOST / max(explained, _MOST))))
