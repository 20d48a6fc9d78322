"""Targets nobody has seen yet: what the first scan, misses and time make of their number."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.tracking import undetected
from estimation.tracking.undetected import Look, Region

REGION = Region((1000.0, -2000.0), 10_000.0, 10)
ALL = np.ones((10, 10), dtype=bool)


def look(plots: int = 100, clutter: float = 0.0, detection: float = 0.9) -> Look:
    rng = np.random.default_rng(1)
    place = rng.uniform(-10_000, 10_000, (2, plots)) + np.array([[1000.0], [-2000.0]])
    return Look(ALL, detection, place, clutter)


def test_the_first_scan_sets_the_number_and_only_the_first() -> None:
    once = undetected.first_looked(undetected.unseen(REGION), look(100, 10 / 4e8))
    assert undetected.expected(once) == pytest.approx(90 / 0.9)
    assert undetected.first_looked(once, look(500)) is once


def test_a_look_leaves_the_share_it_misses_where_it_looked() -> None:
    half = look()._replace(visible=ALL & (np.arange(10) < 5)[:, None])
    before = undetected.first_looked(undetected.unseen(REGION), look())
    after = undetected.thinned(before, half)
    np.testing.assert_allclose(after.density[:5], before.density[:5] * 0.1)
    np.testing.assert_array_equal(after.density[5:], before.density[5:])


def test_an_empty_first_scan_expects_one_target() -> None:
    once = undetected.first_looked(undetected.unseen(REGION), look(0, 1e-6))
    assert undetected.expected(once) == pytest.approx(1.0)


def test_as_many_appear_as_vanish() -> None:
    """All targets undetected: their number stays; with none undetected, it grows to that share."""
    now = undetected.first_looked(undetected.unseen(REGION), look())
    number = undetected.expected(now)
    later = undetected.aged(now, 60.0, 600.0, number)
    assert undetected.expected(later) == pytest.approx(number)
    empty = now._replace(density=np.zeros((10, 10)))
    grown = undetected.expected(undetected.aged(empty, 60.0, 600.0, 50.0))
    assert grown == pytest.approx(50 * (1 - np.exp(-0.1)))


def test_places_find_their_cells_and_none_beyond_the_edge() -> None:
    cells = undetected.centres(REGION)
    now = undetected.unseen(REGION)._replace(density=np.arange(100.0).reshape(10, 10))
    np.testing.assert_array_equal(
        undetected.density_at(now, cells.reshape(2, -1)), np.arange(100.0)
    )
    beyond = np.array([[11_001.0, 1000.0, np.nan], [0.0, -12_001.0, 0.0]])[:, :2]
    np.testing.assert_array_equal(undetected.density_at(now, beyond), 0.0)


def test_what_no_track_stands_for_any_more_is_expected_where_it_was() -> None:
    now = undetected.first_looked(undetected.unseen(REGION), look())
    place = np.array([[2000.0, 2100.0, 50_000.0], [500.0, 400.0, 0.0]])
    after = undetected.returned(now, place, np.array([0.5, 0.25, 0.9]))
    cell = undetected.cell_area(REGION)
    gained = (undetected.density_at(after, place) - undetected.density_at(now, place)) * cell
    np.testing.assert_allclose(gained, [0.75, 0.75, 0.0], atol=1e-9)
    assert undetected.expected(after) == pytest.approx(undetected.expected(now) + 0.75)


def test_a_place_is_vague_when_it_fills_a_cell() -> None:
    """Evenly in a cell of 2 km is a sigma of 2000 / sqrt(12) = 577 m along each axis."""
    sigma = np.array([570.0, 585.0])
    long_axis = sigma**2 * np.array([[1.0, 0.0], [0.0, 0.01]])[..., None]
    assert undetected.vague(REGION, long_axis).tolist() == [False, True]
