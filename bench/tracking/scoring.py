"""How good a run was, by the measures of the demands: the only place that looks at the truth."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bench.tracking.ours import Run
from bench.tracking.scenes import Scene, instants
from estimation.arrays import Array
from estimation.consistency import rms
from estimation.metrics import Picture, gospa_over_time, identity_changes, matched_over_time

_CUT_M = 1000.0
_SETTLED_S = 10.0


class Score(NamedTuple):
    """Of a run, from `from_s` on.

    Attributes:
        gospa_m: mean over time (c = 1000 m, p = 2, alpha = 2).
        localisation_m: root mean square error of the matched.
        missed, false: mean numbers.
        identity_changes: over the run.
        count_rmse: of the number of targets, by that number.
    """

    gospa_m: float
    localisation_m: float
    missed: float
    false: float
    identity_changes: int
    count_rmse: float


def score(scene: Scene, run: Run, from_s: float = _SETTLED_S) -> Score:
    """The measures of a run, of as many scans as it had."""
    steps = [k for k in instants(scene, from_s) if k < len(run.shown)]
    truth, tracks = _truth(scene, steps), _tracks(run, steps)
    total = gospa_over_time(truth, tracks, _CUT_M)
    pairs = matched_over_time(truth, tracks, _CUT_M)
    return Score(
        float(total.distance.mean()),
        float(rms(pairs.distance)) if len(pairs.distance) else math.nan,
        float(total.missed_count.mean()),
        float(total.false_count.mean()),
        identity_changes(
            truth.step[pairs.truth], truth.identity[pairs.truth], tracks.identity[pairs.estimate]
        ),
        float(rms(_count_errors(scene, run, steps))),
    )


def _truth(scene: Scene, steps: list[int]) -> Picture:
    alive = [np.flatnonzero(scene.alive[k]) for k in steps]
    return Picture(
        np.repeat(steps, [len(rows) for rows in alive]),
        np.concatenate(alive),
        np.concatenate([scene.truth[k][rows] for k, rows in zip(steps, alive, strict=True)]),
    )


def _tracks(run: Run, steps: list[int]) -> Picture:
    shown = [run.shown[k] for k in steps]
    return Picture(
        np.repeat(steps, [len(each.identity) for each in shown]),
        np.concatenate([each.identity for each in shown]),
        np.concatenate([each.place_m for each in shown]),
    )


def _count_errors(scene: Scene, run: Run, steps: list[int]) -> Array:
    number = np.array([run.shown[k].number for k in steps])
    return np.asarray(number / scene.alive[steps].sum(axis=1) - 1.0)
