"""What became of the records of a feed, in numbers."""

from __future__ import annotations

from collections import Counter

MAX_FIELDS = 32
"""Fields that are counted one by one; strangers invent names without end."""
OTHER = "other"


class Counts:
    """Counts of one bridge since its start.

    Attributes:
        late: published, but too old to be sure of being fused.
        published: messages, SourceInfo and navigation of our own making included.
        rejected_by: field -> records refused for it.
    """

    def __init__(self) -> None:
        self.decoded = self.late = self.published = 0
        self.rejected_by: Counter[str] = Counter()

    @property
    def rejected(self) -> int:
        """Records refused."""
        return self.rejected_by.copy().total()

    @property
    def received(self) -> int:
        """Records of any kind."""
        return self.decoded + self.rejected

    def reject(self, field: str) -> None:
        """One record is refused for a field."""
        known = field in self.rejected_by or len(self.rejected_by) < MAX_FIELDS
        self.rejected_by[field[:64] if known else OTHER] += 1

    def counters(self) -> dict[str, int]:
        """All of them by name, as they stand in the state of the process.

        Sums agree though records go on being counted meanwhile.
        """
        decoded, refused = self.decoded, self.rejected_by.copy()
        rejected = refused.total()
        sums = {"received": decoded + rejected, "decoded": decoded, "rejected": rejected}
        others = {"late": self.late, "published": self.published}
        return sums | others | {f"rejected {field}": n for field, n in refused.items()}

    def __str__(self) -> str:
        fields = ", ".join(f"{field}: {n}" for field, n in self.rejected_by.most_common())
        rejected = f"rejected {self.rejected}" + (f" ({fields})" if fields else "")
        return f"received {self.received}, decoded {self.decoded}, {rejected}, late {self.late}"
