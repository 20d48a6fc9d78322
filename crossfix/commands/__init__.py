"""The verbs of the command line, one a module; `crossfix.__main__` lists them.

Here is what they share: the types of their options, refused at the edge when they mean nothing.
"""

from __future__ import annotations

from math import inf
from typing import Annotated

from cyclopts import Parameter

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where processes that are started by hand meet, unless told otherwise."""


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


Timeout = Annotated[float, Parameter(validator=_above_zero)]
"""Seconds, above 0."""
Sigma = Annotated[float, Parameter(validator=_above_zero)]
"""One sigma, above 0."""
Seconds = Annotated[float, Parameter(validator=_not_negative)]
"""Seconds, 0 or above."""
Count = Annotated[int, Parameter(validator=_above_zero)]
"""How many, at least 1."""
Rate = Annotated[str, Parameter(validator=_rate)]
"""`max`, or a multiple of real time."""
Name = Annotated[str, Parameter(validator=_id)]
"""Of a run, a carrier, a process: an id of the wire."""
