"""From bearings to solutions: fit the family, look for more turns on alarm, judge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincc

from estimation.arrays import Array
from estimation.bearings_only.estimate import Estimate, LineOfSight
from estimation.bearings_only.family import Hypothesis, hypotheses, three_legs
from estimation.bearings_only.measurements import Bearings, Scene, scene_of
from estimation.bearings_only.motions import FAMILY, FINITE_TURN, Motion
from estimation.bearings_only.normal_equations import Loss
from estimation.bearings_only.prior import MotionPrior
from estimation.bearings_only.solution import (
    COUNTS,
    Candidate,
    Interval,
    Solution,
    VelocityFamily,
    mixture_interval,
    status_of,
    unknown,
)

ALARM = 0.01  # p value of the winner below which its motion is not believed
_BLOCK = 32


def solve(
    given: Bearings,
    prior: MotionPrior | None = None,
    motions: Sequence[Motion] = FAMILY,
    loss: Loss | None = None,
) -> Solution:
    """The solution of one target of unknown motion.

    Args:
        given: its bearings, without leading axes. Any number, any geometry: what they do not
            determine is said by the status.
        prior: what is known of such targets; default: ships.
        motions: what is tried. Three legs are tried too when none of them fits.
        loss: None for Gaussian errors; `student_t()` where some bearings are wrong.

    Raises:
        ValueError: the bearings are of several targets: see `solve_many`.
    """
    if given.batch not in ((), (1,)):
        raise ValueError(f"need the bearings of one target, got {given.batch}")
    return solve_many(given, prior, motions, loss)[0]


def solve_many(
    given: Bearings,
    prior: MotionPrior | None = None,
    motions: Sequence[Motion] = FAMILY,
    loss: Loss | None = None,
) -> list[Solution]:
    """The same for every target of a batch, flattened, at a fraction of the time."""
    scene, prior = scene_of(given), prior or MotionPrior()
    with np.errstate(all="ignore"):
        fits = _fits(scene, prior, motions, loss)
        alarmed = [i for i, tried in enumerate(fits) if _best(tried).p_value < ALARM]
        for start in range(0, len(alarmed), _BLOCK):
            some = alarmed[start : start + _BLOCK]
            more = three_legs(
                scene.take(np.array(some)), prior, _turns([fits[i] for i in some]), loss
            )
            for column, i in enumerate(some):
                fits[i].append(_Fit(more, column))
        return [_judged(tried, scene, i) for i, tried in enumerate(fits)]


class _Fit(NamedTuple):
    """One motion of one target: a column of a hypothesis."""

    hypothesis: Hypothesis
    column: int

    @property
    def motion(self) -> Motion:
        return self.hypothesis.estimate.motion

    @property
    def log_evidence(self) -> float:
        return float(self.hypothesis.log_evidence[self.column])

    @property
    def p_value(self) -> float:
        chi2 = np.nan_to_num(self.hypothesis.estimate.chi2[self.column], nan=np.inf)
        return float(np.nan_to_num(gammaincc(self.hypothesis.dof[self.column] / 2, chi2 / 2)))

    def candidate(self, weight: float) -> Candidate:
        """As it is reported."""
        chi2, dof = self.hypothesis.estimate.chi2[self.column], self.hypothesis.dof[self.column]
        return Candidate(self.motion.name, weight, float(chi2), float(dof), self.p_value)

    def estimate(self) -> Estimate:
        """Of this target alone."""
        return self.hypothesis.estimate.take(np.array([self.column]))


def _fits(
    scene: Scene, prior: MotionPrior, motions: Sequence[Motion], loss: Loss | None
) -> list[list[_Fit]]:
    """Of every target, all motions."""
    fits: list[list[_Fit]] = []
    for start in range(0, scene.targets, _BLOCK):
        columns = np.arange(start, min(start + _BLOCK, scene.targets))
        tried = hypotheses(scene.take(columns), prior, motions, loss)
        fits += [[_Fit(h, column) for h in tried] for column in range(len(columns))]
    return fits


def _best(tried: Sequence[_Fit]) -> _Fit:
    return max(tried, key=lambda fit: fit.log_evidence)


def _turns(fits: Sequence[Sequence[_Fit]]) -> Array | None:
    """The finite turns (3, B) that were found, when one was tried."""
    found = [
        fit.hypothesis.estimate.p[FINITE_TURN.scale_row + 1 :, fit.column]
        for tried in fits
        for fit in tried
        if fit.motion.name == FINITE_TURN.name
    ]
    return np.stack(found, axis=1) if len(found) == len(fits) else None


def _judged(tried: list[_Fit], scene: Scene, column: int) -> Solution:
    """The solution of one target from all its fits."""
    last_s = float(_of(scene.middle_s, column) + _of(scene.half_span_s * scene.time[-1], column))
    used = int(scene.seen[column])
    tried = sorted(tried, key=lambda fit: -fit.log_evidence)
    evidence = np.array([fit.log_evidence for fit in tried])
    if used == 0 or not np.isfinite(evidence[:1]).all():
        return unknown(used, last_s)
    weights = np.exp(evidence - evidence[0])
    weights /= weights.sum()
    heavy = max(int((weights >= COUNTS).sum()), 1)
    shares = weights[:heavy] / weights[:heavy].sum()
    estimates = [fit.estimate() for fit in tried[:heavy]]
    line = estimates[0].line_of_sight().one()
    relative, interval = _spread(tried[:heavy], shares)
    return Solution(
        status_of(relative),
        relative,
        interval,
        line,
        velocity_family(estimates[0], line),
        tuple(fit.candidate(float(w)) for fit, w in zip(tried, weights, strict=True)),
        tried[0].p_value < ALARM,
        used,
        last_s,
        tuple(zip(shares.tolist(), estimates, strict=True)),
    )


def _spread(tried: Sequence[_Fit], shares: Array) -> tuple[float, Interval]:
    """sd(1/R) R of the winner, and the interval of all; undetermined: both without the prior."""
    means = np.array([fit.hypothesis.aided.value[fit.column] for fit in tried])
    sigmas = np.array([fit.hypothesis.aided.sigma[fit.column] for fit in tried])
    alone = np.array([fit.hypothesis.alone.sigma[fit.column] for fit in tried])
    spread = np.sqrt(shares @ (sigmas**2 + (means - means[0]) ** 2))
    relative = float(np.nan_to_num(max(spread, alone[0]) / means[0], nan=np.inf))
    if status_of(relative) == "undetermined":
        sigmas = alone
    return relative, mixture_interval(shares, means, np.nan_to_num(sigmas, nan=1.0, posinf=1.0))


def velocity_family(estimate: Estimate, line: LineOfSight) -> VelocityFamily:
    """Of the first target, by its line of sight."""
    u = np.array([np.sin(line.bearing_rad), np.cos(line.bearing_rad)])
    right = np.array([u[1], -u[0]])
    rate, closing = line.bearing_rate_rad_s, line.range_rate_over_range
    turn = closing * right - rate * u  # how by_range turns with the bearing
    rows = np.stack([turn, right, u], axis=1)
    scene = estimate.scene
    own = estimate.own_velocity()[0] * (scene.length_m / scene.half_span_s)[0]
    return VelocityFamily(
        np.array([own.real, own.imag]), closing * u + rate * right, rows @ line.covariance @ rows.T
    )


def _of(values: Array, column: int) -> float:
    return float(values[column if len(values) > 1 else 0])
