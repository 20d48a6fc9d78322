"""One report event: who takes part, and what each sees."""

from __future__ import annotations

from typing import NamedTuple

from estimation.relative_frame import RelativeFramePrior
from estimation.relative_frame.range_errors import RangeErrors

from ..state import Frames
from .corrections import Poses
from .views import View


class Moment(NamedTuple):
    """Who takes part in a report event, and what they see.

    Attributes:
        names: of the other carriers that have reported and can be placed.
        own: the own carrier's tracks; others: those of the others along the axes of its plane.
        ranges: of each carrier, what is known by now of the range errors of each of its sources.
        between, prior: of each other carrier, by its navigation.
        frames: those that are followed, carried on to the instant.
    """

    t_ns: int
    names: tuple[str, ...]
    own: View
    others: dict[str, View]
    ranges: dict[str, dict[str, RangeErrors]]
    between: dict[str, Poses]
    prior: dict[str, RelativeFramePrior]
    frames: Frames | None
