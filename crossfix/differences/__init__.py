"""Two recordings held against each other, to the last bit or within a tolerance."""

from .comparison import ROLES, ChannelDiff, Diff, FirstDifference, diff, is_named
from .fields import EXACT, FieldChange, Rules, changes, first_difference, unpacked
from .figures import FieldSummary

__all__ = [
    "EXACT",
    "ROLES",
    "ChannelDiff",
    "Diff",
    "FieldChange",
    "FieldSummary",
    "FirstDifference",
    "Rules",
    "changes",
    "diff",
    "first_difference",
    "is_named",
    "unpacked",
]
