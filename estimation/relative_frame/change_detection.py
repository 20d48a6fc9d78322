"""Has the frame jumped? A gyro restarted, a position was re-set: say so within a few scans.

Two tests of each scan's pairs. The *scan* test compares what the scan alone says of (q, D) with
the frame as it was followed: two in a row above 16.3 (1 in 1000 each). It sees large jumps at
once. The *window* test compares the last eight scans together with the frame as it was before
them, which the jump could not bend: above 21.1 (1 in 10 000). It sees small ones.

Both numbers are chi-squared of three: (q, D) of a scan against (q, D) before.

Source: Willsky, "A survey of design methods for failure detection in dynamic systems",
Automatica 12, 1976 (innovations tests; a window against a lagged filter).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.arrays import Array, transposed
from estimation.frames import rotation_clockwise
from estimation.relative_frame.gauge import root_of
from estimation.relative_frame.logs import OwnAxesFrame
from estimation.relative_frame.matrices import solved
from estimation.relative_frame.own_axes_information import OwnAxesInformation
from estimation.relative_frame.recursion import AT_REST, Drift, Travel, predicted

WINDOW = 8  # scans
SCAN_LIMIT, WINDOW_LIMIT = 16.3, 21.1  # chi-squared of 3: .999 and .9999


class Scan(NamedTuple):
    """One scan of the window: how it was reached from the one before, and what it said."""

    elapsed_s: float
    travel: Travel
    information: OwnAxesInformation


class Watch(NamedTuple):
    """What the alarm remembers; frozen, of bounded size.

    Attributes:
        before: the frame as it was before the scans of the window.
        scans: the window, oldest first, at most 8.
        suspected: (...) the last scan's own chi2 was above its limit.
    """

    before: OwnAxesFrame
    scans: tuple[Scan, ...]
    suspected: NDArray[np.bool_]


class Alarm(NamedTuple):
    """What one scan said.

    Attributes:
        scan_chi2: (...) this scan against the frame followed so far.
        window_chi2: (...) the window against the frame before it.
        raised: (...) two scans in a row, or the window, beyond their limits.
    """

    scan_chi2: Array
    window_chi2: Array
    raised: NDArray[np.bool_]


def watching(frame: OwnAxesFrame) -> Watch:
    """Begin to watch a frame that has been found."""
    return Watch(frame, (), np.zeros(np.shape(frame.D_rad), dtype=bool))


def watched(
    watch: Watch,
    expected: OwnAxesFrame,
    said: OwnAxesInformation,
    elapsed_s: float,
    drift: Drift,
    travel: Travel = AT_REST,
) -> tuple[Watch, Alarm]:
    """Judge one more scan.

    Args:
        watch: from the scan before.
        expected: the frame predicted to this scan, before its pairs were used.
        said: what this scan's pairs alone say (`Update.information`).
        elapsed_s, travel: since the scan before.
        drift: the random walk that is normal.
    """
    scans = (*watch.scans, Scan(elapsed_s, travel, said))
    before = watch.before
    if len(scans) > WINDOW:
        gone, scans = scans[0], scans[1:]
        reached = predicted(before, gone.elapsed_s, drift, gone.travel)
        before = gone.information.with_prior(reached)
    scan_chi2 = disagreement(said, expected)
    window_chi2 = _window_chi2(before, scans, drift)
    suspected = scan_chi2 > SCAN_LIMIT
    raised = (suspected & watch.suspected) | (window_chi2 > WINDOW_LIMIT)
    return Watch(before, scans, suspected), Alarm(scan_chi2, window_chi2, raised)


def disagreement(said: OwnAxesInformation, frame: OwnAxesFrame) -> Array:
    """Chi2 (...) of what pairs say of (q, D) against a frame known without them, 3 degrees.

    y' (Y + Y P Y)^-1 y = u' (I + R)^-1 u in units of the frame, so that pairs which determine
    only part of (q, D) are judged on that part (and have fewer degrees of freedom).
    """
    point = np.concatenate([frame.q_m, np.asarray(frame.D_rad)[..., None]], axis=-1)
    there = said.about(point)
    root = root_of(frame.covariance)
    gained = transposed(root) @ there.matrix @ root
    # eigenvalues g of what was gained: y' in those axes has the variance g (1 + g)
    values, axes = np.linalg.eigh(gained)
    pulled = (transposed(axes) @ transposed(root) @ there.vector[..., None])[..., 0]
    enough = values > 1e-9
    safe = np.where(enough, values, 1.0)
    return np.asarray(np.sum(np.where(enough, pulled**2 / (safe * (1 + safe)), 0.0), axis=-1))


def _window_chi2(before: OwnAxesFrame, scans: tuple[Scan, ...], drift: Drift) -> Array:
    """All scans of the window, carried back to before it, against the frame as it was there.

    Backwards, so that the walk inside the window blurs only the scans and not the frame too.
    """
    *earlier, newest = scans
    total = _carried_back(newest.information, newest, drift)
    for scan in reversed(earlier):
        total = _carried_back(scan.information + total, scan, drift)
    return disagreement(total, before)


def _carried_back(said: OwnAxesInformation, scan: Scan, drift: Drift) -> OwnAxesInformation:
    """What is said of (q, D) at a scan, as information on (q, D) one scan earlier."""
    blur = np.eye(3) + said.matrix @ drift.covariance(scan.elapsed_s)
    both = solved(blur, np.concatenate([said.matrix, said.vector[..., None]], axis=-1))
    matrix, vector = both[..., :3], both[..., 3:]
    other = np.asarray(scan.travel.other_m, dtype=float)
    turned = (rotation_clockwise(said.point[..., 2]) @ other[..., None])[..., 0]
    forward = np.zeros_like(said.matrix)
    forward[..., range(3), range(3)] = 1
    forward[..., 0, 2], forward[..., 1, 2] = turned[..., 1], -turned[..., 0]
    point = said.point.copy()
    point[..., :2] += np.asarray(scan.travel.own_m, dtype=float) - turned
    back = transposed(forward)
    earlier, pull = back @ matrix @ forward, (back @ vector)[..., 0]
    return OwnAxesInformation(point, earlier, pull, said.chi2, said.pairs)


def reopened(frame: OwnAxesFrame, sigma_q_m: float, sigma_D_rad: float) -> OwnAxesFrame:  # noqa: N803
    """After an alarm: the frame with its covariance widened by what it may have jumped.

    The estimate stays, the next scans move it; begin to watch it anew.
    """
    jump = np.diag([sigma_q_m**2, sigma_q_m**2, sigma_D_rad**2])
    return frame._replace(covariance=frame.covariance + jump)
