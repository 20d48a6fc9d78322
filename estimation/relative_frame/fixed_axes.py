"""A frame known in own axes, said in axes fixed to true north.

(q, D) are three numbers, theta = (x, y, c1, c2) four: the missing one is the own carrier's north,
of which targets say nothing. Given q and D it is what navigation's prior makes likeliest, and as
uncertain as the prior leaves it.
"""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.relative_frame.logs import OwnAxesFrame, RelativeFrame, RelativeFramePrior

_STEPS = 6
_LEAST = 1e-12  # m^2, rad^2: a prior without doubt keeps an inverse


def in_fixed_axes(frame: OwnAxesFrame, prior: RelativeFramePrior) -> RelativeFrame:
    """Theta of one frame (no batch), its covariance to first order; chi2, dof and pairs are 0.

    Where c1 is so uncertain that q may lie anywhere on a circle, the covariance says less than
    there is: own axes are what to use.
    """
    weight = np.linalg.inv(prior.offset_covariance + _LEAST * np.eye(2))
    w1 = 1 / (float(np.square(prior.sigma_c1_rad)) + _LEAST)
    w2 = 1 / (float(np.square(prior.sigma_c2_rad)) + _LEAST)
    d = float(frame.D_rad)
    c1 = _first_c1(frame, prior, w1, w2)
    for _ in range(_STEPS):
        place, by_c1 = _turned(frame.q_m, c1)
        apart = place - prior.offset_m
        slope = by_c1 @ weight @ apart + w1 * c1 + w2 * float(wrap_pi(c1 + d))
        curvature = float(by_c1 @ weight @ by_c1 + w1 + w2)
        c1 -= float(slope) / curvature
    place, by_c1 = _turned(frame.q_m, c1)
    own_from_fixed = rotation_clockwise(c1)
    c1_by_frame = -np.append(by_c1 @ weight @ own_from_fixed, w2) / curvature
    along = np.array([*by_c1, 1.0, 1.0])
    by_frame = np.zeros((4, 3))
    by_frame[:2, :2], by_frame[3, 2] = own_from_fixed, 1.0
    by_frame += np.outer(along, c1_by_frame)
    return RelativeFrame(
        offset_correction_m=place - prior.offset_m,
        c1_rad=np.array(float(wrap_pi(c1))),
        c2_rad=np.array(float(wrap_pi(c1 + d))),
        covariance=by_frame @ frame.covariance @ by_frame.T + np.outer(along, along) / curvature,
        chi2=np.array(0.0),
        dof=0,
        pairs=0,
    )


def _first_c1(frame: OwnAxesFrame, prior: RelativeFramePrior, w1: float, w2: float) -> float:
    """The mean direction of what the offset, c1 and c2 want of it, by their weights."""
    spread = float(np.trace(prior.offset_covariance)) / 2 + _LEAST
    offset = complex(prior.offset_m[1], prior.offset_m[0])
    q = complex(frame.q_m[1], frame.q_m[0])
    wanted = offset * q.conjugate() / spread + w1 + w2 * np.exp(-1j * float(frame.D_rad))
    return float(np.angle(wanted))


def _turned(q_m: Array, c1_rad: float) -> tuple[Array, Array]:
    """The place q in fixed axes, and its derivative by c1."""
    place = rotation_clockwise(c1_rad) @ q_m
    return place, np.array([place[1], -place[0]])
