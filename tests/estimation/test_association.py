"""Association: invariances, the common error integrated out, calibrated probabilities, rules."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from estimation.association import (
    Population,
    Side,
    associate,
    candidates,
    coordinate_log_ratio,
    population,
)
from estimation.association_rules import blind_below, mahalanobis_rule, paper_rule, ruled_pairs

NONE = np.empty((0, 0))


def side(place, sigma=1.0, by_common=None) -> Side:
    place = np.asarray(place, dtype=float)
    sigma = np.broadcast_to(sigma, len(place))
    return Side(place, sigma[:, None, None] ** 2 * np.eye(place.shape[1]), by_common)


def field(rng, objects: int, spacing: float, seen: float = 0.9):
    """A square of objects, what each side sees of them, and the truth of both."""
    extent = objects * spacing**2
    truth = rng.uniform(0, np.sqrt(extent), (objects, 2))
    alone = rng.random(objects) >= seen
    by_own = ~alone | (rng.random(objects) < 0.5)
    own, other = np.flatnonzero(by_own), np.flatnonzero(~by_own | ~alone)
    places = (truth[which] + rng.normal(0, 1, (len(which), 2)) for which in (own, other))
    return *places, own, other, population(len(own), len(other), extent, seen)


def pairs_and_ratios(own: Side, other: Side, of: Population, common=NONE):
    near = candidates(own, other, common)
    found = associate(near, common, of, np.zeros(len(near.own)))
    return set(zip(found.own.tolist(), found.other.tolist(), strict=True)), found


def test_turning_and_shifting_the_whole_scene_changes_nothing() -> None:
    a, b, *_, of = field(np.random.default_rng(1), 60, 5.0)
    pairs, found = pairs_and_ratios(side(a), side(b), of)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    turned, again = pairs_and_ratios(side(a @ turn + 1e3), side(b @ turn + 1e3), of)
    assert turned == pairs
    np.testing.assert_allclose(again.log_ratio, found.log_ratio, atol=1e-7)


def test_swapping_the_sides_swaps_the_pairs() -> None:
    a, b, *_, of = field(np.random.default_rng(2), 60, 4.0)
    pairs, found = pairs_and_ratios(side(a), side(b), of)
    swapped, again = pairs_and_ratios(side(b), side(a), of)
    assert swapped == {(i, j) for j, i in pairs}
    assert np.sort(again.log_ratio) == pytest.approx(np.sort(found.log_ratio))


def test_ratio_of_a_lone_pair_is_that_of_the_formula() -> None:
    rng = np.random.default_rng(3)
    common = np.diag([4.0, 9.0, 1e-4])
    by_common = rng.normal(0, 1, (1, 2, 3)) * [1, 1, 100]
    own, other = side([[0.0, 0.0]], 1.5), side([[3.0, 2.0]], 0.5, by_common)
    of = Population(2e-3, 1e-4, 3e-4)
    near = candidates(own, other, common)
    found = associate(near, common, of, np.array([0.7]))
    s = (1.5**2 + 0.5**2) * np.eye(2) + by_common[0] @ common @ by_common[0].T
    expected = multivariate_normal([0, 0], s).logpdf([-3.0, -2.0]) + np.log(2e-3 / 1e-4 / 3e-4)
    assert found.log_ratio[0] == pytest.approx(expected + 0.7)
    assert coordinate_log_ratio(near, common, of)[0] == pytest.approx(expected)
    assert found.probability[0] == pytest.approx(1 / (1 + np.exp(-expected - 0.7)))


def test_candidates_are_all_within_the_gate_whatever_the_sigmas() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.uniform(0, 200, (2, 60, 2))
    sigma_a, sigma_b = 10 ** rng.uniform(-1, 1.5, (2, 60))
    near = candidates(side(a, sigma_a), side(b, sigma_b), NONE, gate_sigmas=3.0)
    squares = ((a[:, None] - b) ** 2).sum(-1) / (sigma_a[:, None] ** 2 + sigma_b**2)
    np.testing.assert_array_equal(
        np.column_stack([near.own, near.other]), np.argwhere(squares <= 9)
    )


def shifted(rng, objects: int = 40, spacing: float = 7.0, common_sigma: float = 4.0):
    """Two sides of which the other is displaced as a whole by much more than a log's sigma."""
    a, b, own, other, of = field(rng, objects, spacing)
    shift = rng.normal(0, common_sigma, 2)
    common = common_sigma**2 * np.eye(2)
    by_common = np.broadcast_to(np.eye(2), (len(b), 2, 2))
    true = {(i, j) for i, o in enumerate(own) for j, p in enumerate(other) if o == p}
    return side(a), side(b + shift, 1.0, by_common), of, common, shift, true


def independent(other: Side, common) -> Side:
    """The same displacement taken for noise of each log."""
    return Side(other.place_m, other.covariance + common)


def test_a_common_error_is_no_noise_of_each_log() -> None:
    """Hardly worse than knowing it, though it is larger than the distance of neighbours."""
    rng = np.random.default_rng(5)
    right = np.zeros(3)
    wanted = 0
    for _ in range(20):
        own, other, of, common, shift, true = shifted(rng)
        known = side(other.place_m - shift)
        for k, theirs in enumerate((other, known, independent(other, common))):
            pairs, _ = pairs_and_ratios(own, theirs, of, common)
            right[k] += len(pairs & true)
        wanted += len(true)
    jointly, known, singly = right / wanted
    assert jointly > known - 0.03  # 700 pairs: sigma .013 each, and most errors are the same
    assert singly < jointly - 0.2  # measured .33: what it costs to forget that it is common


def test_the_common_error_is_found_with_its_covariance() -> None:
    rng = np.random.default_rng(6)
    errors = []
    for _ in range(60):
        own, other, of, common, shift, _ = shifted(rng, spacing=25.0)
        _, found = pairs_and_ratios(own, other, of, common)
        error = found.common - shift
        errors.append(error @ np.linalg.solve(found.common_covariance, error))
    # 120 degrees of freedom: sigma .13
    assert 0.6 < np.mean(errors) / 2 < 1.45


def test_without_pairs_the_common_error_keeps_its_prior() -> None:
    common = np.diag([1.0, 2.0])
    far = side([[1e6, 0.0]], 1.0, np.zeros((1, 2, 2)))
    for other in (far, side(np.empty((0, 2)), 1.0, np.empty((0, 2, 2)))):
        _, found = pairs_and_ratios(side([[0.0, 0.0]]), other, Population(1, 1, 1), common)
        assert "near enough" in found.status
        np.testing.assert_array_equal(found.common_covariance, common)


def test_absurd_covariances_raise_nothing() -> None:
    flat = np.array([[1.0, 0.0], [0.0, 0.0]])
    absurd = np.stack([flat, 1e300 * np.eye(2), np.zeros((2, 2)), np.full((2, 2), np.nan)])
    own = Side(np.zeros((4, 2)), absurd)
    other = Side(np.zeros((5, 2)), np.concatenate([absurd, [np.eye(2)]]))
    pairs, found = pairs_and_ratios(own, other, Population(1e-3, 1e-4, 1e-4))
    assert (0, 0) in pairs
    assert np.isfinite(found.log_ratio).all()


def test_a_known_direction_of_the_common_error_is_allowed() -> None:
    rng = np.random.default_rng(7)
    own, other, of, _, shift, true = shifted(rng)
    only_east = np.diag([16.0, 0.0])
    other = other._replace(place_m=other.place_m - [0.0, shift[1]])
    pairs, found = pairs_and_ratios(own, other, of, only_east)
    assert found.common[1] == 0
    assert len(pairs & true) / len(true) > 0.9


def test_probabilities_are_honest() -> None:
    """Of the pairs given 80 to 95 %, so many are right."""
    rng = np.random.default_rng(8)
    told, right = [], []
    for _ in range(30):
        a, b, own, other, of = field(rng, 80, 4.0)
        _, found = pairs_and_ratios(side(a), side(b), of)
        told.append(found.probability)
        right.append(own[found.own] == other[found.other])
    told, right = np.concatenate(told), np.concatenate(right)
    for low, high in ((0.3, 0.6), (0.6, 0.8), (0.8, 0.95), (0.95, 1.0)):
        which = (told >= low) & (told < high)
        sigma = np.sqrt(np.mean(told[which] * (1 - told[which])) / which.sum())
        assert right[which].mean() == pytest.approx(told[which].mean(), abs=4 * sigma + 0.03)


def test_features_decide_where_places_cannot() -> None:
    own, other = side([[0.0, 0.0], [0.5, 0.0]]), side([[0.0, 0.0], [0.5, 0.0]])
    near = candidates(own, other, NONE)
    crossed = np.where(near.own == near.other, -5.0, 5.0)
    found = associate(near, NONE, Population(0.01, 0.001, 0.001), crossed)
    assert found.own.tolist() == [0, 1]
    assert found.other.tolist() == [1, 0]


def test_densities_add_up() -> None:
    of = population(95, 95, 1000.0, 0.9)
    assert of.both + of.own_alone == pytest.approx(95 / 1000)
    assert of.both / (of.both + of.own_alone + of.other_alone) == pytest.approx(0.9)


def test_the_papers_rule_is_its_likelihood_ratio() -> None:
    d, s, alpha, gamma = np.linspace(-9, 9, 200)[:, None], 1.3, 4.0, 1.7
    ratio = norm.pdf(d, 0, s) / (norm.pdf(d, alpha, s) + norm.pdf(d, -alpha, s))
    ruled = paper_rule(d, s, [alpha], [gamma])
    np.testing.assert_array_equal(ruled.accepted, ratio[:, 0] >= gamma)
    assert ruled.status == "selective"
    assert ruled.accepted.any()


def test_the_papers_rule_says_when_it_is_blind() -> None:
    assert blind_below(1.0) == pytest.approx(1.177, abs=1e-3)
    ruled = paper_rule(np.zeros((5, 2)), 1.0, [4.0, 1.17])
    assert not ruled.accepted.any()
    assert "accepts nothing" in ruled.status
    assert paper_rule(np.zeros((5, 2)), 1.0, [4.0, 1.19]).accepted.all()
    assert blind_below(0.4) == 0  # a threshold below one half accepts equal values always
    assert "accepts nothing" in paper_rule(np.zeros((1, 1)), 1.0, [0.0]).status


def test_large_differences_do_not_overflow() -> None:
    assert not paper_rule([[1e9], [-1e9]], 1e-3, [1e6]).accepted.any()


def test_mahalanobis_takes_the_share_it_says() -> None:
    rng = np.random.default_rng(9)
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    d = rng.multivariate_normal([0, 0], covariance, 20_000)
    share = mahalanobis_rule(d, np.broadcast_to(covariance, (20_000, 2, 2)), 5.991).accepted.mean()
    assert share == pytest.approx(0.95, abs=0.007)  # 20 000 draws: sigma .0015


def test_ruled_pairs_are_one_to_one_and_nearest() -> None:
    own, other = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    d = np.array([[0.0], [3.0], [1.0], [9.0]])
    covariance = np.ones((4, 1, 1))
    chosen = ruled_pairs(own, other, d, covariance, mahalanobis_rule(d, covariance, 20.0))
    assert list(zip(chosen.own, chosen.other, strict=True)) == [(0, 1), (1, 0)]
