"""Relative location and orientation of two carriers' frames from common targets (paper 000)."""

from estimation.relative_frame.adjustment import (
    Registration,
    Update,
    adjustment,
    updated,
)
from estimation.relative_frame.attitude import (
    AttitudePrior,
    SpatialFrame,
    SphericalLogs,
    spatial_adjustment,
)
from estimation.relative_frame.bound import Bound, cramer_rao
from estimation.relative_frame.change_detection import (
    Alarm,
    Watch,
    reopened,
    watched,
    watching,
)
from estimation.relative_frame.closed_form import (
    Information,
    closed_form,
    closed_form_dense,
    information,
    solve,
)
from estimation.relative_frame.consider import Positions, corrected, fused, positions
from estimation.relative_frame.fixed_axes import in_fixed_axes
from estimation.relative_frame.joint import (
    Elapsed,
    JointFrames,
    JointUpdate,
    carried_on,
    improved_by,
    own_alone,
)
from estimation.relative_frame.logs import (
    OwnAxesFrame,
    PolarLogs,
    RelativeFrame,
    RelativeFramePrior,
    in_own_axes,
    prior_in_own_axes,
)
from estimation.relative_frame.methods import Method, linearised_once
from estimation.relative_frame.motion import Motion, motion_to
from estimation.relative_frame.network import (
    NetworkFrames,
    NetworkLogs,
    NetworkPrior,
    network_adjustment,
)
from estimation.relative_frame.observability import Diagnosis, Direction, diagnose, directions
from estimation.relative_frame.own_axes_information import OwnAxesInformation
from estimation.relative_frame.recursion import (
    AT_REST,
    STEADY,
    Drift,
    Travel,
    advanced,
    predicted,
)
from estimation.relative_frame.robust import RobustRegistration, robust_adjustment
from estimation.relative_frame.sensor_errors import (
    SensorErrorPrior,
    SensorRegistration,
    adjustment_with_sensor_errors,
)
from estimation.relative_frame.tracks import (
    Increment,
    MotionModel,
    Reuse,
    TrackLog,
    as_plots,
    equivalent_measurement,
    memory_s,
    plots_of_tracks,
    reuse,
    thinned,
)

__all__ = [
    "AT_REST",
    "STEADY",
    "Alarm",
    "AttitudePrior",
    "Bound",
    "Diagnosis",
    "Direction",
    "Drift",
    "Elapsed",
    "Increment",
    "Information",
    "JointFrames",
    "JointUpdate",
    "Method",
    "Motion",
    "MotionModel",
    "NetworkFrames",
    "NetworkLogs",
    "NetworkPrior",
    "OwnAxesFrame",
    "OwnAxesInformation",
    "PolarLogs",
    "Positions",
    "Registration",
    "RelativeFrame",
    "RelativeFramePrior",
    "Reuse",
    "RobustRegistration",
    "SensorErrorPrior",
    "SensorRegistration",
    "SpatialFrame",
    "SphericalLogs",
    "TrackLog",
    "Travel",
    "Update",
    "Watch",
    "adjustment",
    "adjustment_with_sensor_errors",
    "advanced",
    "as_plots",
    "carried_on",
    "closed_form",
    "closed_form_dense",
    "corrected",
    "cramer_rao",
    "diagnose",
    "directions",
    "equivalent_measurement",
    "fused",
    "improved_by",
    "in_fixed_axes",
    "in_own_axes",
    "information",
    "linearised_once",
    "memory_s",
    "motion_to",
    "network_adjustment",
    "own_alone",
    "plots_of_tracks",
    "positions",
    "predicted",
    "prior_in_own_axes",
    "reopened",
    "reuse",
    "robust_adjustment",
    "solve",
    "spatial_adjustment",
    "thinned",
    "updated",
    "watched",
    "watching",
]
