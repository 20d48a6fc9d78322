"""The alarm: how soon it sees a jump, how seldom it cries without one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bench.figures import Figure, at_least, at_most, told
from bench.registration.over_time import (
    DRIFT,
    INTERVAL_S,
    TARGETS,
    Truth,
    drifted,
    first,
    moved,
    pairs,
)
from bench.registration.scenes import DEG
from estimation.arrays import Array
from estimation.relative_frame import AT_REST, Drift, predicted, updated, watched, watching

SETTLE, WITHIN = 30, 15  # scans before a jump, scans in which it must be seen
JUMP_M, JUMP_RAD = 300.0, 1 * DEG
SLOW = Drift(q_m_per_root_s=1.0, D_rad_per_root_s=0.005 * DEG)  # 60 m and .3 deg in an hour


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The demand on the alarm."""
    count = max(runs // 100, 30)
    for name, sizes in (("1 deg", (0.0, JUMP_RAD)), ("300 m", (JUMP_M, 0.0))):
        raised = jumped(np.random.default_rng([seed, 15]), count, *sizes)
        seen = raised[SETTLE : SETTLE + WITHIN]
        yield at_least(f"alarm within 15 scans of a jump of {name}", seen.any(axis=0).mean(), 0.98)
        delay = seen.argmax(axis=0)[seen.any(axis=0)] + 1
        yield told(f"alarm after a jump of {name}, median", float(np.median(delay)), "scans")
    fast = jumped(np.random.default_rng([seed, 15]), count, 0.0, JUMP_RAD, drift=DRIFT)
    share = fast[SETTLE : SETTLE + WITHIN].any(axis=0).mean()
    yield told("alarm within 15 scans of a jump of 1 deg, four times the drift", share)
    scans = 300
    quiet = jumped(np.random.default_rng([seed, 16]), count, 0.0, 0.0, scans)
    yield at_most("false alarms in 3000 scans", false_alarms(quiet) / (count * scans) * 3000, 1)


def jumped(
    rng: np.random.Generator,
    runs: int,
    jump_m: float,
    jump_rad: float,
    scans: int = SETTLE + WITHIN,
    drift: Drift = SLOW,
) -> NDArray[np.bool_]:
    """Alarms (scans, runs) of a drifting frame that jumps once, after `SETTLE` scans."""
    frame, truth = first(rng, runs)
    frame = updated(*pairs(rng, truth, 5 * TARGETS), frame).frame
    watch, raised = watching(frame), []
    for scan in range(scans):
        truth = moved(truth, AT_REST, drifted(rng, runs, drift, INTERVAL_S))
        if scan == SETTLE:
            truth = _after_jump(rng, truth, jump_m, jump_rad)
        expected = predicted(frame, INTERVAL_S, drift)
        update = updated(*pairs(rng, truth, TARGETS), expected)
        watch, alarm = watched(watch, expected, update.information, INTERVAL_S, drift)
        frame = update.frame
        raised.append(alarm.raised)
    return np.array(raised)


def _after_jump(rng: np.random.Generator, truth: Truth, jump_m: float, jump_rad: float) -> Truth:
    angle = rng.uniform(-np.pi, np.pi, len(truth.D_rad))
    along: Array = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    turn = jump_rad * rng.choice([-1, 1], len(angle))
    return Truth(truth.q_m + jump_m * along, truth.D_rad + turn)


def false_alarms(raised: NDArray[np.bool_]) -> int:
    """How often an alarm begins; one that stays on for some scans counts once."""
    begun = raised.copy()
    begun[1:] &= ~raised[:-1]
    return int(begun.sum())
