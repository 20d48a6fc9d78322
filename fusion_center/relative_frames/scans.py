"""The frames that are followed, improved by the plots of one report event, and watched.

A carrier whose plots are out of line with where its frame is expected does not bend the others':
its plots are left out of that event, and two such events in a row are an alarm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.consistency import nees
from estimation.relative_frame import Drift, NetworkLogs, OwnAxesFrame
from estimation.relative_frame.change_detection import SCAN_LIMIT, WINDOW, disagreement
from estimation.relative_frame.joint import JointFrames, JointUpdate, improved_by
from estimation.relative_frame.matrices import Indices
from estimation.relative_frame.own_axes_information import OwnAxesInformation

from ..settings import RegistrationSettings
from .corrections import Misclosure


class Scan(NamedTuple):
    """What the plots of one event had to say of one carrier's frame.

    Attributes:
        expected: the frame before; found: after, or `expected` where the plots were left out.
        misclosure: of the targets it was seen with.
        out_of_line: the plots contradict the frame as it was expected.
        said: what the plots say of the frame, the others being as they were expected.
    """

    expected: OwnAxesFrame
    found: OwnAxesFrame
    misclosure: Misclosure
    out_of_line: bool
    said: OwnAxesInformation


class Followed(NamedTuple):
    """Frames after an event.

    Attributes:
        joint: all of them.
        scans: of each carrier but the own one, in order; None of those that had no pair.
        target_chi2: (T,) misclosure of each target per degree of freedom; nan = not used.
        range_scores: of each carrier, see `JointUpdate.range_score`; none where nothing was said.
    """

    joint: JointFrames
    scans: list[Scan | None]
    target_chi2: NDArray[np.float64]
    range_scores: Sequence[tuple[float, float]] = ()


def taken_in(
    joint: JointFrames, logs: NetworkLogs, targets: int, limits: Sequence[float]
) -> Followed:
    """All frames with the plots of one event taken in.

    Args:
        logs: carriers numbered as in `joint`.
        targets: how many there are.
        limits: (chi2 by degrees of freedom) beyond which a carrier is out of line.
    """
    if not logs.carrier.size:
        return Followed(joint, [None] * (joint.carriers - 1), np.full(targets, np.nan))
    update = improved_by(joint, logs)
    scans = [_scan(joint, update, logs, k, limits) for k in range(1, joint.carriers)]
    wrong = [k for k, scan in enumerate(scans, 1) if scan and scan.out_of_line]
    after = update
    if wrong or not update.converged:
        kept = ~np.isin(logs.carrier, wrong)
        after = improved_by(joint, logs.take(kept)) if update.converged else update
    better = after.joint if after.converged else joint
    return Followed(
        better,
        [scan and scan._replace(found=better.frame(k)) for k, scan in enumerate(scans, 1)],
        _per_target(update, targets),
        [update.range_score(k) for k in range(joint.carriers)] if update.converged else (),
    )


def _scan(
    joint: JointFrames, update: JointUpdate, logs: NetworkLogs, k: int, limits: Sequence[float]
) -> Scan | None:
    """What was said of carrier k; None where nothing was."""
    mine = np.unique(logs.target[logs.carrier == k])
    used: Indices = mine[update.used[mine] & (update.target_dof[mine] > 0)]
    if not used.size:
        return None
    expected, after = joint.frame(k), update.joint.frame(k)
    moved = np.append(after.q_m - expected.q_m, after.D_rad - expected.D_rad)
    pull = float(nees(moved, expected.covariance))
    chi2 = float(update.target_chi2[used].sum()) + pull
    dof = int(update.target_dof[used].sum())
    said = update.said_of(k, int(used.size))
    out = chi2 > limits[min(dof, len(limits) - 1)] or disagreement(said, expected) > SCAN_LIMIT
    misclosure = Misclosure(int(used.size), chi2, dof)
    return Scan(expected, after, misclosure, bool(out) or not update.converged, said)


def drift(joint: JointFrames, number: int, settings: RegistrationSettings, scan_s: float) -> Drift:
    """The random walk that the alarm takes for normal: the doubt of the drift over its window."""
    _, covariance = joint.drift_mps(number)
    unsure = float(np.trace(covariance)) / 2 * WINDOW * scan_s
    return Drift(
        float(np.sqrt(unsure + 2 * settings.drift_m_per_root_s**2)),
        float(np.sqrt(2) * settings.drift_rad_per_root_s),
    )


def _per_target(update: JointUpdate, targets: int) -> NDArray[np.float64]:
    chi2 = np.full(targets, np.nan)
    told = update.used & (update.target_dof > 0)
    which = np.flatnonzero(told)
    chi2[which] = update.target_chi2[which] / update.target_dof[which]
    return chi2
