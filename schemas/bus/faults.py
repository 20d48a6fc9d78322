"""What may happen to a sample on its way, drawn by chance."""

from __future__ import annotations

from random import Random
from typing import NamedTuple

HELD_BACK_S = 0.01
"""How long a sample waits that others are to overtake."""


class Faults(NamedTuple):
    """What happens to samples on their way; what a session sends itself is spared.

    Attributes:
        loss: share of samples that do not arrive, drawn for each receiving process.
        duplicate: share of those that arrive twice.
        delay_s: least and greatest delay; samples with different ones overtake each other.
        reorder: share of those held back for `HELD_BACK_S` more.
        query_loss: share of questions that do not arrive; whoever asked waits in vain.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    delay_s: tuple[float, float] = (0.0, 0.0)
    reorder: float = 0.0
    query_loss: float = 0.0

    def delays_s(self, draw: Random) -> list[float]:
        """Delay of each copy of one sample that arrives; none when it is lost."""
        if draw.random() < self.loss:
            return []
        copies = 1 + (draw.random() < self.duplicate)
        return [
            draw.uniform(*self.delay_s) + HELD_BACK_S * (draw.random() < self.reorder)
            for _ in range(copies)
        ]


NO_FAULTS = Faults()
