"""Figures of all differences of one field."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from crossfix.differences.fields import FieldChange


class FieldSummary(NamedTuple):
    """All differences of one field over the messages of a channel.

    Attributes:
        field: path without indices; values: how many differ; messages: in how many.
        greatest, mean, rms: of after less before, where both are numbers; else nan.
        relative: greatest difference by the larger value.
        unlike: values that are not both numbers: texts, or there on one side only.
        before, after: the first such pair of values.
    """

    channel: str
    field: str
    values: int
    messages: int
    greatest: float
    mean: float
    rms: float
    relative: float
    unlike: int
    before: Any
    after: Any


class FieldFigures:
    """Running figures of one field."""

    def __init__(self) -> None:
        self._count = self._messages = self._unlike = 0
        self._numbers, self._sum, self._squares = 0, 0.0, 0.0
        self._greatest = self._relative = 0.0
        self._example: FieldChange | None = None

    def take(self, found: Sequence[FieldChange]) -> None:
        """The differences of one message in this field."""
        self._messages += 1
        self._count += len(found)
        self._example = self._example or found[0]
        for change in found:
            size = change.size
            if size is None:
                self._unlike += 1
                continue
            larger = max(abs(change.before), abs(change.after))
            self._numbers += 1
            self._sum += size
            self._squares += size * size
            self._greatest = max(self._greatest, abs(size), key=abs)
            self._relative = max(self._relative, abs(size) / larger if larger else 0.0)

    def summary(self, channel: str, field: str) -> FieldSummary:
        """The figures."""
        assert self._example is not None  # noqa: S101 (made with its first difference)
        n = self._numbers
        return FieldSummary(
            channel=channel,
            field=field,
            values=self._count,
            messages=self._messages,
            greatest=self._greatest if n else math.nan,
            mean=self._sum / n if n else math.nan,
            rms=math.sqrt(self._squares / n) if n else math.nan,
            relative=self._relative if n else math.nan,
            unlike=self._unlike,
            before=self._example.before,
            after=self._example.after,
        )
