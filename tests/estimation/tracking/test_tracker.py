"""Laws of the picture: what must not depend on what, and whether its probabilities are honest."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.tracking import arrival, ours, registered
from bench.tracking.scenes import Scene, Size, drawn
from bench.tracking.scoring import score
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import rotation_clockwise
from estimation.metrics import matched
from estimation.tracking import tracker
from estimation.tracking.imm import Motion
from estimation.tracking.innovations import Common
from estimation.tracking.marginals import by_assignment
from estimation.tracking.measurements import bearings, polar
from estimation.tracking.scan import Scan, View
from estimation.tracking.tracker import Picture, Settings, Shown, nothing, shown, step
from estimation.tracking.undetected import Region

BOX_M = 40_000.0
SETTINGS = Settings(region=Region((0.0, 0.0), BOX_M * 0.6, 12), lifetime_s=60.0)
SITES = np.array([[-15e3, -12e3], [16e3, -9e3], [1e3, 17e3]])
PERIOD_S = 1.0
DETECTION, CLUTTER = 0.9, 6.0  # false plots a scan
SIGMA_BEARING, SIGMA_RANGE = 0.003, 30.0


class World(NamedTuple):
    """Targets that move, appear and vanish as the tracker expects: (T, N, 4) and (T, N)."""

    states: Array
    alive: NDArray[np.bool_]


def world(
    rng: np.random.Generator, steps: int, targets: int, motion: Motion = SETTINGS.motion
) -> World:
    """Drawn from the tracker's own model."""
    total = targets + round(targets * steps * PERIOD_S / 60.0)
    place = rng.uniform(-BOX_M / 2, BOX_M / 2, (total, 2))
    state = np.column_stack([place, rng.normal(0, motion.sigma_speed_mps, (total, 2))])
    begins = np.where(np.arange(total) < targets, 0.0, rng.uniform(0, steps * PERIOD_S, total))
    ends = begins + rng.exponential(SETTINGS.lifetime_s, total)
    manoeuvres = rng.random(total) < motion.manoeuvring_s / (motion.manoeuvring_s + motion.quiet_s)
    states, parts = [], 4
    dt = PERIOD_S / parts
    for _ in range(steps):
        states.append(state.copy())
        for _ in range(parts):
            leave = dt / np.where(manoeuvres, motion.manoeuvring_s, motion.quiet_s)
            manoeuvres ^= rng.random(total) < leave
            q = np.where(manoeuvres, motion.manoeuvring, motion.quiet)[:, None]
            kick = rng.normal(0, 1, (total, 2)) * np.sqrt(q * dt)
            state[:, :2] += state[:, 2:] * dt + kick * dt / 2
            state[:, 2:] += kick
    now = np.arange(steps)[:, None] * PERIOD_S
    return World(np.array(states), (now >= begins) & (now < ends))


def scans(rng: np.random.Generator, given: World) -> list[Scan]:
    """A scan each step, the sensors in turn."""
    every = []
    for k, (state, alive) in enumerate(zip(given.states, given.alive, strict=True)):
        site = SITES[k % len(SITES)]
        hit = state[alive & (rng.random(len(state)) < DETECTION), :2]
        ghosts = rng.uniform(-BOX_M / 2, BOX_M / 2, (rng.poisson(CLUTTER), 2))
        noise = rng.normal(size=(2, len(hit))) * [[SIGMA_BEARING], [SIGMA_RANGE]]
        noise = np.pad(noise, ((0, 0), (0, len(ghosts))))
        away = np.concatenate([hit, ghosts]) - site
        plots = polar(
            site,
            np.arctan2(*away.T) + noise[0],
            np.hypot(*away.T) + noise[1],
            SIGMA_BEARING,
            SIGMA_RANGE,
        )
        every.append(
            Scan(round(k * PERIOD_S * 1e9), plots, View(site), DETECTION, CLUTTER / BOX_M**2)
        )
    return every


def tracked(given: list[Scan], settings: Settings = SETTINGS) -> list[Picture]:
    """The picture after each scan."""
    picture, every = nothing(settings, 0), []
    for scan in given:
        picture, _ = step(picture, scan, settings)
        every.append(picture)
    return every


def by_place(found: Shown) -> Shown:
    """In an order that names and plots have no part in."""
    order = np.lexsort(found.mean[:, :2].round().T)
    return Shown(*(part[order] for part in found))


def assert_alike(one: Shown, other: Shown) -> None:
    """The same tracks but for their names; messages converge to 1e-4."""
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


def normalised(seed: int, settings: Settings) -> Array:
    """NEES of the sure tracks of twenty targets, in a world that is as the tracker believes."""
    rng = np.random.default_rng(seed)
    given = world(rng, 90, 20, settings.motion)
    every = []
    for k, picture in enumerate(tracked(scans(rng, given), settings)[15:], 15):
        truth = given.states[k][given.alive[k]]
        found = shown(picture, settings._replace(confirmed=0.9))
        pairs = matched(truth[:, :2], found.mean[:, :2], 400.0)
        error = found.mean[pairs.estimate] - truth[pairs.truth]
        every.append(nees(error, found.covariance[pairs.estimate]))
    return np.concatenate(every)


@pytest.mark.parametrize(("manoeuvring", "tolerance"), [(1.0, 0.1), (100.0, 0.15)])
def test_covariances_are_honest(manoeuvring: float, tolerance: float) -> None:
    """Mean NEES / 4 of 2400 states. Errors last some ten scans, so it is good to 4 %; where targets
    manoeuvre a few surprises make half of the mean, and it is good to 7 %. Two sigmas each.
    """
    settings = SETTINGS._replace(motion=Motion(manoeuvring=manoeuvring))
    ratios = np.concatenate([normalised(seed, settings) for seed in (4, 5)])
    assert len(ratios) > 2000
    assert abs(ratios.mean() / 4 - 1) < tolerance


class Judged(NamedTuple):
    """Tracks of many pictures against the truth."""

    existence: Array  # of all tracks of some substance
    real: NDArray[np.bool_]


@pytest.fixture(scope="module")
def judged() -> Judged:
    """Of a long run in a world that is as the tracker believes."""
    rng = np.random.default_rng(4)
    given = world(rng, 90, 60)
    pictures = tracked(scans(rng, given))
    existence, real = [], []
    for k in range(15, 90):
        truth = given.states[k][given.alive[k]]
        found = shown(pictures[k], SETTINGS._replace(confirmed=0.02))
        pairs = matched(truth[:, :2], found.mean[:, :2], 400.0)
        existence.append(found.existence)
        real.append(np.isin(np.arange(len(found.mean)), pairs.estimate))
    return Judged(np.concatenate(existence), np.concatenate(real))


@pytest.mark.parametrize(("low", "high"), [(0.02, 0.2), (0.2, 0.8), (0.8, 0.99), (0.99, 1.0)])
def test_existence_is_as_probable_as_it_says(judged: Judged, low: float, high: float) -> None:
    """Share of real tracks against their mean probability, to 0.12 (some hundred in a bin, which
    hang together) and to 0.02 of the sure ones.
    """
    inside = (judged.existence >= low) & (judged.existence < high)
    assert inside.sum() > 50
    apart = abs(judged.real[inside].mean() - judged.existence[inside].mean())
    assert apart < (0.02 if low == 0.99 else 0.12)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return drawn(np.random.default_rng(5), Size(100, 70e3, 60))


def test_gospa_of_a_drawn_scene(scene: Scene) -> None:
    """A hundred targets at the density of the demands' 200: 900 m / sqrt 2, plus a tenth."""
    settings = ours.settings_for(scene)
    found = score(scene, ours.run(ours.scans_of(scene, scene.pose), settings))
    assert found.gospa_m < 700
    assert found.identity_changes <= 3
    assert found.count_rmse < 0.03
    simple = settings._replace(associate=by_assignment)
    assert score(scene, ours.run(ours.scans_of(scene, scene.pose), simple)).gospa_m < 800


def test_features_help_where_targets_are_close() -> None:
    scene = drawn(np.random.default_rng(6), Size(400, 15e3, 40))
    settings = ours.settings_for(scene)
    without = score(scene, ours.run(ours.scans_of(scene, scene.pose), settings))
    told = settings._replace(classes=(0.25,) * 4)
    found = score(scene, ours.run(ours.scans_of(scene, scene.pose, features=True), told))
    assert found.gospa_m < 0.95 * without.gospa_m
    assert found.identity_changes < without.identity_changes


def test_registered_poses_are_nearly_as_good_as_known_ones(scene: Scene) -> None:
    settings = ours.settings_for(scene)
    known = ours.run(ours.scans_of(scene, scene.pose), settings)
    given = list(registered.scans(scene, settings))
    assert len(given) > 50
    run = ours.run(given, settings)
    last = [
        np.searchsorted([s.t_ns for s in given], round(t * 1e9), "right") - 1 for t in scene.t_s
    ]
    every = run._replace(shown=tuple(run.shown[k] for k in last))
    assert score(scene, every, 30.0).gospa_m < 1.05 * score(scene, known, 30.0).gospa_m


def test_late_scans_give_the_same_bits(scene: Scene) -> None:
    settings = ours.settings_for(scene)
    cost = arrival.cost(ours.scans_of(scene, scene.pose), settings, 1, repeats=1)
    assert cost.identical
    assert cost.steps < 1.4


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
