"""From bearings to solutions: fit the family, look for more turns on alarm, judge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincc

from estimation.arrays import Array
from estimation.bearings_only.doubt import FrameDoubt
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
_DOUBTFUL = 0.1  # and below which more turns are tried: a turn left out may well pass for chance
_BLOCK = 64


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
    doubt: FrameDoubt | None = None,
) -> list[Solution]:
    """The same for every target of a batch, flattened, at a fraction of the time.

    Args:
        given, prior, motions, loss: as of `solve`, with leading axes.
        doubt: where the bearings are of several carriers: how well their frames are known.
    """
    scene, prior = scene_of(given), prior or MotionPrior()
    with np.errstate(all="ignore"):
        fits = _fits(scene, prior, motions, loss, doubt)
        alarmed = [i for i, tried in enumerate(fits) if _best(tried).p_value < _DOUBTFUL]
        for start in range(0, len(alarmed), _BLOCK):
            some = alarmed[start : start + _BLOCK]
            columns = np.array(some)
            more = three_legs(
                scene.take(columns),
                prior,
                _turns([fits[i] for i in some]),
                loss,
                doubt.take(columns) if doubt else None,
            )
            for h in more:
                for column, target in enumerate(h.columns):
                    fits[some[target]].append(_Fit(h, column))
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
    scene: Scene,
    prior: MotionPrior,
    motions: Sequence[Motion],
    loss: Loss | None,
    doubt: FrameDoubt | None,
) -> list[list[_Fit]]:
    """Of every target, all motions."""
    fits: list[list[_Fit]] = []
    for start in range(0, scene.targets, _BLOCK):
        columns = np.arange(start, min(start + _BLOCK, scene.targets))
        part = doubt.take(columns) if doubt else None
        tried = hypotheses(scene.take(columns), prior, motions, loss, part)
        each: list[list[_Fit]] = [[] for _ in columns]
        for h in tried:
            for column, target in enumerate(h.columns):
                each[target].append(_Fit(h, column))
        fits += each
    return fits


def _best(tried: Sequence[_Fit]) -> _Fit:
    return max(tried, key=lambda fit: fit.log_evidence)


def _turns(fits: Sequence[Sequence[_Fit]]) -> Array | None:
    """The finite turns (3, B) that were found, when one was tried."""
    turned = [[fit for fit in tried if fit.motion.name == FINITE_TURN.name][:1] for tried in fits]
    found = [
        fit.hypothesis.estimate.p[FINITE_TURN.scale_row + 1 :, fit.column]
        for one in turned
        for fit in one
    ]
    return np.stack(found, axis=1) if len(found) == len(fits) else None


def _judged(tried: list[_Fit], scene: Scene, column: int) -> Solution:
    """The solution of one target from all its fits."""
    last_s = float(_of(scene.middle_s, column) + _of(scene.half_span_s * scene.time[-1], column))
    used = int(scene.seen[column])
    if used == 0 or not np.isfinite(_best(tried).log_evidence):
        return unknown(used, last_s)
    tried, weights, candidates = _ranked(tried)
    counts = weights >= COUNTS
    counts[0] = True
    heavy, shares = (
        [tried[i] for i in np.flatnonzero(counts)],
        weights[counts] / weights[counts].sum(),
    )
    estimates = [fit.estimate() for fit in heavy]
    line = estimates[0].line_of_sight().one()
    relative, interval = _spread(heavy, shares)
    return Solution(
        status_of(relative),
        relative,
        interval,
        line,
        velocity_family(estimates[0], line),
        candidates,
        tried[0].p_value < ALARM,
        used,
        last_s,
        tuple(zip(shares.tolist(), estimates, strict=True)),
    )


def _ranked(tried: list[_Fit]) -> tuple[list[_Fit], Array, tuple[Candidate, ...]]:
    """Fits by falling weight of their kind, their motion, their own; weights; the motions."""
    evidence = np.array([fit.log_evidence for fit in tried])
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    of_kind, total = dict[str, float](), dict[str, float]()
    for fit, weight in zip(tried, weights.tolist(), strict=True):
        name, kind = fit.motion.name, fit.motion.kind
        of_kind[kind] = of_kind.get(kind, 0.0) + weight
        total[name] = total.get(name, 0.0) + weight

    def rank(i: int) -> tuple[float, str, float, str, float]:
        name, kind = tried[i].motion.name, tried[i].motion.kind
        return -of_kind[kind], kind, -total[name], name, -weights[i]

    order = sorted(range(len(tried)), key=rank)
    best = {tried[i].motion.name: tried[i] for i in reversed(order)}
    names = dict.fromkeys(tried[i].motion.name for i in order)
    candidates = tuple(best[name].candidate(total[name]) for name in names)
    return [tried[i] for i in order], weights[order], candidates


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
