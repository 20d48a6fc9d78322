"""From bearings to solutions: fit the family, look for more turns on alarm, judge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincc

from estimation.arrays import Array
from estimation.bearings_only.doubt import FrameDoubt
from estimation.bearings_only.estimate import Estimate, LineOfSight
from estimation.bearings_only.family import Hypothesis, hypotheses, three_legs
from estimation.bearings_only.marginal import NORMAL, Roots, roots
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
_DOUBTFUL = 0.2  # and below which more turns are tried: a turn left out may well pass for chance
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
        loss: None for Gaussian errors; `gross_errors()` where some bearings are wrong.

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
        return _judged(scene, fits)


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


class _Weighed(NamedTuple):
    """The fits of a target that count, by their shares; and all motions that were tried."""

    fits: list[_Fit]
    shares: Array
    candidates: tuple[Candidate, ...]


def _judged(scene: Scene, fits: Sequence[list[_Fit]]) -> list[Solution]:
    """The solutions of all targets from all their fits."""
    weighed = [_weighed(tried) if scene.seen[i] else None for i, tried in enumerate(fits)]
    marginals = _marginals([fit for one in weighed if one for fit in one.fits])
    return [
        unknown(int(scene.seen[i]), _last_s(scene, i))
        if one is None
        else _solution(one, [next(marginals) for _ in one.fits], scene, i)
        for i, one in enumerate(weighed)
    ]


def _weighed(tried: list[_Fit]) -> _Weighed | None:
    """What counts of a target; None where nothing came to an end."""
    if not np.isfinite(_best(tried).log_evidence):
        return None
    tried, weights, candidates = _ranked(tried)
    counts = weights >= COUNTS
    counts[0] = True
    shares = weights[counts] / weights[counts].sum()
    return _Weighed([tried[i] for i in np.flatnonzero(counts)], shares, candidates)


def _marginals(fits: Sequence[_Fit]) -> Iterator[Roots]:
    """Of each fit, those of one search asked together."""
    together: dict[int, list[_Fit]] = {}
    for fit in fits:
        together.setdefault(id(fit.hypothesis.searched), []).append(fit)
    found = {key: iter(_asked(some)) for key, some in together.items()}
    return (next(found[id(fit.hypothesis.searched)]) for fit in fits)


def _asked(fits: Sequence[_Fit]) -> list[Roots]:
    """Of fits of one search."""
    rank = np.array([fit.hypothesis.rank for fit in fits])
    columns = np.array([fit.hypothesis.columns[fit.column] for fit in fits])
    sigmas, root = roots(fits[0].hypothesis.searched, rank, columns)
    return [Roots(sigmas, one) for one in root.T]


def _solution(one: _Weighed, marginals: Sequence[Roots], scene: Scene, column: int) -> Solution:
    """The solution of one target from the fits that count."""
    estimates = [fit.estimate() for fit in one.fits]
    line = estimates[0].line_of_sight().one()
    relative, interval = _spread(one, marginals)
    return Solution(
        status_of(relative),
        relative,
        interval,
        line,
        velocity_family(estimates[0], line),
        one.candidates,
        one.fits[0].p_value < ALARM,
        int(scene.seen[column]),
        _last_s(scene, column),
        tuple(zip(one.shares.tolist(), estimates, strict=True)),
    )


def _last_s(scene: Scene, column: int) -> float:
    """When the last bearing of a target was taken."""
    return float(_of(scene.middle_s, column) + _of(scene.half_span_s * scene.time[-1], column))


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


def _spread(one: _Weighed, marginals: Sequence[Roots]) -> tuple[float, Interval]:
    """sd(1/R) R of the winner, and the interval of all; undetermined: both without the prior."""
    means = np.array([fit.hypothesis.aided.value[fit.column] for fit in one.fits])
    sigmas = np.array([fit.hypothesis.aided.sigma[fit.column] for fit in one.fits])
    alone = np.array([fit.hypothesis.alone.sigma[fit.column] for fit in one.fits])
    spread = np.sqrt(one.shares @ (sigmas**2 + (means - means[0]) ** 2))
    relative = float(np.nan_to_num(max(spread, alone[0]) / means[0], nan=np.inf))
    if status_of(relative) == "undetermined":
        sigmas, marginals = alone, [NORMAL] * len(means)
    sigmas = np.nan_to_num(sigmas, nan=1.0, posinf=1.0)
    return relative, mixture_interval(one.shares, means, sigmas, marginals)


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
