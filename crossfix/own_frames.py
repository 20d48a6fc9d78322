"""What carriers say, as they would without the corrections they have applied."""

from __future__ import annotations

from typing import TypeVar

from schemas.feedback import uncorrected
from schemas.messages import Input

T = TypeVar("T")


def as_own(message: T) -> T:
    """A message in the frame its carrier has of itself; one that hides it stays as it is."""
    if not isinstance(message, Input):
        return message
    try:
        own = uncorrected(message)
    except ValueError:
        return message
    assert isinstance(own, type(message))  # noqa: S101 (of the same type)
    return own
