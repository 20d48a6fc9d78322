"""From bearings to solutions: fit the family, look for more turns on alarm, judge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from estimation.arrays import Array
from estimation.bearings_only.estimate import Estimate
from estimation.bearings_only.family import Hypothesis, hypotheses, three_legs
from estimation.bearings_only.measurements import Bearings, Scene, scene_of
from estimation.bearings_only.motions import FAMILY, Motion
from estimation.bearings_only.normal_equations import Loss
from estimation.bearings_only.prior import MotionPrior
from estimation.bearings_only.solution import (
    Candidate,
    Interval,
    Solution,
    VelocityFamily,
    counted,
    mixture_interval,
    status_of,
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
    found: list[Solution] = []
    with np.errstate(all="ignore"):
        for start in range(0, scene.targets, _BLOCK):
            columns = np.arange(start, min(start + _BLOCK, scene.targets))
            found += _solved(scene.take(columns), prior, motions, loss)
    return found


def _solved(
    scene: Scene, prior: MotionPrior, motions: Sequence[Motion], loss: Loss | None
) -> list[Solution]:
    tried = hypotheses(scene, prior, motions, loss)
    best = np.argmax([h.log_evidence for h in tried], axis=0)
    fits = np.take_along_axis(_p_values(tried), best[None], axis=0)[0]
    alarmed = np.flatnonzero(fits < ALARM)
    more = three_legs(scene, prior, tried, loss, alarmed) if alarmed.size else None
    found = [_judged(tried, scene, column) for column in range(scene.targets)]
    for i, column in enumerate(alarmed):
        assert more is not None
        both = [*(_column(h, column) for h in tried), _column(more, i)]
        found[column] = _judged(both, scene.take(np.array([column])), 0)
    return found


def _p_values(tried: Sequence[Hypothesis]) -> Array:
    """(models, B): of the chi-squared of the bearings."""
    chi2, dof = np.array([h.estimate.chi2 for h in tried]), np.array([h.dof for h in tried])
    found: Array = gammaincc(dof / 2, np.nan_to_num(chi2, nan=np.inf) / 2)
    return found


def _column(hypothesis: Hypothesis, column: int) -> Hypothesis:
    one: NDArray[np.int_] = np.array([column])
    return Hypothesis(hypothesis.estimate.take(one), *(part[..., one] for part in hypothesis[1:]))


def _judged(tried: Sequence[Hypothesis], scene: Scene, column: int) -> Solution:
    """The solution of one column of the hypotheses."""
    last_s = float(_of(scene.middle_s, column) + _of(scene.half_span_s * scene.time[-1], column))
    used = int(scene.seen[column])
    evidence = np.array([h.log_evidence[column] for h in tried])
    if used == 0 or not np.isfinite(evidence).any():
        return Solution("undetermined", np.inf, Interval(0.0, np.inf), None, None, (), False, used, last_s, ())
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    order = np.argsort(-weights, kind="stable")
    tried = [_column(tried[k], column) for k in order]
    weights = weights[order]
    return _told(tried, weights, used, last_s)


def _told(
    tried: list[Hypothesis], weights: Array, used: int, last_s: float
) -> Solution:
    """The solution from the hypotheses of one target, the heaviest first."""
    p_values = _p_values(tried)[:, 0]
    candidates = tuple(
        Candidate(
            h.estimate.motion.name, float(w), float(h.estimate.chi2[0]), float(h.dof[0]), float(p)
        )
        for h, w, p in zip(tried, weights, p_values, strict=True)
    )
    heavy = [int(k) for k in counted(weights)]
    shares = weights[heavy] / weights[heavy].sum()
    aided = [tried[k].estimate.inverse_range() for k in heavy]
    alone = [_unaided(tried[k]).inverse_range() for k in heavy]
    means = np.array([a.value[0] for a in aided])
    sigmas = np.array([a.sigma[0] for a in aided])
    spread = np.sqrt(shares @ (sigmas**2 + (means - means[0]) ** 2))
    relative = float(np.nan_to_num(max(spread, alone[0].sigma[0]) / means[0], nan=np.inf))
    status = status_of(relative)
    if status == "undetermined":
        sigmas = np.array([a.sigma[0] for a in alone])
    winner = tried[0].estimate
    return Solution(
        status,
        relative,
        mixture_interval(shares, means, np.nan_to_num(sigmas, nan=1.0, posinf=1.0)),
        winner.line_of_sight().one(),
        velocity_family(winner),
        candidates,
        bool(p_values[0] < ALARM),
        used,
        last_s,
        tuple((float(w), tried[k].estimate) for w, k in zip(shares, heavy, strict=True)),
    )


def _unaided(hypothesis: Hypothesis) -> Estimate:
    """The estimate as if the prior said nothing of metres."""
    return hypothesis.estimate._replace(information=hypothesis.unaided)


def velocity_family(estimate: Estimate) -> VelocityFamily:
    """Of the first target."""
    line = estimate.line_of_sight().one()
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
