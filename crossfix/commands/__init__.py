"""The verbs of the command line, one a module; `crossfix.__main__` lists them.

Here is what they share: the types of their options, refused at the edge when they mean nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Annotated, Literal

from cyclopts import Parameter

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where processes that are started by hand meet, unless told otherwise."""

HUB_TIMEOUT = 120.0
"""Seconds that a hub may be away: one that was only started anew is back within a few."""


def _above_zero(_: object, value: float | None) -> None:
    if value is not None and not 0 < value < inf:
        raise ValueError("Expected a number above 0.")


def _not_negative(_: object, value: float | None) -> None:
    if value is not None and not 0 <= value < inf:
        raise ValueError("Expected a number, 0 or above.")


def _rate(_: object, value: str | float) -> None:
    try:
        good = value == "max" or 0 < float(value) < inf
    except ValueError:
        good = False
    if not good:
        raise ValueError("Expected max or a number above 0.")


def _id(_: object, value: str | None) -> None:
    from schemas.errors import WireError
    from schemas.keys import require_id

    if value is None:
        return
    try:
        require_id(value)
    except WireError as error:
        raise ValueError(f"Expected {error.expected}.") from None


def _keys(_: object, value: tuple[str, ...]) -> None:
    from difflib import get_close_matches

    from schemas.keys import TOPICS

    known = sorted({topic.template.partition("/")[0] for topic in TOPICS})
    for pattern in value:
        first = pattern.partition("/")[0]
        if "*" not in first and first not in known:
            meant = get_close_matches(first, known, n=1) or known
            raise ValueError(f"Expected keys that begin with {', '.join(meant)}.")


Timeout = Annotated[float, Parameter(validator=_above_zero)]
"""Seconds, above 0."""
Sigma = Annotated[float, Parameter(validator=_above_zero)]
"""One sigma, above 0."""
Seconds = Annotated[float, Parameter(validator=_not_negative)]
"""Seconds, 0 or above."""
Count = Annotated[int, Parameter(validator=_above_zero)]
"""How many, at least 1."""
Megabytes = Annotated[float, Parameter(validator=_not_negative)]
"""Size of files, 0 or above."""
Rate = Annotated[str, Parameter(validator=_rate)]
"""`max`, or a multiple of real time."""
Name = Annotated[str, Parameter(validator=_id)]
"""Of a run, a carrier, a process: an id of the wire."""


Keys = Annotated[tuple[str, ...], Parameter(negative=(), validator=_keys)]
"""Patterns of keys after the run, such as `report/**`, of topics that there are."""


@Parameter(name="*")
@dataclass(frozen=True)
class FileOptions:
    """How the recording lies on the disk.

    Attributes:
        fsync: when to wait for the disk: `flush` lets lost power cost no more than a crash.
        split_size: megabytes after which a new part is begun, that can be read alone.
        split_time: seconds of log time after which a new part is begun.
        keep: parts that are kept; older ones are deleted.
        min_free: megabytes to leave on the disk: old parts make room, else the recording ends.
    """

    fsync: Literal["none", "flush", "end"] = "none"
    split_size: Megabytes = 0.0
    split_time: Seconds = 0.0
    keep: Annotated[Count | None, Parameter(negative=())] = None
    min_free: Megabytes = 0.0

    @property
    def splits(self) -> bool:
        """Whether there will be parts."""
        return bool(self.split_size or self.split_time)

    def arguments(self) -> list[str]:
        """The same for `python -m fusion_center`."""
        self.require()
        keep = [] if self.keep is None else ["--keep", str(self.keep)]
        sizes = ["--split-size", str(self.split_size), "--min-free", str(self.min_free)]
        return ["--fsync", self.fsync, *sizes, "--split-time", str(self.split_time), *keep]

    def require(self) -> None:
        """Refuse what contradicts itself.

        Raises:
            CrossfixError: parts are to be kept, but there are none.
        """
        if self.keep and not self.splits:
            from schemas.errors import CrossfixError

            raise CrossfixError("--keep", expected="--split-size or --split-time with it")


FILES = FileOptions()
