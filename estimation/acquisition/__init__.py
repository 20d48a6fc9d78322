"""Association and registration of two carriers together, when no log says whose it is (000)."""

from estimation.acquisition.acquire import (
    Acquisition,
    Mode,
    Settings,
    Status,
    acquire,
    acquire_blind,
    unknown_frame,
)
from estimation.acquisition.problem import Clues, Constraints, Velocities, constraints

__all__ = [
    "Acquisition",
    "Clues",
    "Constraints",
    "Mode",
    "Settings",
    "Status",
    "Velocities",
    "acquire",
    "acquire_blind",
    "constraints",
    "unknown_frame",
]
