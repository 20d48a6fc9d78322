"""What features are worth, and what is known of them after: against Bayes done the long way."""

from __future__ import annotations

import numpy as np
import pytest

from bench.tracking import arrival
from estimation.arrays import Array
from estimation.tracking import features
from estimation.tracking.features import WRONG, Features, Layout, Said, unknown
from estimation.tracking.measurements import places
from estimation.tracking.scan import Scan, View
from estimation.tracking.tracker import Association, Picture, nothing, step
from tests.estimation.tracking.worlds import SETTINGS

LAYOUT, WIDTH = Layout(1, (3,)), np.array([100.0])
CONFUSION = np.array([[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])
FIRST = np.zeros(1, dtype=np.intp)


def said(values: list[float], words: list[int], sigma: float = 4.0) -> Said:
    """Plots with a number each, nan = none, and a word each, -1 = none."""
    likelihood = np.ones((3, len(words)))
    for j, word in enumerate(words):
        if word >= 0:
            likelihood[:, j] = CONFUSION[:, word] / CONFUSION[:, word].mean()
    value = np.array([values])
    return Said(value, np.full_like(value, sigma**2), likelihood, WIDTH, LAYOUT)


def known(mean: float, sigma: float, unsaid: float = 0.0) -> Features:
    """One track with a number."""
    shares = np.array([[0.5], [0.3], [0.2]])
    return Features(*(np.array([[x]]) for x in (unsaid, mean, sigma**2)), shares)


def heard(before: Features, values: list[float], sigma: float = 4.0) -> Features:
    """The track after plots that are surely its own."""
    for value in values:
        before = features.after(before, said([value], [-1], sigma), FIRST, FIRST)
    return before


def test_how_likely_a_value_is_right() -> None:
    near = features.right(known(50.0, 3.0, 0.5), said([52.0], [-1]), FIRST, FIRST)
    density = np.exp(-4 / 2 / 25.6) / np.sqrt(2 * np.pi * 25.6) * WIDTH[0]
    expected = 0.5 * (1 - WRONG) * density / (WRONG + (1 - WRONG) * (0.5 + 0.5 * density))
    assert near == pytest.approx(expected)
    assert features.right(known(50.0, 3.0), said([5.0], [-1]), FIRST, FIRST) < 1e-9
    assert features.right(known(50.0, 3.0), said([np.nan], [-1]), FIRST, FIRST) == 0.0


def test_what_is_missing_says_nothing() -> None:
    track = known(40.0, 3.0)
    silent = said([np.nan], [-1])
    assert features.ratio(track, silent, FIRST, FIRST) == pytest.approx(1.0)
    for part, before in zip(features.after(track, silent, FIRST, FIRST), track, strict=True):
        np.testing.assert_array_equal(part, before)


def test_a_track_of_which_nothing_is_known_agrees_with_everything() -> None:
    every = said([3.0, 55.0, 99.0], [0, 1, 2])
    pairs = np.zeros(3, dtype=np.intp), np.arange(3)
    assert features.ratio(unknown(LAYOUT, 1), every, *pairs) == pytest.approx(1.0)


def test_the_mean_ratio_over_the_population_is_one() -> None:
    """A likelihood ratio is one on the average, where there are two targets."""
    values = np.linspace(0.0, 100.0, 20_001)
    silent = [-1] * len(values)
    pairs = np.zeros(len(values), dtype=np.intp), np.arange(len(values))
    ratio = features.ratio(known(50.0, 3.0, 0.1), said(values.tolist(), silent), *pairs)
    assert ratio.mean() == pytest.approx(1.0, abs=1e-3)
    words = said([np.nan] * 3, [0, 1, 2])
    by_word = features.ratio(known(50.0, 3.0), words, np.zeros(3, dtype=np.intp), np.arange(3))
    assert by_word @ CONFUSION.mean(axis=0) == pytest.approx(1.0)


def test_no_value_forbids_a_pair() -> None:
    ratio = features.ratio(known(10.0, 0.1), said([90.0], [-1], 0.1), FIRST, FIRST)
    assert ratio == pytest.approx(WRONG)


@pytest.mark.parametrize("unsaid", [0.0, 0.02, 0.5])
@pytest.mark.parametrize("value", [31.0, 45.0, 80.0])
def test_a_value_is_taken_in_after_bayes(unsaid: float, value: float) -> None:
    """The four ways it can have come about, each with its own posterior; a grid over the number."""
    track, sigma, spread = known(30.0, 3.0, unsaid), 4.0, 9.0 * 16 / 15
    grid = np.linspace(-30.0, 130.0, 400_001)
    prior = (1 - unsaid) * np.exp(-((grid - 30) ** 2) / 2 / spread) / np.sqrt(2 * np.pi * spread)
    noise = np.exp(-((grid - value) ** 2) / 2 / sigma**2) / np.sqrt(2 * np.pi) / sigma
    seen = (1 - WRONG) * noise * WIDTH[0]
    weight = prior * (WRONG + seen) + unsaid * (1 - WRONG) * noise
    cell = grid[1] - grid[0]
    told, total = weight.sum() * cell, weight.sum() * cell + unsaid * WRONG
    mean = weight @ grid / weight.sum()
    after = features.after(track, said([value], [-1], sigma), FIRST, FIRST)
    assert after.unsaid == pytest.approx(1 - told / total, abs=1e-6)
    assert after.mean == pytest.approx(mean, rel=1e-5)
    assert after.variance == pytest.approx(weight @ (grid - mean) ** 2 / weight.sum(), rel=1e-4)


def test_a_word_is_taken_in_after_bayes() -> None:
    track = known(30.0, 3.0)
    after = features.after(track, said([np.nan], [1]), FIRST, FIRST).shares[:, 0]
    joint = track.shares[:, 0] * CONFUSION[:, 1]
    np.testing.assert_allclose(after, joint / joint.sum(), atol=1e-3)  # a thousandth stays open
    ratio = features.ratio(track, said([np.nan], [1]), FIRST, FIRST)
    assert ratio == pytest.approx(joint.sum() / CONFUSION[:, 1].mean())


def test_values_gather_and_the_old_ones_fade() -> None:
    track = heard(unknown(LAYOUT, 1), [40.0] * 200)
    assert track.mean == pytest.approx(40.0)
    assert np.sqrt(track.variance) == pytest.approx(1.0, rel=0.02)  # as of sixteen values of 4
    changed = heard(track, [52.0] * 40)
    assert changed.mean == pytest.approx(52.0, abs=1.0)


def test_a_wrong_first_value_is_got_over() -> None:
    track = heard(unknown(LAYOUT, 1), [95.0, 20.0, 21.0, 19.0, 20.0, 20.0])
    assert track.mean == pytest.approx(20.0, abs=2.0)
    assert np.sqrt(track.variance) < 6.0


def test_one_wrong_value_moves_nothing() -> None:
    track = heard(unknown(LAYOUT, 1), [20.0] * 10)
    assert heard(track, [95.0]).mean == pytest.approx(track.mean, abs=0.1)


def test_hypotheses_are_folded_by_their_moments() -> None:
    """Two tracks, one with two pairs; against samples of the mixture."""
    rng = np.random.default_rng(3)
    before = features.joined(known(20.0, 3.0, 0.3), known(60.0, 2.0))
    told = features.joined(known(25.0, 1.0, 0.1), known(40.0, 5.0))
    share, track = np.array([0.5, 0.2]), np.zeros(2, dtype=np.intp)

    def sums(values: Array) -> Array:
        return np.stack([values.sum(axis=-1), np.zeros_like(values[..., 0])], axis=-1)

    got = features.folded(before, told, track, share, sums)
    count = 400_000
    which = rng.choice(3, count, p=[0.3, 0.5, 0.2])
    mean, sigma = np.array([20.0, 25.0, 40.0])[which], np.array([3.0, 1.0, 5.0])[which]
    there = rng.random(count) > np.array([0.3, 0.1, 0.0])[which]
    drawn = rng.normal(mean, sigma)[there]
    assert got.unsaid[0, 0] == pytest.approx(1 - there.mean(), abs=2e-3)
    assert got.mean[0, 0] == pytest.approx(drawn.mean(), abs=0.05)
    assert got.variance[0, 0] == pytest.approx(drawn.var(), rel=0.01)
    for part, old in zip(got, before, strict=True):
        np.testing.assert_allclose(part[:, 1], old[:, 1])


def test_tracks_of_two_sides_agree_as_far_as_both_know() -> None:
    """Against the density of the difference; where one side knows nothing there is nothing."""
    one, other = known(30.0, 3.0, 0.2), known(36.0, 4.0)
    even = unknown(LAYOUT, 1).shares
    one, other = one._replace(shares=even), other._replace(shares=even)
    every = np.array([25.0, 100.0, 400.0])  # the sum of their variances, and more
    density = np.mean(np.exp(-36 / 2 / every) / np.sqrt(2 * np.pi * every)) * 100.0
    expected = np.log(WRONG + (1 - WRONG) * (0.2 + 0.8 * density))
    assert features.agreement(one, other, WIDTH, LAYOUT, FIRST, FIRST) == pytest.approx(expected)
    nobody = unknown(LAYOUT, 1)
    assert features.agreement(one, nobody, WIDTH, LAYOUT, FIRST, FIRST) == pytest.approx(0.0)


def test_words_of_two_sides_agree_by_what_they_say_of_the_categories() -> None:
    sure = np.array([[0.98], [0.01], [0.01]])
    one = unknown(LAYOUT, 1)._replace(shares=sure)
    other = unknown(LAYOUT, 1)._replace(shares=sure[::-1])
    same = features.agreement(one, one, WIDTH, LAYOUT, FIRST, FIRST)
    differ = features.agreement(one, other, WIDTH, LAYOUT, FIRST, FIRST)
    assert same == pytest.approx(np.log(3 * (0.98**2 + 2e-4)), abs=2e-3)
    assert differ == pytest.approx(np.log(3 * (2 * 0.0098 + 1e-4)), abs=2e-2)


LENGTHS_M = np.array([20.0, 80.0])


def side_by_side(rng: np.random.Generator, count: int, apart_m: float = 60.0) -> list[Scan]:
    """Two targets abreast, their noise half of what separates them; row 0 is the short one."""
    scans = []
    for k in range(count):
        true = np.array([[0.0, 12.0 * k], [apart_m, 12.0 * k]])
        plots = true + rng.normal(0, 30.0, true.shape)
        spread = np.tile(900.0 * np.eye(2), (2, 1, 1))
        value = (LENGTHS_M + rng.normal(0, 4.0, 2))[None]
        word = np.ones((3, 2))
        told = Said(value, np.full_like(value, 16.0), word, WIDTH, LAYOUT)
        scan = Scan(round(k * 1e9), places(plots, spread), View(np.zeros(2)), 0.95, 1e-9)
        scans.append(scan._replace(features=told))
    return scans


def followed(scans: list[Scan]) -> tuple[Picture, list[Association]]:
    settings = SETTINGS._replace(features=LAYOUT)
    picture, done = nothing(settings, 0), []
    for scan in scans:
        picture, association = step(picture, scan, settings)
        done.append(association)
    return picture, done


def wrong_pairs(done: list[Association]) -> float:
    """Probability, a scan, of pairs other than those of the tracks with their first plots."""
    owner = dict(zip(done[0].begun.tolist(), (0, 1), strict=True))
    return sum(
        float(p)
        for association in done[5:]
        for name, plot, p in zip(
            association.identity.tolist(),
            association.plot.tolist(),
            association.probability.tolist(),
            strict=True,
        )
        if owner.get(name) != plot
    ) / len(done[5:])


def test_targets_too_near_to_be_told_apart_by_place_are_by_their_lengths() -> None:
    rng = np.random.default_rng(4)
    scans = side_by_side(rng, 60)
    blind = [scan._replace(features=None) for scan in scans]
    assert wrong_pairs(followed(scans)[1]) < 0.01
    assert wrong_pairs(followed(blind)[1]) > 0.2
    picture, _ = followed(scans)
    best = np.argsort(picture.tracks.existence)[-2:]
    found = np.sort(picture.tracks.features.mean[0, best])
    np.testing.assert_allclose(found, LENGTHS_M, atol=4.0)


def test_late_scans_with_features_give_the_same_bits() -> None:
    scans = side_by_side(np.random.default_rng(5), 20)
    scans = [s._replace(view=View(np.full(2, float(k)))) for k, s in enumerate(scans)]
    settings = SETTINGS._replace(features=LAYOUT)
    assert arrival.cost(scans, settings, 1, repeats=1).identical
