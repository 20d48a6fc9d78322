"""What the bearings of one target say: a status first, and numbers only as far as it allows.

`solve` is called anew with every bearing; nothing is carried over, so a late or corrected bearing
needs no rollback.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from scipy.special import ndtr

from estimation.arrays import Array
from estimation.bearings_only.estimate import Estimate, LineOfSight, State
from estimation.bearings_only.marginal import NORMAL, Roots

Status: TypeAlias = Literal["determined", "weak", "undetermined"]

DETERMINED, WEAK = 0.1, 0.5  # sd(1/R) R
COUNTS = 0.005  # weight from which a motion is mixed in
_HALVINGS = 40


class Interval(NamedTuple):
    """Where the range is with 95 % probability; `high_m` infinite: it is open."""

    low_m: float
    high_m: float

    def __contains__(self, range_m: object) -> bool:
        """Whether a range is inside."""
        return isinstance(range_m, float | int) and self.low_m <= range_m <= self.high_m


class VelocityFamily(NamedTuple):
    """The velocities that fit when the range is unknown: v = own + range * by_range.

    Attributes:
        own_mps: (2,) velocity of the own carrier at the last bearing.
        by_range: (2,) [1/s].
        covariance: (2, 2) of by_range.
    """

    own_mps: Array
    by_range: Array
    covariance: Array

    def velocity_mps(self, range_m: float) -> Array:
        """The velocity (2,) that goes with a range."""
        velocity: Array = self.own_mps + range_m * self.by_range
        return velocity


class Candidate(NamedTuple):
    """A motion that was tried: its posterior weight, and how well it fits at all.

    Attributes:
        motion: name.
        weight: probability among the motions tried.
        chi2, dof: of the bearings, degrees of freedom net of what they determine.
        p_value: of chi2; small: the target does not move like that.
    """

    motion: str
    weight: float
    chi2: float
    dof: float
    p_value: float


class Solution(NamedTuple):
    """The bearings-only solution of one target.

    Attributes:
        status: of the range, from sd(1/R) R by the bearings, without what the prior says of
            metres: determined < .1, weak < .5, undetermined.
        relative_sigma: that sd(1/R) R.
        interval: of the range at the last bearing, always there.
        line: bearing, bearing rate, range rate by range at the last bearing.
        velocities: what velocity goes with what range.
        candidates: motions by falling weight of their kind, then their own: the winner, the
            runner-up, ...
        alarm: no motion that was tried explains the bearings.
        used: bearings that counted.
        last_s: time of the last one.
        mixture: weight and estimate of each motion that counts.
    """

    status: Status
    relative_sigma: float
    interval: Interval
    line: LineOfSight | None
    velocities: VelocityFamily | None
    candidates: tuple[Candidate, ...]
    alarm: bool
    used: int
    last_s: float
    mixture: tuple[tuple[float, Estimate], ...]

    def __repr__(self) -> str:
        """In a line: the mixture holds arrays of every motion."""
        low_m, high_m = self.interval
        motion = self.winner.motion if self.winner else "no motion"
        return (
            f"Solution({self.status}, range {low_m:.0f} to {high_m:.0f} m, {motion}, "
            f"{self.used} bearings until {self.last_s:g} s{', alarm' if self.alarm else ''})"
        )

    @property
    def winner(self) -> Candidate | None:
        """The most probable motion of the most probable kind."""
        return self.candidates[0] if self.candidates else None

    @property
    def runner_up(self) -> Candidate | None:
        """The next, with the weight that says how near it is."""
        return self.candidates[1] if len(self.candidates) > 1 else None

    def at(self, t_s: float) -> State | None:
        """Place and velocity by the winner at a time; None unless the range is determined or weak.

        The covariance holds the other motions too, as they differ from the winner.
        """
        if self.status == "undetermined" or not self.mixture:
            return None
        with np.errstate(all="ignore"):
            states = [(weight, estimate.state(t_s)) for weight, estimate in self.mixture]
        best = states[0][1]
        mean = np.concatenate([best.position_m[0], best.velocity_mps[0]])
        total, covariance = 0.0, np.zeros((4, 4))
        for weight, state in states:
            apart = np.concatenate([state.position_m[0], state.velocity_mps[0]]) - mean
            spread = state.covariance[0] + np.outer(apart, apart)
            if np.isfinite(spread).all():
                total, covariance = total + weight, covariance + weight * spread
        return State(mean[:2], mean[2:], covariance / total) if total else None


def status_of(relative_sigma: float) -> Status:
    """The status that goes with sd(1/R) R."""
    if relative_sigma < DETERMINED:
        return "determined"
    return "weak" if relative_sigma < WEAK else "undetermined"


def mixture_interval(
    weights: Array, means: Array, sigmas: Array, marginals: Sequence[Roots] | None = None
) -> Interval:
    """95 % of a mixture in 1/R, as an interval of ranges.

    Args:
        weights, means, sigmas: (K,) of 1/R [1/m].
        marginals: (K) how each falls off about its mean; None: as Gaussians.
    """
    marginals = marginals or [NORMAL] * len(means)
    at = [m + s * r.sigmas for m, s, r in zip(means, sigmas, marginals, strict=True)]
    nodes = np.unique(np.concatenate(at))
    roots = np.stack([np.interp(nodes, x, r.root) for x, r in zip(at, marginals, strict=True)])
    low, high = (_quantile(weights, nodes, roots, level) for level in (0.025, 0.975))
    return Interval(1 / high if high > 0 else np.inf, 1 / low if low > 0 else np.inf)


def _quantile(weights: Array, nodes: Array, roots: Array, level: float) -> float:
    """Where the mixture of normal roots (K, N), straight between nodes (N,), has a level."""
    after = int(np.clip(np.searchsorted(weights @ ndtr(roots), level), 1, len(nodes) - 1))
    begin, change = roots[:, after - 1], roots[:, after] - roots[:, after - 1]
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        below = weights @ ndtr(begin + middle * change) < level
        low, high = (middle, high) if below else (low, middle)
    return float(nodes[after - 1] + middle * (nodes[after] - nodes[after - 1]))


def unknown(used: int, last_s: float) -> Solution:
    """The solution of a target of which the bearings say nothing."""
    nothing = Interval(0.0, np.inf)
    return Solution("undetermined", np.inf, nothing, None, None, (), False, used, last_s, ())
