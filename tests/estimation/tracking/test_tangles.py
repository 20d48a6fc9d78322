"""Small groups with loops: exact against enumeration, and what that is worth side by side."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.metrics import matched
from estimation.tracking import tangles
from estimation.tracking.marginals import Candidates, by_belief
from estimation.tracking.measurements import places
from estimation.tracking.scan import Scan, View
from estimation.tracking.tracker import Settings, nothing, shown, step
from estimation.tracking.undetected import Region
from tests.estimation.tracking.test_marginals import enumerated


def full(weight: Array) -> Candidates:
    """Every track with every plot."""
    tracks, plots = weight.shape
    track, plot = (ends.ravel() for ends in np.mgrid[:tracks, :plots])
    return Candidates(track, plot, weight.ravel(), tracks, plots)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("shape", [(2, 2), (2, 5), (3, 3), (3, 4), (4, 2)])
def test_small_groups_are_exact(seed: int, shape: tuple[int, int]) -> None:
    """Weights within a factor of thirty, so that no pair is slight beside another."""
    given = full(np.random.default_rng(seed).uniform(1.0, 30.0, shape))
    exact, _ = enumerated(given)
    found = by_belief(given)
    for one, other in zip(found, exact, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_two_tracks_that_vie_for_two_plots_are_as_unsure_as_they_should_be() -> None:
    """Odds of 1.5 between the two ways: .6 and .4. Belief propagation would have .996."""
    found = by_belief(full(1e8 * np.array([[1.5, 1.0], [1.0, 1.0]])))
    np.testing.assert_allclose(found.pair, [0.6, 0.4, 0.4, 0.6], atol=1e-6)


def test_what_is_slight_or_faint_beside_a_group_hardly_has_a_part_in_it() -> None:
    """Two tracks vie for two plots; a third has one of its own. The others come to little."""
    track, plot = np.array([0, 0, 0, 1, 1, 2, 3, 4]), np.array([0, 1, 2, 0, 1, 2, 0, 1])
    weight = np.array([3e3, 2e3, 0.5, 2e3, 3e3, 4e3, 0.5, 9e-4])
    given = Candidates(track, plot, weight, 5, 3)
    exact, _ = enumerated(given)
    for one, other in zip(by_belief(given), exact, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-4)


def test_groups_of_different_sizes_in_one_scan_do_not_mix() -> None:
    rng = np.random.default_rng(3)
    parts = [full(rng.uniform(1.0, 30.0, shape)) for shape in ((2, 2), (3, 3), (2, 4), (3, 2))]
    first = np.cumsum([0] + [part.tracks for part in parts])
    second = np.cumsum([0] + [part.plots for part in parts])
    ends = [
        np.concatenate([getattr(part, side) + at[k] for k, part in enumerate(parts)])
        for side, at in (("track", first), ("plot", second))
    ]
    mixed = rng.permutation(len(ends[0]))
    weight = np.concatenate([part.weight for part in parts])
    found = tangles.summed(ends[0][mixed], ends[1][mixed], weight[mixed])
    want = np.concatenate([enumerated(part)[0].pair for part in parts])[mixed]
    np.testing.assert_allclose(found.probability, want[found.pair], rtol=1e-9)
    assert len(found.pair) == len(want)


def test_what_has_no_loop_or_is_large_is_left_alone() -> None:
    chain = np.array([0, 1, 1, 2]), np.array([0, 0, 1, 1])
    assert not tangles.summed(*chain, np.full(4, 5.0)).pair.size
    large = full(np.full((7, 7), 2.0))
    assert not tangles.summed(large.track, large.plot, large.weight).pair.size
    nobody = np.empty(0, dtype=np.intp)
    assert not tangles.summed(nobody, nobody, np.empty(0)).pair.size


def test_a_slight_pair_ties_no_groups_together() -> None:
    """Two pairs of two, tied by a pair of 1e-6 of what both of its ends have: two groups still."""
    weight = np.zeros((4, 4))
    weight[:2, :2], weight[2:, 2:], weight[1, 2] = 9e3, 9e3, 1e-2
    track, plot = weight.nonzero()
    found = tangles.summed(track, plot, weight[track, plot])
    assert len(found.pair) == 8
    np.testing.assert_allclose(found.probability, 0.5, atol=1e-3)


def test_two_at_rest_side_by_side_are_neither_driven_apart_nor_claimed_too_sure() -> None:
    """Ten metres apart, plots of 30 m, twelve such pairs, sixty looks. On seeds 5 to 7 errors are
    12 to 14 m and NEES/2 is .4 to .6; belief alone holds them forty metres apart, with errors of
    20 to 22 m and NEES/2 of 1.6 to 1.9. The bounds lie between.
    """
    rng, sigma = np.random.default_rng(5), 30.0
    settings = Settings(region=Region(half_m=2e4), lifetime_s=3600.0)
    resting = settings.motion._replace(noise=(1e-4, 1.0), sigma_speed_mps=5.0)
    settings = settings._replace(motion=resting)
    side = np.array([5.0, 0.0])
    middle = np.stack([np.arange(12) * 2e3 - 11e3, np.zeros(12)], axis=1)
    truth = np.concatenate([middle - side, middle + side])
    picture, error, honest = nothing(settings, 0), [], []
    for k in range(60):
        hit = truth[rng.random(len(truth)) < 0.95]
        measured = hit + rng.normal(0, sigma, hit.shape)
        plots = places(measured, np.broadcast_to(sigma**2 * np.eye(2), (len(hit), 2, 2)))
        scan = Scan(k * 1_000_000_000, plots, View(np.zeros(2)), 0.95, 1e-12)
        picture, _ = step(picture, scan, settings)
        if k >= 40:
            found = shown(picture, settings)
            pairs = matched(truth, found.mean[:, :2], 500.0)
            off = found.mean[pairs.estimate, :2] - truth[pairs.truth]
            error.append(np.linalg.norm(off, axis=1))
            honest.append(nees(off, found.covariance[pairs.estimate, :2, :2]) / 2)
    assert rms(np.concatenate(error)) < 17.0
    assert np.concatenate(honest).mean() < 1.3
