"""Tracking: filters in banks, tracks of one source in its own frame."""

from estimation.tracking.bank import (
    EMPTY,
    Bank,
    Innovations,
    begun,
    carried,
    improved,
    innovations_of,
)
from estimation.tracking.existence import SUREST, missed, seen
from estimation.tracking.source_tracks import Sensing, assigned, log_ratio

__all__ = [
    "EMPTY",
    "SUREST",
    "Bank",
    "Innovations",
    "Sensing",
    "assigned",
    "begun",
    "carried",
    "improved",
    "innovations_of",
    "log_ratio",
    "missed",
    "seen",
]
