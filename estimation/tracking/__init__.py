"""Tracking: filters in banks, tracks of one source in its own frame."""

from estimation.tracking.bank import (
    EMPTY,
    Bank,
    Innovations,
    begun,
    carried,
    improved,
    innovations,
)
from estimation.tracking.existence import SUREST, missed, seen, survived
from estimation.tracking.source_tracks import (
    Matches,
    Scan,
    Sensing,
    assigned,
    expected,
    log_ratio,
    matched,
)

__all__ = [
    "EMPTY",
    "SUREST",
    "Bank",
    "Innovations",
    "Matches",
    "Scan",
    "Sensing",
    "assigned",
    "begun",
    "carried",
    "expected",
    "improved",
    "innovations",
    "log_ratio",
    "matched",
    "missed",
    "seen",
    "survived",
]
