"""Beacons surveyed by a moving object's ranges or range differences (paper 003)."""

from estimation.system_alignment.adviser import (
    Advice,
    Leg,
    advise,
    beacon_sigma_m,
    straight_legs,
)
from estimation.system_alignment.closed_form import closed_form_start
from estimation.system_alignment.logs import DeadReckoning, Ranges, dead_reckoning, ranges
from estimation.system_alignment.losses import PLAIN, ROBUST, Loss
from estimation.system_alignment.observability import Diagnosis, Direction, diagnose
from estimation.system_alignment.online import (
    Filtered,
    filtered,
    predicted,
    resumed,
    second_order,
    started,
    updated,
)
from estimation.system_alignment.parameters import Prior, offsets_of, places_of, prior
from estimation.system_alignment.smoother import Alignment, PriorTest, align

__all__ = [
    "PLAIN",
    "ROBUST",
    "Advice",
    "Alignment",
    "DeadReckoning",
    "Diagnosis",
    "Direction",
    "Filtered",
    "Leg",
    "Loss",
    "Prior",
    "PriorTest",
    "Ranges",
    "advise",
    "align",
    "beacon_sigma_m",
    "closed_form_start",
    "dead_reckoning",
    "diagnose",
    "filtered",
    "offsets_of",
    "places_of",
    "predicted",
    "prior",
    "ranges",
    "resumed",
    "second_order",
    "started",
    "straight_legs",
    "updated",
]
