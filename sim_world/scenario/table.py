"""What every table of a scenario file is made of: kinds of value, and no unknown keys."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from schemas.messages.values import Metres, Real

Degrees = Annotated[float, Meta(ge=-360, le=360)]
NonNegative = Annotated[float, Meta(ge=0, le=1e9)]
Positive = Annotated[float, Meta(gt=0, le=1e9)]
Speed = Annotated[float, Meta(ge=0, le=3e4)]
Point = tuple[Metres, Metres]
Interval = tuple[Real, Real]


class Table(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of a scenario file; a key it does not know is an error, not ignored."""
