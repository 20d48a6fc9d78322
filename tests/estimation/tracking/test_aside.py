"""Readings that hardly move a track: what they say of tracks that stand beside their targets."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.tracking import aside, tracker
from estimation.tracking.aside import elsewhere, heard, unheard
from estimation.tracking.imm import Bank, bare
from estimation.tracking.measurements import polar
from estimation.tracking.pairing import Paired, paired
from estimation.tracking.scan import Scan, View
from estimation.tracking.seeding import restated, seeded
from estimation.tracking.tracker import Settings, nothing, step
from estimation.tracking.undetected import Region, expected

FAR_M, SIGMA_BEARING, SIGMA_RANGE = 400e3, 0.0026, 30.0  # a sigma of 1040 m across
SITES = np.array([[-FAR_M, 0.0], [0.0, FAR_M], [FAR_M, 0.0]])
SETTINGS = Settings(region=Region(half_m=500e3))


def sharp(place_m: Array) -> Bank:
    """Tracks at rest at (n, 2), known to 20 m and 5 m/s."""
    mean = np.concatenate([place_m.T, np.zeros_like(place_m.T)])
    covariance = np.diag([20.0, 20.0, 5.0, 5.0]) ** 2
    n = len(place_m)
    spread = np.repeat(np.repeat(covariance[:, :, None, None], 2, axis=2), n, axis=3)
    return bare(np.repeat(mean[:, None], 2, axis=1), spread, np.tile([[0.9], [0.1]], n))


def scan_of(
    rng: np.random.Generator, k: int, place_m: Array, turned_rad: float = 0.0, blunter: float = 1.0
) -> Scan:
    """One carrier's plots of targets at (n, 2), in their order.

    Args:
        turned_rad: by this its bearings are off, the third carrier's the other way; blunter: times
            what is declared they are.
    """
    site = SITES[k % len(SITES)]
    away, n = place_m - site, len(place_m)
    bearing = np.arctan2(*away.T) + rng.normal(0, SIGMA_BEARING * blunter, n)
    bearing += turned_rad * (1, 1, -1)[k % len(SITES)]
    far = np.hypot(*away.T) + rng.normal(0, SIGMA_RANGE, n)
    plots = polar(site, bearing, far, SIGMA_BEARING, SIGMA_RANGE)
    return Scan(k * 10**9, plots, View(site), 0.9, 1e-12)


def own(bank: Bank, scan: Scan) -> Paired:
    """Each track with the plot of its own number."""
    pairs = paired(bank, scan, 1e4)
    return pairs.take(np.flatnonzero(pairs.track == pairs.plot))


def places(n: int, every_m: float = 300.0) -> Array:
    """In a row through the middle, which is the one of half their number."""
    along = np.arange(n) - n // 2
    return np.stack([along * every_m, along * every_m / 3], axis=-1)


def said_after(scans: int, off_m: Array, **errors: float) -> Array:
    """What is said of tracks `off_m` (n, 2) from their targets."""
    rng, truth = np.random.default_rng(1), places(len(off_m))
    bank, said = sharp(truth + off_m), unheard(len(off_m))
    for k in range(scans):
        scan = scan_of(rng, k, truth, **errors)
        said = heard(said, bank, scan, own(bank, scan))
    return said


@pytest.mark.parametrize("errors", [{}, {"turned_rad": 0.003}, {"blunter": 2.5}])
def test_a_track_of_one_target_is_not_doubted(errors: dict[str, float]) -> None:
    """Nor where all bearings are turned by more than their sigma, or blunter than declared."""
    said = said_after(40, np.zeros((100, 2)), **errors)
    assert said[-1].min() > 15
    assert elsewhere(said).sum() <= 1


def test_a_track_that_stands_aside_is_doubted_though_each_bearing_fits() -> None:
    """Ten of a hundred by 2 km, along which the ranges of two opposite carriers tell nothing."""
    off = np.zeros((100, 2))
    off[:10, 1] = 2000.0
    early, late = (elsewhere(said_after(scans, off)) for scans in (3, 36))
    assert early.sum() <= 1
    assert late[:10].sum() >= 9
    assert late[10:].sum() <= 1


def test_doubts_go_by_the_gain_of_the_best_fit_over_what_two_coordinates_cost() -> None:
    rng = np.random.default_rng(6)
    root, found = rng.normal(size=(500, 2, 4)) / 1000.0, rng.normal(size=(500, 2)) / 200.0
    information = root @ np.swapaxes(root, 1, 2)
    said = np.stack([*information[:, [0, 0, 1], [0, 1, 1]].T, *found.T, np.full(500, 15.0)])
    gain = (found * np.linalg.solve(information, found[..., None])[..., 0]).sum(axis=1) / 2
    doubted = gain * 15 / 16 - np.log(16) > np.log(1000)
    assert 50 < doubted.sum() < 450
    np.testing.assert_array_equal(elsewhere(said), doubted)


def test_readings_that_move_a_track_say_nothing_aside() -> None:
    """Its ranges; and its bearings before it is sharp."""
    rng, truth = np.random.default_rng(2), places(50)
    scan, plain = scan_of(rng, 0, truth), sharp(truth)
    said = heard(unheard(50), plain, scan, own(plain, scan))
    assert (said[-1] == 1).all()
    blunt = plain._replace(covariance=plain.covariance * 400.0)
    assert (heard(unheard(50), blunt, scan, own(blunt, scan)) == 0).all()


def test_a_bearing_from_the_west_tells_how_far_north_a_target_is() -> None:
    rng, truth = np.random.default_rng(3), places(40)
    bank, scan = sharp(truth), scan_of(rng, 0, truth)
    said = heard(unheard(40), bank, scan, own(bank, scan))
    sigma_m = np.hypot(*(truth - SITES[0]).T) * SIGMA_BEARING
    np.testing.assert_allclose(said[2], sigma_m**-2.0, rtol=0.02)
    assert (said[0] < 0.01 * said[2]).all()


def test_a_doubted_track_is_given_back_and_its_target_is_found_anew() -> None:
    """Wrong by 2 km across two opposite carriers, the plots of the third are another's."""
    rng = np.random.default_rng(4)
    picture = nothing(SETTINGS, 0)
    truth, third, wrong = places(60, 6000.0), places(60, 6000.0), 30
    third[wrong, 1] += 2000.0
    for place in third:
        state = np.array([*place, 0.0, 0.0])
        spread = np.diag([20.0, 20.0, 5.0, 5.0]) ** 2
        picture = seeded(picture, state, spread, 0.99, SETTINGS)
    for k in range(45):
        seen = third if k % 3 == 1 else truth
        picture, _ = step(picture, scan_of(rng, k, seen), SETTINGS)
    lost = np.setdiff1d(np.arange(60), picture.tracks.identity)
    assert lost.tolist() == [wrong]


def test_what_is_given_back_still_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """All tracks; those too faint to be kept as well."""
    rng, truth = np.random.default_rng(5), places(30)
    picture = nothing(SETTINGS, 0)
    for k in range(6):
        picture, _ = step(picture, scan_of(rng, k, truth), SETTINGS)
    scan = scan_of(rng, 6, truth)
    plain, _ = step(picture, scan, SETTINGS)
    monkeypatch.setattr(aside, "_DOUBT", -100.0)
    monkeypatch.setattr(aside, "_READINGS", 0)
    doubted, _ = step(picture, scan, SETTINGS)
    assert len(doubted.tracks.identity) < len(plain.tracks.identity)
    numbers = [tracker.number(each).mean for each in (plain, doubted)]
    assert numbers[1] == pytest.approx(numbers[0], rel=1e-4)
    assert expected(doubted.undetected) > expected(plain.undetected) + 20


def test_a_track_told_anew_is_not_held_to_what_was_said() -> None:
    picture = seeded(nothing(SETTINGS, 0), np.zeros(4), np.eye(4), 0.9, SETTINGS)
    loud = picture.tracks._replace(aside=np.full((6, 1), 9.0))
    after = restated(picture._replace(tracks=loud), 0, np.ones(4), np.eye(4))
    np.testing.assert_array_equal(after.tracks.aside, 0.0)
