"""The Cramer-Rao bound: what no unbiased estimator can beat with these bearings."""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array, ArrayLike
from estimation.bearings_only.criterion import criterion
from estimation.bearings_only.estimate import Estimate
from estimation.bearings_only.measurements import Bearings, Scene, scene_of
from estimation.bearings_only.motions import Motion


def parameters(
    scene: Scene, motion: Motion, coefficients: ArrayLike, shape: ArrayLike = ()
) -> Array:
    """Homogeneous parameters (M, B) of a known motion.

    Args:
        coefficients: (K, B) or (K,) complex, east + i north: place [m] and its derivatives by
            seconds, in the middle of the observation, along `motion.path`.
        shape: (P, B) or (P,) of the motion, in half spans.
    """
    c = np.asarray(coefficients, dtype=complex).reshape(motion.degree + 1, -1)
    orders = np.arange(motion.degree + 1)[:, None]
    c = np.concatenate([c[:1] - scene.centre_m, c[1:] + 0 * scene.centre_m])
    c = c * scene.half_span_s**orders / scene.length_m
    forms = np.array(shape, dtype=float, ndmin=1)
    forms = forms[:, None] if forms.ndim == 1 else forms
    columns = max(scene.targets, c.shape[1], forms.shape[1])
    rows = [c.real, c.imag, np.ones((1, 1)), forms]
    return np.concatenate([np.broadcast_to(row, (len(row), columns)) for row in rows])


def cramer_rao(
    given: Bearings, motion: Motion, coefficients: ArrayLike, shape: ArrayLike = ()
) -> Estimate:
    """The truth as an estimate: its covariances are the bounds.

    `relative_range` of it is the bound of the range at the last bearing. The bearings themselves
    are not used: only where, when, and how well they are taken.

    Args:
        given: times, places and sigmas.
        motion: the true motion, whose parameters are unknown.
        coefficients, shape: as in `parameters`.
    """
    scene = scene_of(given)
    p = parameters(scene, motion, coefficients, shape)
    at_truth = criterion(scene, motion)
    p = at_truth.admissible(p)
    information = at_truth.of_bearings(p).matrix
    none = np.zeros(p.shape[1])
    return Estimate(scene, motion, p, information, none, none == 0)
