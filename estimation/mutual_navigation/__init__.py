"""Carriers that navigate by each other, correlated as they then are (paper 004)."""

from estimation.mutual_navigation.filtering import (
    Gaussian,
    Step,
    corrected,
    predicted,
    smoothed,
    updated,
)
from estimation.mutual_navigation.motion import Wander, joint_start, joint_step
from estimation.mutual_navigation.network import (
    USER_STATES,
    Network,
    Pseudoranges,
    Seen,
    links,
    network,
    seen,
)
from estimation.mutual_navigation.paper import Pair, Scalar, by_cosines, modified_update
from estimation.mutual_navigation.split_intersection import Fix, Message, fused
from estimation.mutual_navigation.split_intersection import predicted as predicted_fix

__all__ = [
    "USER_STATES",
    "Fix",
    "Gaussian",
    "Message",
    "Network",
    "Pair",
    "Pseudoranges",
    "Scalar",
    "Seen",
    "Step",
    "Wander",
    "by_cosines",
    "corrected",
    "fused",
    "joint_start",
    "joint_step",
    "links",
    "modified_update",
    "network",
    "predicted",
    "predicted_fix",
    "seen",
    "smoothed",
    "updated",
]
