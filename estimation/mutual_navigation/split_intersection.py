"""Split covariance intersection: fixes of unknown correlation, used without believing them twice.

A covariance is kept as two parts: one whose errors are known to be independent of everybody else's,
and one of which nothing is known. The second is blown up by 1/w on one side and 1/(1 - w) on the
other; whatever the correlation, the result is no smaller than the truth. Source: Julier & Uhlmann,
General decentralised data fusion with covariance intersection, 2001, section 12.4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from estimation.arrays import Array

_LEAST = 1e-3


class Fix(NamedTuple):
    """An estimate that says where its errors come from; nobody publishes less.

    Attributes:
        mean: (N,).
        independent: (N, N) covariance of errors nobody else shares.
        dependent: (N, N) covariance of errors of unknown correlation.
        sources: names of all whose data are in it.
    """

    mean: Array
    independent: Array
    dependent: Array
    sources: frozenset[str]

    @property
    def covariance(self) -> Array:
        """(N, N)."""
        return self.independent + self.dependent


class Message(NamedTuple):
    """A measurement that leans on somebody else's fix.

    Attributes:
        innovation: (m,).
        by_state: (m, N) by the receiver's state.
        independent: (m, m) noise of its own.
        dependent: (m, m) what the sender's fix adds.
        sources: of the sender's fix, the sender included.
    """

    innovation: Array
    by_state: Array
    independent: Array
    dependent: Array
    sources: frozenset[str]


def predicted(fix: Fix, transition: Array, noise: Array) -> Fix:
    """A fix after a transition; new noise is nobody else's."""
    return fix._replace(
        mean=transition @ fix.mean,
        independent=transition @ fix.independent @ transition.T + noise,
        dependent=transition @ fix.dependent @ transition.T,
    )


def fused(fix: Fix, message: Message) -> tuple[Fix, Array]:
    """The fix with a message, and the gain (N, m) it was given.

    The share w is the one that makes the volume of the result least.
    """
    share = _best_share(fix, message)
    before, gain = _gain(fix, message, share)
    kept = np.eye(len(fix.mean)) - gain @ message.by_state
    covariance = _symmetric(kept @ before)
    independent = _symmetric(kept @ fix.independent @ kept.T + gain @ message.independent @ gain.T)
    after = Fix(
        fix.mean + gain @ message.innovation,
        independent,
        covariance - independent,
        fix.sources | message.sources,
    )
    return after, gain


def _best_share(fix: Fix, message: Message) -> float:
    """Volume of the result as a function of w has one minimum."""

    def volume(share: float) -> float:
        before, gain = _gain(fix, message, share)
        logarithm = np.linalg.slogdet(np.eye(len(gain)) - gain @ message.by_state)[1]
        return float(np.linalg.slogdet(before)[1] + logarithm)

    found = minimize_scalar(volume, bounds=(_LEAST, 1 - _LEAST), method="bounded")
    at_end = volume(1 - 1e-9)
    return float(found.x) if found.fun < at_end else 1 - 1e-9


def _gain(fix: Fix, message: Message, share: float) -> tuple[Array, Array]:
    """The fix's covariance with its dependent part blown up, and the gain then."""
    before = fix.dependent / share + fix.independent
    noise = message.dependent / (1 - share) + message.independent
    seen = message.by_state @ before
    gain = np.linalg.solve(seen @ message.by_state.T + noise, seen).T
    return before, gain.astype(float)


def _symmetric(matrix: Array) -> Array:
    return (matrix + matrix.T) / 2
