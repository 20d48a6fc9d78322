"""The memory of the fusion, and how it is packed."""

from .carriers import Boots, CarrierState, SourceLogs, Timeline, Told
from .links import Estimate, Frames, Link, Monitor, Orders, WatchColumns
from .targets import Aligned, Drawn, Line, Notes, Rays, Watched
from .whole import Past, State, pack, unpack

__all__ = [
    "Aligned",
    "Boots",
    "CarrierState",
    "Drawn",
    "Estimate",
    "Frames",
    "Line",
    "Link",
    "Monitor",
    "Notes",
    "Orders",
    "Past",
    "Rays",
    "SourceLogs",
    "State",
    "Timeline",
    "Told",
    "WatchColumns",
    "Watched",
    "pack",
    "unpack",
]
