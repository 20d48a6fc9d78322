"""Relative location and orientation of two carriers' frames from common targets (paper 000)."""

from estimation.relative_frame.adjustment import (
    Registration,
    Update,
    adjustment,
    updated,
)
from estimation.relative_frame.bound import Bound, cramer_rao
from estimation.relative_frame.closed_form import (
    Information,
    closed_form,
    closed_form_dense,
    information,
    solve,
)
from estimation.relative_frame.information import OwnAxesInformation
from estimation.relative_frame.logs import (
    OwnAxesFrame,
    PolarLogs,
    RelativeFrame,
    RelativeFramePrior,
    in_own_axes,
    prior_in_own_axes,
)
from estimation.relative_frame.motion import Motion, motion_to
from estimation.relative_frame.observability import Direction, directions
from estimation.relative_frame.recursion import (
    AT_REST,
    STEADY,
    Drift,
    Travel,
    advanced,
    predicted,
)
from estimation.relative_frame.robust import RobustRegistration, robust_adjustment

__all__ = [
    "AT_REST",
    "STEADY",
    "Bound",
    "Direction",
    "Drift",
    "Information",
    "Motion",
    "OwnAxesFrame",
    "OwnAxesInformation",
    "PolarLogs",
    "Registration",
    "RelativeFrame",
    "RelativeFramePrior",
    "RobustRegistration",
    "Travel",
    "Update",
    "adjustment",
    "advanced",
    "closed_form",
    "closed_form_dense",
    "cramer_rao",
    "directions",
    "in_own_axes",
    "information",
    "motion_to",
    "predicted",
    "prior_in_own_axes",
    "robust_adjustment",
    "solve",
    "updated",
]
