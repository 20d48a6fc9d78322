"""The pairwise methods under one signature: choose one by passing it.

>>> def frames(pairs, prior, method: Method = adjustment):
...     return [method(own, other, prior).own_axes for own, other in pairs]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from estimation.relative_frame.adjustment import Registration, adjustment
from estimation.relative_frame.closed_form import closed_form
from estimation.relative_frame.logs import PolarLogs, RelativeFramePrior, in_own_axes

__all__ = ["Method", "adjustment", "linearised_once"]

Method: TypeAlias = Callable[[PolarLogs, PolarLogs, RelativeFramePrior], Registration]


def linearised_once(own: PolarLogs, other: PolarLogs, prior: RelativeFramePrior) -> Registration:
    """The paper's closed form as a method: the named baseline of `adjustment`.

    Raises:
        ValueError: own and other differ in length.
    """
    fixed = closed_form(own, other, prior)
    always = np.ones(np.shape(fixed.chi2), dtype=bool)
    return Registration(in_own_axes(fixed, prior), fixed, always)
