"""The memory of the fusion, and how it is packed."""

from .carriers import Boots, CarrierState, SourceLogs, Timeline, Told
from .features import Dictionary, Learned, Reports, Scale, Word
from .group import Group, Member
from .links import Estimate, Frames, Link, Monitor, Orders, Strain, WatchColumns
from .targets import Drawn, Line, Nameless, Notes, Paired, Rays, Watched
from .whole import Past, State, pack, unpack

__all__ = [
    "Boots",
    "CarrierState",
    "Dictionary",
    "Drawn",
    "Estimate",
    "Frames",
    "Group",
    "Learned",
    "Line",
    "Link",
    "Member",
    "Monitor",
    "Nameless",
    "Notes",
    "Orders",
    "Paired",
    "Past",
    "Rays",
    "Reports",
    "Scale",
    "SourceLogs",
    "State",
    "Strain",
    "Timeline",
    "Told",
    "WatchColumns",
    "Watched",
    "Word",
    "pack",
    "unpack",
]
