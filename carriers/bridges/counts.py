"""What became of the records of a feed, in numbers."""

from __future__ import annotations

from collections import Counter

MAX_FIELDS = 32
"""Fields that are counted one by one; strangers invent names without end."""
OTHER = "other"


class Counts:
    """Counts of one bridge since its start.

    Attributes:
        received: records of any kind; decoded + rejected.
        late: published, but too old to be sure of being fused.
        published: messages, SourceInfo and navigation of our own making included.
        rejected_by: field -> records refused for it.
    """

    def __init__(self) -> None:
        self.received = self.decoded = self.rejected = self.late = self.published = 0
        self.rejected_by: Counter[str] = Counter()

    def reject(self, field: str) -> None:
        """One record is refused for a field."""
        self.rejected += 1
        known = field in self.rejected_by or len(self.rejected_by) < MAX_FIELDS
        self.rejected_by[field[:64] if known else OTHER] += 1

    def counters(self) -> dict[str, int]:
        """All of them by name, as they stand in the state of the process."""
        names = ("received", "decoded", "rejected", "late", "published")
        fields = {f"rejected {field}": n for field, n in self.rejected_by.copy().items()}
        return {name: getattr(self, name) for name in names} | fields

    def __str__(self) -> str:
        fields = ", ".join(f"{field}: {n}" for field, n in self.rejected_by.most_common())
        rejected = f"rejected {self.rejected}" + (f" ({fields})" if fields else "")
        return f"received {self.received}, decoded {self.decoded}, {rejected}, late {self.late}"
