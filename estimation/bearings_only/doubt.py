"""Bearings of several carriers whose frames are known, but not exactly.

A frame that is a little off moves all bearings of its carrier alike, so more of them do not help
against it. They are solved as if the frames were exact; then what the frames leave unsure is taken
from the information, the frames integrated out as by `jointly`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array
from estimation.bearings_only.linear_algebra import inverted
from estimation.bearings_only.measurements import Scene
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.normal_equations import directions, residuals


class FrameDoubt(NamedTuple):
    """What is unsure of the frames of K carriers, beside the bearings of B targets.

    Attributes:
        carrier: (B, N) who took each bearing: 1 to K; 0 = one whose frame is no question.
        pivot_m: (K, 2) where each carrier is: about it its frame is turned.
        covariance: (K, 3, 3) of its place, east and north, and its turn, clockwise [m, m, rad].
    """

    carrier: NDArray[np.int_]
    pivot_m: Array
    covariance: Array

    def take(self, columns: NDArray[np.int_]) -> FrameDoubt:
        """The same for some of the targets."""
        return self._replace(carrier=self.carrier[columns])

    @property
    def information(self) -> Array:
        """(3 K, 3 K) of all frames, each by itself."""
        whole = np.zeros((3 * len(self.covariance),) * 2)
        for k, covariance in enumerate(self.covariance):
            whole[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = np.linalg.inv(covariance)
        return whole


def lessened(
    information: Array, scene: Scene, motion: Motion, p: Array, doubt: FrameDoubt
) -> Array:
    """Information (M, M, B) of the targets alone, from that with the frames as they are taken.

    Args:
        information: (M, M, B) at p (M, B).
    """
    h = p.copy()
    h[motion.scale_row + 1 :] = 0
    trace = np.einsum("iib->b", information) + 1e-290
    spread = inverted(information + trace * h[:, None] * h[None])
    rows = residuals(scene, motion, p)[1]
    coupling = np.einsum("mnb,gnb->mgb", rows, _by_frames(scene, motion, p, doubt))
    told = np.einsum("mgb,mnb,nhb->bgh", coupling, spread, coupling)
    inner = np.linalg.pinv(doubt.information + np.nan_to_num(told), hermitian=True)
    lost: Array = np.einsum("mgb,bgh,nhb->mnb", coupling, inner, coupling)
    return information - lost


def _by_frames(scene: Scene, motion: Motion, p: Array, doubt: FrameDoubt) -> Array:
    """Derivatives (3 K, N, B) of the standardised residuals by east, north and turn of each."""
    d, _ = directions(scene, motion, p)
    across = -p[motion.scale_row] * scene.weight / (d + 1e-300)
    rows = []
    for k, (east, north) in enumerate(doubt.pivot_m.tolist()):
        mine = k + 1 == doubt.carrier.T
        arm = scene.observer - (east + 1j * north - scene.centre_m) / scene.length_m
        turned = scene.weight - (1j * arm * across).imag
        rows += [
            np.where(mine, across.imag / scene.length_m, 0.0),
            np.where(mine, across.real / scene.length_m, 0.0),
            np.where(mine, turned, 0.0),
        ]
    return np.stack(rows)
