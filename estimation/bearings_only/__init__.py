"""Trajectories from bearings (paper 001)."""

from estimation.bearings_only.bearing_tracks import BearingTracks, followed, no_tracks
from estimation.bearings_only.bound import cramer_rao
from estimation.bearings_only.doubt import FrameDoubt
from estimation.bearings_only.each_target import EachTarget, each_target
from estimation.bearings_only.estimate import Estimate, InverseRange, LineOfSight, State
from estimation.bearings_only.fitting import maximum_likelihood
from estimation.bearings_only.measurements import Bearings, bearings
from estimation.bearings_only.motions import (
    CONSTANT_ACCELERATION,
    CONSTANT_JERK,
    CONSTANT_VELOCITY,
    FAMILY,
    FINITE_TURN,
    STRAIGHT_ACCELERATED,
    THREE_LEGS,
    TURN_RATE,
    TWO_LEGS,
    Motion,
    polynomial,
    spline,
)
from estimation.bearings_only.next_turn import Turn, best_turn
from estimation.bearings_only.pairing import log_odds_of_one
from estimation.bearings_only.prior import MotionPrior
from estimation.bearings_only.profile import Ranges, likely_ranges
from estimation.bearings_only.robust import gross_errors, student_t
from estimation.bearings_only.seeds import (
    SeedTrack,
    chebyshev_first,
    chebyshev_second,
    n_bearings,
    n_polynomials,
)
from estimation.bearings_only.several_carriers import FramePrior, JointSolution, jointly
from estimation.bearings_only.solution import (
    Candidate,
    Interval,
    Solution,
    Status,
    VelocityFamily,
)
from estimation.bearings_only.solving import solve, solve_many
from estimation.bearings_only.space import Elevations, SpatialEstimate, in_space

__all__ = [
    "CONSTANT_ACCELERATION",
    "CONSTANT_JERK",
    "CONSTANT_VELOCITY",
    "FAMILY",
    "FINITE_TURN",
    "STRAIGHT_ACCELERATED",
    "THREE_LEGS",
    "TURN_RATE",
    "TWO_LEGS",
    "BearingTracks",
    "Bearings",
    "Candidate",
    "EachTarget",
    "Elevations",
    "Estimate",
    "FrameDoubt",
    "FramePrior",
    "Interval",
    "InverseRange",
    "JointSolution",
    "LineOfSight",
    "Motion",
    "MotionPrior",
    "Ranges",
    "SeedTrack",
    "Solution",
    "SpatialEstimate",
    "State",
    "Status",
    "Turn",
    "VelocityFamily",
    "bearings",
    "best_turn",
    "chebyshev_first",
    "chebyshev_second",
    "cramer_rao",
    "each_target",
    "followed",
    "gross_errors",
    "in_space",
    "jointly",
    "likely_ranges",
    "log_odds_of_one",
    "maximum_likelihood",
    "n_bearings",
    "n_polynomials",
    "no_tracks",
    "polynomial",
    "solve",
    "solve_many",
    "spline",
    "student_t",
]
