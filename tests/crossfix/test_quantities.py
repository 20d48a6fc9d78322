"""Quantities as people read them: three digits that mean something, and never an exponent."""

from __future__ import annotations

from math import log10, nan, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crossfix.evaluation import FrameSummary
from crossfix.quantities import LEAST, degrees, metres, quantity, three_digits
from crossfix.table import print_frames


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


@pytest.mark.parametrize("columns", [40, 80])
def test_no_figure_of_the_table_is_cut_short_in_a_narrow_terminal(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    frame = FrameSummary(
        carrier="a-carrier-of-a-long-name",
        state="suspended",
        reason="",
        corrections=600,
        before_m=123456.0,
        after_m=12345.0,
        before_rad=0.5,
        after_rad=1.2e-4,
        fixed_before_m=654321.0,
        fixed_after_m=23456.0,
        sigma_m=34567.0,
        sigma_rad=2.3e-4,
        nees=1234.56,
        pairs=123.4,
    )
    print_frames([frame])
    shown = capsys.readouterr().out
    assert "…" not in shown
    assert all(
        figure in shown for figure in ("NEES/dim", "123456 m", "654321 m", "411.52", "34567 m")
    )
