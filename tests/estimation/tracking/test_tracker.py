"""Laws of the picture: what must not depend on what."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bench.tracking import arrival
from estimation.arrays import Array
from estimation.frames import rotation_clockwise
from estimation.metrics import matched
from estimation.tracking import tracker
from estimation.tracking.imm import Motion
from estimation.tracking.innovations import Common
from estimation.tracking.measurements import bearings, polar
from estimation.tracking.scan import Scan, View
from estimation.tracking.tracker import Settings, Shown, nothing, shown, step
from tests.estimation.tracking.worlds import (
    BOX_M,
    CLUTTER,
    SETTINGS,
    SIGMA_BEARING,
    SIGMA_RANGE,
    SITES,
    scans,
    tracked,
    world,
)


def by_place(found: Shown) -> Shown:
    """In an order that names and plots have no part in."""
    order = np.lexsort(found.mean[:, :2].round().T)
    return Shown(*(part[order] for part in found))


def assert_alike(one: Shown, other: Shown) -> None:
    """The same tracks but for their names; messages are good to 1e-3."""
    one, other = by_place(one), by_place(other)
    assert len(one.mean) == len(other.mean)
    np.testing.assert_allclose(one.mean, other.mean, atol=0.5)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-2, atol=1.0)
    np.testing.assert_allclose(one.existence, other.existence, atol=1e-3)


@pytest.fixture(scope="module")
def small() -> list[Scan]:
    rng = np.random.default_rng(1)
    return scans(rng, world(rng, 15, 25))


def changed(given: Scan, change: Callable[[Array], Array], turn_rad: float = 0.0) -> Scan:
    """The same scan elsewhere."""
    site = change(given.plots.site_m)  # type: ignore[attr-defined]
    plots = given.plots._replace(  # type: ignore[attr-defined]
        site_m=site,
        bearing_rad=given.plots.bearing_rad + turn_rad,  # type: ignore[attr-defined]
    )
    return given._replace(plots=plots, view=given.view._replace(site_m=site))


def test_the_order_of_plots_does_not_matter(small: list[Scan]) -> None:
    rng = np.random.default_rng(2)
    shuffled = []
    for scan in small:
        order = rng.permutation(scan.plots.size)
        columns = [part[order] for part in scan.plots[1:-1]]  # type: ignore[index]
        shuffled.append(scan._replace(plots=polar(scan.view.site_m, *columns)))
    assert_alike(shown(tracked(small)[-1], SETTINGS), shown(tracked(shuffled)[-1], SETTINGS))


def test_turning_the_scene_turns_the_tracks(small: list[Scan]) -> None:
    """By a right angle, which takes the square of the region into itself."""
    turn = rotation_clockwise(np.pi / 2)
    turned = [changed(scan, lambda p: turn @ p, np.pi / 2) for scan in small]
    there = shown(tracked(small)[-1], SETTINGS)
    four = np.kron(np.eye(2), turn)
    there = there._replace(mean=there.mean @ four.T, covariance=four @ there.covariance @ four.T)
    assert_alike(there, shown(tracked(turned)[-1], SETTINGS))


def test_moving_the_scene_moves_the_tracks(small: list[Scan]) -> None:
    way = np.array([7e5, -3e5])
    settings = SETTINGS._replace(region=SETTINGS.region._replace(centre_m=(7e5, -3e5)))
    moved = [changed(scan, lambda p: p + way) for scan in small]
    there = shown(tracked(small)[-1], SETTINGS)
    there = there._replace(mean=there.mean + np.pad(way, (0, 2)))
    assert_alike(there, shown(tracked(moved, settings)[-1], settings))


def test_the_same_scans_give_the_same_bits(small: list[Scan]) -> None:
    assert arrival.same(tracked(small)[-1], tracked(small)[-1])


def test_a_step_leaves_what_it_was_given(small: list[Scan]) -> None:
    before = tracked(small[:-1])[-1]
    copies = [part.copy() for part in before.tracks.bank]
    step(before, small[-1], SETTINGS)
    for part, copy in zip(before.tracks.bank, copies, strict=True):
        np.testing.assert_array_equal(part, copy)


def test_identities_are_never_used_twice(small: list[Scan]) -> None:
    pictures = tracked(small)
    last_seen: dict[int, int] = {}
    for k, picture in enumerate(pictures):
        names = picture.tracks.identity.tolist()
        assert len(set(names)) == len(names)
        assert all(last_seen.get(name, k - 1) == k - 1 for name in names if name in last_seen)
        last_seen |= dict.fromkeys(names, k)


def test_a_picture_does_not_go_back(small: list[Scan]) -> None:
    picture = tracked(small[:3])[-1]
    with pytest.raises(ValueError, match="cannot go back"):
        step(picture, small[0], SETTINGS)


def test_what_no_sensor_looks_at_lives_on(small: list[Scan]) -> None:
    """Twenty looks the other way: a track fades as its lifetime says, and no faster."""
    before = tracked(small)[-1]
    picture = before
    site = np.array([0.0, 10 * BOX_M])
    away = View(site, 0.0, 1000.0)
    none = polar(site, np.empty(0), np.empty(0), SIGMA_BEARING, SIGMA_RANGE)
    for k in range(20):
        t_ns = before.t_ns + round((k + 1) * 1e8)
        picture, _ = step(picture, Scan(t_ns, none, away, 0.9, 1e-9), SETTINGS)
    sure = shown(before, SETTINGS).existence > 0.9
    fade = np.exp(-2.0 / SETTINGS.lifetime_s)
    np.testing.assert_allclose(
        shown(picture, SETTINGS).existence[:5], shown(before, SETTINGS).existence[:5] * fade
    )
    assert sure.sum() >= 15


def test_a_target_that_is_gone_is_given_up_in_a_few_looks(small: list[Scan]) -> None:
    picture = tracked(small)[-1]
    for k in range(4):
        site = SITES[k % 3]
        none = polar(site, np.empty(0), np.empty(0), SIGMA_BEARING, SIGMA_RANGE)
        scan = Scan(picture.t_ns + 10**8, none, View(site), 0.9, 1e-9)
        picture, _ = step(picture, scan, SETTINGS)
    assert not len(shown(picture, SETTINGS).identity)


def test_bearings_alone_sharpen_tracks_and_begin_none(small: list[Scan]) -> None:
    rng = np.random.default_rng(3)
    picture = tracked(small)[-1]
    before = shown(picture, SETTINGS)
    site = np.array([0.0, -30e3])
    bearing = np.arctan2(*(before.mean[:, :2] - site).T) + rng.normal(0, 1e-4, len(before.mean))
    scan = Scan(picture.t_ns, bearings(site, bearing, 1e-4), View(site), 1.0, 1e-3)
    after, told = step(picture, scan, SETTINGS)
    assert (told.begun == -1).all()
    assert set(after.tracks.identity) <= set(picture.tracks.identity)
    now = shown(after, SETTINGS)
    kept = np.isin(before.identity, now.identity)
    areas = [np.sqrt(np.linalg.det(found.covariance[:, :2, :2])) for found in (before, now)]
    assert np.median(areas[1][: kept.sum()] / areas[0][kept]) < 0.7


def test_a_term_for_pairs_decides_between_equal_ones() -> None:
    """Two targets side by side, a plot between them; the term says whose it is."""
    region = SETTINGS._replace(pruned=1e-6)
    site = np.zeros(2)
    picture = nothing(region, 0)
    for k in range(3):
        plots = polar(site, np.array([0.100, 0.104]), np.full(2, 10e3), 0.002, 30.0)
        picture, _ = step(picture, Scan(k * 10**9, plots, View(site), 0.9, 1e-10), region)
    middle = polar(site, np.array([0.102]), np.array([10e3]), 0.002, 30.0)
    scan = Scan(3 * 10**9, middle, View(site), 0.9, 1e-10)
    for favoured in (0, 1):
        _, told = step(
            picture,
            scan,
            region,
            lambda track, _, f=favoured: np.where(track == f, 3.0, -3.0),  # type: ignore[misc]
        )
        best = told.identity[np.argmax(told.probability)]
        assert best == picture.tracks.identity[favoured]


def test_a_common_error_widens_and_is_not_blamed_on_tracks(small: list[Scan]) -> None:
    """A scan displaced by 200 m, said to be uncertain by that: taken in, the tracks hardly move."""
    before = tracked(small[:-1])[-1]
    scan = small[-1]
    moved = changed(scan, lambda p: p + np.array([200.0, 0.0]))
    common = Common(np.diag([200.0, 200.0, 1e-4]) ** 2, moved.view.site_m)
    honest, _ = step(before, moved._replace(common=common), SETTINGS)
    naive, _ = step(before, moved, SETTINGS)
    right, _ = step(before, scan, SETTINGS)
    reference = shown(right, SETTINGS)
    errors = []
    for picture in (honest, naive):
        found = shown(picture, SETTINGS)
        pairs = matched(reference.mean[:, :2], found.mean[:, :2], 1000.0)
        errors.append(pairs.distance.mean() + 500.0 * (len(reference.mean) - len(pairs.truth)))
    assert errors[0] < 0.5 * errors[1]


def test_a_sensor_that_claims_to_be_perfect_is_taken_with_a_grain_of_salt(
    small: list[Scan],
) -> None:
    """Detection 1 and no clutter, both untrue: nothing infinite, and most targets are found."""
    perfect = [scan._replace(detection=1.0, clutter=0.0) for scan in small]
    pictures = tracked(perfect)
    for picture in pictures:
        tracks = picture.tracks
        assert all(np.isfinite(part).all() for part in (tracks.existence, *tracks.bank))
        assert ((tracks.existence >= 0) & (tracks.existence <= 1)).all()
    honest = shown(tracked(small)[-1], SETTINGS)
    found = shown(pictures[-1], SETTINGS)
    near = matched(honest.mean[:, :2], found.mean[:, :2], 300.0)
    assert len(near.truth) >= 0.8 * len(honest.mean)


def test_a_plot_that_is_no_number_changes_nothing(small: list[Scan]) -> None:
    marred = []
    for scan in small:
        columns = [np.append(part, part[0]) for part in scan.plots[1:-1]]  # type: ignore[index]
        columns[1][-1] = np.nan
        marred.append(scan._replace(plots=polar(scan.view.site_m, *columns)))
    assert_alike(shown(tracked(small)[-1], SETTINGS), shown(tracked(marred)[-1], SETTINGS))


def test_ten_times_the_declared_clutter_is_survived() -> None:
    """The picture fills with false tracks, but stays bounded, and the targets are in it."""
    rng = np.random.default_rng(7)
    given = world(rng, 20, 20)
    flood = []
    for scan in scans(rng, given):
        ghosts = rng.uniform(-BOX_M / 2, BOX_M / 2, (round(10 * CLUTTER), 2)) - scan.view.site_m
        bearing, far, *_ = scan.plots[1:]  # type: ignore[index]
        plots = polar(
            scan.view.site_m,
            np.append(bearing, np.arctan2(*ghosts.T)),
            np.append(far, np.hypot(*ghosts.T)),
            SIGMA_BEARING,
            SIGMA_RANGE,
        )
        flood.append(scan._replace(plots=plots))
    pictures = tracked(flood)
    assert max(len(picture.tracks.identity) for picture in pictures) < 1000
    truth = given.states[-1][given.alive[-1], :2]
    found = shown(pictures[-1], SETTINGS)
    assert len(matched(truth, found.mean[:, :2], 300.0).truth) >= 0.8 * len(truth)
    assert len(found.mean) < 3 * len(truth)


def test_settings_are_the_documented_defaults() -> None:
    assert Settings().motion == Motion()
    assert tracker.number(nothing(Settings(), 0)).mean == 0.0


def test_a_track_out_of_view_is_given_back_when_nothing_more_is_known_of_it() -> None:
    """It is not shown for ever somewhere in a circle of kilometres, yet its target still counts."""
    site, gone = SITES[0], View(SITES[0], 0.0, 1.0)
    nobody = polar(site, np.empty(0), np.empty(0), 0.003, 30.0)
    plots = polar(site, np.array([0.5]), np.array([8_000.0]), 0.003, 30.0)
    picture = nothing(SETTINGS, 0)
    for k in range(6):
        picture, _ = step(picture, Scan(k * 10**9, plots, View(site), 0.9, 1e-9), SETTINGS)
    assert len(shown(picture, SETTINGS).mean) == 1
    before = tracker.number(picture).mean
    for k in range(6, 200):
        blind = Scan(k * 10**9, nobody, gone, 0.9, 1e-9)
        picture, _ = step(picture, blind, SETTINGS)
    assert not len(picture.tracks.identity)
    assert tracker.number(picture).mean == pytest.approx(before, rel=0.1)
