"""Quantities as people read them: a number with its unit; what is not known is a dash."""

from __future__ import annotations

from math import degrees as degrees_of
from math import isnan

UNKNOWN = "-"
LEAST = 1e-4
"""Below this an error is none: of a frame that is known, say."""


def quantity(value: float | None, form: str, unit: str = "") -> str:
    """A number in a format, with its unit."""
    return UNKNOWN if value is None or isnan(value) else f"{value:{form}}{unit}"


def three_digits(value: float | None, unit: str = "") -> str:
    """Three significant digits, or all before the point; never an exponent."""
    if value is None or isnan(value):
        return UNKNOWN
    size = abs(value)
    form = ".0f" if size < LEAST or size >= 100 else "#.3g"
    return f"{value:{form}}{unit}"


def metres(value: float | None) -> str:
    """A length."""
    return three_digits(value, " m")


def degrees(radians: float | None, unit: str = "°") -> str:
    """An angle."""
    return three_digits(None if radians is None else degrees_of(radians), unit)


def seconds(value: float | None) -> str:
    """An instant or a span."""
    return quantity(value, ".4g", " s")
