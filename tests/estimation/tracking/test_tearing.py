"""Tracks whose hypotheses lie far apart: what is torn, what it becomes, what stays as it was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from bench.tracking import ours
from bench.tracking.scenes import Size, drawn
from bench.tracking.scoring import score
from estimation.arrays import Array
from estimation.object_count import object_count
from estimation.tracking import imm, tracker
from estimation.tracking.imm import Bank, Motion
from estimation.tracking.measurements import polar
from estimation.tracking.scan import Scan, View
from estimation.tracking.tearing import leading, without
from estimation.tracking.tracker import Picture, Settings, nothing, shown, step
from estimation.tracking.undetected import Region, expected
from tests.estimation.tracking.states import some_bank

FAR_M = 500e3
SETTINGS = Settings(region=Region(half_m=800e3))


def mixed(first: Bank, second: Bank, share: Array) -> Bank:
    """Moments of two banks, model by model, the first having a share (n,)."""
    weights = first.model * share, second.model * (1 - share)
    model = weights[0] + weights[1]
    given = [weight / model for weight in weights]
    mean = first.mean * given[0] + second.mean * given[1]
    covariance = np.zeros_like(first.covariance)
    for part, weight in zip((first, second), given, strict=True):
        away = part.mean - mean
        covariance += weight * (part.covariance + away[:, None] * away)
    shared = first.shared * given[0] + second.shared * given[1]
    return Bank(mean, covariance, model, shared)


def test_what_is_taken_out_of_a_fold_leaves_what_it_was_folded_with() -> None:
    rng = np.random.default_rng(1)
    part, rest = (
        some_bank(rng, 50)._replace(shared=rng.normal(size=(4, 3, 2, 50))) for _ in range(2)
    )
    share = rng.uniform(0.5, 0.95, 50)
    found = without(mixed(part, rest, share), part, share)
    np.testing.assert_allclose(found.mean, rest.mean, rtol=1e-7, atol=1e-5)
    np.testing.assert_allclose(found.covariance, rest.covariance, rtol=1e-5, atol=1e-2)
    np.testing.assert_allclose(found.model, rest.model, rtol=1e-9)
    np.testing.assert_allclose(found.shared, rest.shared, rtol=1e-7, atol=1e-7)


def test_a_model_that_is_all_of_the_part_leaves_nothing_absurd() -> None:
    rng = np.random.default_rng(2)
    part, rest = some_bank(rng, 20), some_bank(rng, 20)
    rest = rest._replace(model=np.stack([np.ones(20), np.zeros(20)]))
    share = np.full(20, 0.9)
    found = without(mixed(part, rest, share), part, share)
    np.testing.assert_array_equal(found.model, rest.model)
    matrices = np.moveaxis(found.covariance, (0, 1), (-2, -1))
    assert (np.linalg.eigvalsh(matrices) > -1e-6).all()


def test_the_likeliest_pair_leads_if_it_stands_by_itself() -> None:
    """By more than all others together, or by being likelier than a quarter to be a target."""
    track = np.array([0, 0, 0, 1, 1, 2, 3, 4, 4])
    share = np.array([0.3, 0.4, 0.26, 0.45, 0.4, 0.6, 0.995, 0.3, 0.3])
    existence = np.array([1.0, 0.3, 0.02, 1.0, 1.0])
    found = leading(track, share, existence)
    assert found.tolist() == [1, 5, 7]  # never two of one track


@dataclass(frozen=True)
class Crossing:
    """A target in a large ellipse, and another plot in it a little farther off."""

    before: Picture
    scan: Scan
    true_m: Array


@pytest.fixture(scope="module")
def crossing() -> Crossing:
    """Far to the south a sensor has seen the target once; one far to the west sees it, and a plot
    1.5 km (a sigma and more of the first bearing) from it.
    """
    south, west = np.array([0.0, -FAR_M]), np.array([-FAR_M, 0.0])
    true = np.array([0.0, 0.0])
    picture = nothing(SETTINGS, 0)
    plots = polar(south, np.zeros(1), np.array([FAR_M]), 0.0026, 30.0)
    picture, _ = step(picture, Scan(0, plots, View(south), 0.9, 1e-13), SETTINGS)
    away = np.array([[0.0, 0.0], [1500.0, 0.0]]) - west
    plots = polar(west, np.arctan2(*away.T), np.hypot(*away.T), 0.0026, 30.0)
    return Crossing(picture, Scan(10**9, plots, View(west), 0.9, 1e-9), true)


def widest(picture: Picture, row: int) -> float:
    _, covariance = imm.combined(picture.tracks.bank)
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2, row])[-1]))


def test_the_likelier_hypothesis_keeps_the_name_and_is_as_narrow_as_if_it_were_sure(
    crossing: Crossing,
) -> None:
    after, told = step(crossing.before, crossing.scan, SETTINGS)
    share = told.probability[told.identity == 0]
    assert 0.5 < share.max() < 0.95
    row = int(np.flatnonzero(after.tracks.identity == 0)[0])
    assert after.tracks.existence[row] == pytest.approx(share.max(), abs=1e-6)
    assert widest(after, row) < 250.0  # the ranges cross; a second at an unknown velocity
    mean = imm.combined(after.tracks.bank)[0][:2, row]
    assert np.hypot(*(mean - crossing.true_m)) < 50.0


def test_what_is_left_is_another_track_with_what_existence_is_left(crossing: Crossing) -> None:
    after, told = step(crossing.before, crossing.scan, SETTINGS)
    known = set(told.identity) | set(told.begun)
    (rest,) = [k for k, name in enumerate(after.tracks.identity) if name not in known]
    assert after.tracks.identity[rest] == after.begun - 1
    share = told.probability[told.identity == 0]
    assert after.tracks.existence[rest] == pytest.approx(share.min(), abs=0.05)
    assert abs(imm.combined(after.tracks.bank)[0][0, rest]) == pytest.approx(1500.0, rel=0.2)


def test_tearing_leaves_the_picture_before_as_it_was(crossing: Crossing) -> None:
    tracks = crossing.before.tracks
    parts = (*tracks.bank, tracks.existence, tracks.classes)
    copies = [part.copy() for part in parts]
    after, _ = step(crossing.before, crossing.scan, SETTINGS)
    assert len(after.tracks.identity) > len(tracks.identity)
    for part, copy in zip(parts, copies, strict=True):
        np.testing.assert_array_equal(part, copy)


def test_tearing_neither_makes_nor_unmakes_targets(
    crossing: Crossing, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Faint rests too: they go back to the undetected."""
    numbers = []
    for most, faint in ((0.0, 0.1), (0.99, 0.1), (0.99, 0.9)):
        monkeypatch.setattr("estimation.tracking.tearing._ALL", most)
        monkeypatch.setattr(tracker, "_FAINT", faint)
        after, _ = step(crossing.before, crossing.scan, SETTINGS)
        numbers.append((len(after.tracks.identity), tracker.number(after).mean))
    assert numbers[1][0] == numbers[0][0] + 1
    assert numbers[2][0] == numbers[0][0]
    np.testing.assert_allclose([mean for _, mean in numbers], numbers[0][1], rtol=1e-9)


@pytest.mark.slow
def test_a_crowd_seen_from_far_is_told_apart_sooner(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bearings as blunt, by the distances between targets, as from 500 km: eight plots an ellipse,
    which is yet no arc.
    """
    size = Size(2500, 158e3, 21, sigma_bearing_rad=0.0164)
    scene = drawn(np.random.default_rng(3), size)
    found = []
    for most in (0.99, 0.0):
        monkeypatch.setattr("estimation.tracking.tearing._ALL", most)
        run = ours.run(ours.scans_of(scene, scene.pose), ours.settings_for(scene))
        found.append(score(scene, run).gospa_m)
    assert found[0] < 0.9 * found[1]


def test_a_track_that_is_not_torn_is_the_fold(crossing: Crossing) -> None:
    """The two plots seen from near: both are in one small ellipse, and one Gaussian holds them."""
    site = np.array([0.0, -10e3])
    settings = SETTINGS._replace(region=Region(half_m=30e3), motion=Motion())
    picture = nothing(settings, 0)
    for second in range(3):
        bearing = np.array([0.0, 0.005])[: 1 + (second == 2)]
        plots = polar(site, bearing, np.full(len(bearing), 10e3), 0.0026, 30.0)
        picture, told = step(picture, Scan(second * 10**9, plots, View(site), 0.9, 1e-9), settings)
    share = told.probability[told.identity == 0]
    assert 0.5 < share.max() < 0.99
    assert set(picture.tracks.identity) <= set(told.identity) | set(told.begun)
    assert len(shown(picture, settings).identity) >= 1
    assert object_count(picture.tracks.existence, expected(picture.undetected)).mean > 1.0
