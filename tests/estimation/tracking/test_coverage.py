"""Views: a target may begin wherever a sensor sees, and its track goes on to the very edge."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.tracking import tracker, undetected
from estimation.tracking.coverage import share_in_view
from estimation.tracking.measurements import polar
from estimation.tracking.scan import Scan, View
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


@pytest.mark.parametrize(("view", "far_m"), [(VIEWS[2], 37_250.0), (VIEWS[2], 260.0)])
def test_the_chance_of_a_target_at_the_edge_is_the_share_of_its_places_in_view(
    view: View, far_m: float
) -> None:
    """Against 20 000 draws (good to .007); the edge of a ring is straight over 60 m, to .02."""
    rng, root = np.random.default_rng(5), np.array([[60.0, 0.0], [25.0, 30.0]])
    place = SITE + far_m * np.array([0.6, 0.8])
    draws = place[:, None] + root @ rng.normal(size=(2, 20_000))
    chance = view.chance(place[:, None], (root @ root.T)[..., None])
    assert chance[0] == pytest.approx(view.holds(draws).mean(), abs=0.03)


def test_a_view_without_limits_is_as_sure_of_every_place_as_one_of_a_million_kilometres() -> None:
    places = np.random.default_rng(6).normal(0, 1e5, (2, 50))
    covariance = 1e6 * np.broadcast_to(np.eye(2)[..., None], (2, 2, 50))
    endless, vast = View(SITE), View(SITE, 0.0, 1e9)
    assert endless.everywhere
    assert not any(view.everywhere for view in (vast, *VIEWS))
    np.testing.assert_array_equal(
        endless.chance(places, covariance), vast.chance(places, covariance)
    )


def test_the_chance_falls_from_one_to_nothing_across_the_side_of_a_sector() -> None:
    view = View(np.zeros(2), 0.0, 50_000.0, 1.0, 0.6)
    bearing = np.array([1.3, 1.02, 1.6, 1.61, 0.98, 2.5, 1.3 + np.pi])
    places = 10_000.0 * np.array([np.sin(bearing), np.cos(bearing)])
    covariance = 100.0**2 * np.broadcast_to(np.eye(2)[..., None], (2, 2, len(bearing)))
    chance = view.chance(places, covariance)
    expected = [1.0, 0.977, 0.5, 0.159, 0.023, 0.0, 0.0]  # 200 m are two sigma
    np.testing.assert_allclose(chance, expected, atol=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_target_that_stays_at_the_edge_keeps_its_one_track(seed: int) -> None:
    """20 m within a range of 20 km that is measured to 100 m: half of its plots lie beyond."""
    rng, edge_m = np.random.default_rng(seed), 20_000.0
    view, settings = View(np.zeros(2), 0.0, edge_m), tracker.Settings()
    picture = tracker.nothing(settings, 0)
    shown = []
    for second in range(0, 240, 2):
        bearing = np.array([0.7 + 1e-4 * second])
        far = np.array([edge_m - 20.0])
        if rng.random() > 0.9:
            bearing = far = np.zeros(0)
        plots = polar(
            np.zeros(2),
            bearing + rng.normal(0, 4e-3, len(far)),
            far + rng.normal(0, 100.0, len(far)),
            np.full(len(far), 4e-3),
            np.full(len(far), 100.0),
        )
        scan = Scan(second * 10**9, plots, view, 0.9, 2 / (np.pi * edge_m**2))
        picture, _ = tracker.step(picture, scan, settings)
        shown.append(tracker.shown(picture, settings).identity.tolist())
    late = shown[len(shown) // 2 :]
    assert {len(tracks) for tracks in late} == {1}
    assert len({track for tracks in late for track in tracks}) == 1
