"""Cells of the grid and views: a target may begin wherever a sensor sees, and nowhere else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.tracking import undetected
from estimation.tracking.coverage import share_in_view
from estimation.tracking.scan import View
from estimation.tracking.undetected import Look, Region

REGION = Region((500.0, -700.0), 100_000.0, 20)  # cells of 10 km
SITE = np.array([1234.0, -5678.0])
VIEWS = [
    View(SITE, 0.0, 800.0),
    View(SITE, 200.0, 6_000.0),
    View(SITE, 200.0, 37_300.0),
    View(SITE, 30_000.0, 31_000.0),
    View(SITE, 0.0, 25_000.0, 6.0, 0.3),
    View(SITE, 500.0, 40_000.0, 1.0, 4.0),
    View(SITE, 0.0, 60_000.0, 0.0, 0.02),
]


def places_in(view: View, count: int = 2000) -> Array:
    rng = np.random.default_rng(3)
    far = np.sqrt(rng.uniform(view.range_min_m**2, view.range_max_m**2, count))
    bearing = view.start_rad + rng.uniform(0, view.width_rad, count)
    places: Array = SITE[:, None] + far * np.array([np.sin(bearing), np.cos(bearing)])
    return places


@pytest.mark.parametrize("view", VIEWS)
def test_whatever_is_in_view_may_begin_a_track(view: View) -> None:
    """However small the view, and to its very edge; out of reach of it nothing may."""
    share = share_in_view(view, REGION)
    look = Look(share, 0.9, np.zeros((2, 0)), 1e-9)
    now = undetected.first_looked(undetected.unseen(REGION), look)
    assert (undetected.density_at(now, places_in(view)) > 0).all()
    diagonal = 10_000.0 * math.sqrt(0.5)
    away = np.hypot(*(undetected.centres(REGION) - SITE[:, None, None]))
    assert not share[away > view.range_max_m + diagonal].any()


@pytest.mark.parametrize("view", VIEWS[2:3] + VIEWS[5:6])
def test_the_shares_make_up_the_area_of_a_view(view: View) -> None:
    """Views of many cells, to 3 %: the edges are sampled at points."""
    area = view.width_rad / 2 * (view.range_max_m**2 - view.range_min_m**2)
    covered = share_in_view(view, REGION).sum() * undetected.cell_area(REGION)
    assert covered == pytest.approx(area, rel=0.03)


def test_what_comes_into_view_later_is_as_dense_as_if_nobody_had_looked_beside_it() -> None:
    """A narrow view thins its own part of a cell; the rest of it is fresh to a wider view."""
    narrow, wide = (share_in_view(View(SITE, 0.0, far), REGION) for far in (1_000.0, 40_000.0))
    now = undetected.unseen(REGION)
    for _ in range(20):
        look = Look(narrow, 0.9, SITE[:, None], 0.0)
        now = undetected.thinned(undetected.first_looked(now, look), look)
    assert undetected.expected(now) < 1e-12
    after = undetected.first_looked(now, Look(wide, 0.9, places_in(VIEWS[2], 400), 0.0))
    here, there = undetected.density_at(after, np.stack([SITE, SITE + 25_000.0], axis=1))
    assert here == pytest.approx(there, rel=0.05)
