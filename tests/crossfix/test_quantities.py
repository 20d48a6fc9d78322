"""Quantities as people read them: three digits that mean something, and never an exponent."""

from __future__ import annotations

from math import log10, nan, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crossfix.quantities import LEAST, degrees, metres, quantity, three_digits


@given(st.floats(LEAST, 1e7))
def test_what_is_read_is_what_was_meant_to_three_digits(value: float) -> None:
    text = three_digits(value)
    assert "e" not in text
    digits = max(0, 2 - int(log10(value) // 1))
    assert float(text) == pytest.approx(value, abs=0.5 * 10.0**-digits * 1.001)
    assert three_digits(-value) == f"-{text}"


@pytest.mark.parametrize("unknown", [None, nan])
def test_what_is_not_known_is_a_dash(unknown: float | None) -> None:
    assert {three_digits(unknown), metres(unknown), degrees(unknown), quantity(unknown, ".1f")} == {
        "-"
    }


def test_what_is_as_good_as_nothing_is_nothing() -> None:
    assert metres(LEAST / 2) == "0 m"


def test_units_follow_their_number() -> None:
    assert metres(5.1234) == "5.12 m"
    assert metres(1756.4) == "1756 m"
    assert degrees(radians(1.81)) == "1.81°"
    assert degrees(radians(0.0226), " deg") == "0.0226 deg"
