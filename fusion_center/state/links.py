"""What is remembered of the frames: estimates, their monitors and alarms, operators' orders."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from estimation.relative_frame import JointFrames
from schemas.messages import Direction, FixedAxes, OwnAxes, Pose, SourceTerm
from schemas.messages.outputs import CorrectionState


class Estimate(Struct, frozen=True, kw_only=True):
    """One registration of a carrier's frame against the own one; the fields of a Correction.

    Attributes:
        spreads_m2_s: how fast the variance of its place grows since errors of place and drift go
            together, per axis; 0 where that is not known.
    """

    valid_t_ns: int
    own_pose: Pose
    other_pose: Pose
    own_axes: OwnAxes
    fixed_axes: FixedAxes
    directions: tuple[Direction, ...]
    pairs: int
    chi2: float
    dof: int
    method: str = "closed_form"
    mode_probability: float = 1.0
    since_t_ns: int = 0
    valid_for_s: float = 0.0
    spreads_m2_s: float = 0.0
    terms: tuple[SourceTerm, ...] = ()


class Monitor(Struct, frozen=True, kw_only=True):
    """How far a correction has come.

    Attributes:
        good, undetermined, excessive: report events in a row that were so.
    """

    state: CorrectionState = "observing"
    reason: str = "nothing to compare yet"
    good: int = 0
    undetermined: int = 0
    excessive: int = 0


class WatchColumns(Struct, frozen=True, kw_only=True, eq=False):
    """`estimation.relative_frame.Watch` of one frame, as columns; w scans in its window.

    Attributes:
        t_ns: of the last scan; way_m: (2, 2) of the own and of the other carrier then.
        before, before_covariance: (3,), (3, 3) the frame before the window.
        elapsed_s: (w,); own_m, other_m: (w, 2) travel to each scan from the one before.
        point, vector: (w, 3), matrix: (w, 3, 3), chi2: (w,), pairs: (w,) what each scan said.
        suspected: the last scan was out of line.
    """

    t_ns: int
    way_m: NDArray[np.float64]
    before: NDArray[np.float64]
    before_covariance: NDArray[np.float64]
    elapsed_s: NDArray[np.float64]
    own_m: NDArray[np.float64]
    other_m: NDArray[np.float64]
    point: NDArray[np.float64]
    matrix: NDArray[np.float64]
    vector: NDArray[np.float64]
    chi2: NDArray[np.float64]
    pairs: NDArray[np.int64]
    suspected: bool


class Frames(Struct, frozen=True, kw_only=True, eq=False):
    """Frames of carriers followed together: `estimation.relative_frame.JointFrames`, and of when.

    Attributes:
        t_ns: the instant.
        carriers: whose, in the order of the rows after the own carrier's, which is the first.
        mean: (N, 7); covariance: (7 N, 7 N).
        way_m: (N, 2) dead-reckoned way of each at that instant.
        heading_rad: (N,) of each bow.
        north_variance: (N,) stated for each north [rad^2].
    """

    t_ns: int
    carriers: tuple[str, ...]
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    way_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    north_variance: NDArray[np.float64]


def frames_without(frames: Frames | None, name: str) -> Frames | None:
    """The frames of the other carriers; None where there are none."""
    if frames is None or name not in frames.carriers:
        return frames
    if len(frames.carriers) == 1:
        return None
    gone = frames.carriers.index(name) + 1  # the own carrier's row is the first
    left = JointFrames(frames.mean, frames.covariance).without(gone)
    return replace(
        frames,
        carriers=tuple(c for c in frames.carriers if c != name),
        mean=left.mean,
        covariance=left.covariance,
        way_m=np.delete(frames.way_m, gone, axis=0),
        heading_rad=np.delete(frames.heading_rad, gone),
        north_variance=np.delete(frames.north_variance, gone),
    )


class Link(Struct, frozen=True, kw_only=True):
    """An other carrier as seen from the own one.

    Attributes:
        own_news, other_news: who has reported since the last registration.
        followed: the frame has been found and is followed over time.
        found_t_ns: when it was; -1 before.
        mode_probability: of the association it was found with.
        events: report events so far; tries: searches in vain since the last success.
        doubts: searches in a row that found another frame than the one followed.
        usual_pairs: at an event, on average over the last ones.
        watch: what the alarm remembers.
        bearings_t_ns: last attempt to find the frame of bearings alone; -1 = none.
        estimate: what is published: the newest, or while applied the last good one.
    """

    own_news: bool = False
    other_news: bool = False
    followed: bool = False
    found_t_ns: int = -1
    mode_probability: float = 0.0
    events: int = 0
    tries: int = 0
    doubts: int = 0
    usual_pairs: float = 0.0
    watch: WatchColumns | None = None
    bearings_t_ns: int = -1
    monitor: Monitor = Monitor()
    estimate: Estimate | None = None


class Strain(Struct, frozen=True, kw_only=True):
    """Sums over events of what they say of a bias of a source's ranges, see `range_score`.

    Attributes:
        score [1/m], information [1/m^2]; variance: of the score where there is no bias.
    """

    score: float = 0.0
    information: float = 0.0
    variance: float = 0.0


class Orders(Struct, frozen=True, kw_only=True):
    """What operators have decided so far.

    Attributes:
        seq: of the last event that was taken.
        suspended: carriers whose correction is not to be applied.
        bound, forbidden: pairs of tracks, each carrier/source/track_id.
    """

    seq: int = 0
    suspended: tuple[str, ...] = ()
    bound: tuple[tuple[str, str], ...] = ()
    forbidden: tuple[tuple[str, str], ...] = ()
