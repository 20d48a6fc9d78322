"""A bearings-only solution as it is published."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from estimation.bearings_only import Solution
from schemas.messages import BearingLine

from ..navigation import upper_triangle

MOST_RANGE_M = 1e9
_COVARIANCE = upper_triangle(4)


def described(told: BearingLine, solution: Solution, count: int) -> BearingLine:
    """A line with what a solution of so many bearings says of range, motion and, if any, place."""
    winner, runner = solution.winner, solution.runner_up
    told = replace(
        told,
        status=solution.status,
        range_low_m=min(solution.interval.low_m, MOST_RANGE_M),
        range_high_m=_bound(solution.interval.high_m),
        motion=winner.motion if winner else "",
        motion_probability=min(winner.weight, 1.0) if winner else 0.0,
        runner_up=runner.motion if runner else "",
        p_value=min(max(winner.p_value, 0.0), 1.0) if winner else 1.0,
        alarm=solution.alarm,
        bearings=count,
    )
    state = solution.at(solution.last_s)
    if state is None or not np.isfinite(state.covariance).all():
        return told
    place, rate = state.position_m.tolist(), state.velocity_mps.tolist()
    if max(map(abs, place)) > MOST_RANGE_M or max(map(abs, rate)) > 1e5:
        return told
    covariance: list[float] = state.covariance[_COVARIANCE].tolist()
    return replace(told, position_m=place, velocity_mps=rate, covariance=covariance)


def _bound(range_m: float) -> float | None:
    """The upper end of an interval; none where it is open."""
    return range_m if range_m < MOST_RANGE_M else None
