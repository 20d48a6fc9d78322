"""Classes and counts: Bayes by hand, honest probabilities, discounts, repeats."""

from __future__ import annotations

import numpy as np
import pytest

from bench.joint_fusion import classes as bench
from estimation.classes import (
    by_confusion,
    by_set,
    class_posterior,
    discounted,
    expected_trust,
    log_loss,
    taught_trust,
    unproven,
    without_each,
)
from estimation.object_count import count_distribution, count_of_pairs, object_count


def flat(targets: int, classes: int = 3):
    return np.full((targets, classes), 1.0 / classes)


def test_a_report_is_bayes() -> None:
    confusion = np.array([[0.8, 0.2, 0.0], [0.1, 0.7, 0.2], [0.3, 0.3, 0.4]])
    prior = np.array([[0.5, 0.3, 0.2], [0.2, 0.2, 0.6]])
    found = class_posterior(prior, np.array([1]), by_confusion(confusion, np.array([1])))
    np.testing.assert_allclose(found[0], prior[0])
    joint = prior[1] * confusion[:, 1]
    np.testing.assert_allclose(found[1], joint / joint.sum())


def test_order_and_portions_of_reports_do_not_matter() -> None:
    rng = np.random.default_rng(1)
    likelihood, target = rng.random((30, 3)), rng.integers(0, 4, 30)
    whole = class_posterior(flat(4), target, likelihood)
    order = rng.permutation(30)
    np.testing.assert_allclose(class_posterior(flat(4), target[order], likelihood[order]), whole)
    first = class_posterior(flat(4), target[:11], likelihood[:11])
    np.testing.assert_allclose(class_posterior(first, target[11:], likelihood[11:]), whole)
    np.testing.assert_allclose(class_posterior(flat(4), target[:0], likelihood[:0]), flat(4))


def test_coarse_reports_tell_no_class_of_a_set_from_another() -> None:
    members = np.array([[True, True, False, False], [True, False, False, False]])
    rows = by_set(members, np.array([0.8, 0.7]))
    np.testing.assert_allclose(rows[0], [0.4, 0.4, 0.1, 0.1])
    np.testing.assert_allclose(rows[1], [0.7, 0.1, 0.1, 0.1])  # a set of one is a confusion's row
    everything = np.array([[True] * 4, [False] * 4])
    np.testing.assert_array_equal(by_set(everything, 0.9), 1.0)


def test_a_discount_leads_from_what_is_said_to_nothing() -> None:
    said = np.array([[0.9, 0.05, 0.05]] * 3)
    rows = discounted(said, np.array([1.0, 0.5, 0.0]))
    np.testing.assert_allclose(rows[0], said[0])
    np.testing.assert_allclose(rows[2], 1 / 3)
    assert rows[0, 0] > rows[1, 0] > rows[2, 0]
    np.testing.assert_allclose(rows.sum(axis=1), said.sum(axis=1))


def test_nobody_is_infallible() -> None:
    contradictory = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    found = class_posterior(flat(1), np.array([0, 0]), contradictory)
    np.testing.assert_allclose(found[0], [0.5, 0.5, 0.0], atol=1e-5)
    silent = class_posterior(flat(1), np.array([0]), np.zeros((1, 3)))
    np.testing.assert_allclose(silent, flat(1))


def test_what_the_others_say_is_the_posterior_without_a_report() -> None:
    rng = np.random.default_rng(2)
    likelihood, target = rng.random((6, 3)), np.array([0, 0, 1, 1, 1, 0])
    posterior = class_posterior(flat(2), target, likelihood)
    others = without_each(posterior, target, likelihood)
    for k in range(6):
        rest = np.delete(np.arange(6), k)
        expected = class_posterior(flat(2), target[rest], likelihood[rest])[target[k]]
        np.testing.assert_allclose(others[k], expected, rtol=1e-9)


def test_probabilities_are_honest() -> None:
    """Classes given p are right in p of the cases, in each tenth of p."""
    shares = bench.HONEST[1]
    of = bench.reported(np.random.default_rng(3), 4000, shares)
    posterior = bench.as_claimed(of, shares)
    right = np.zeros_like(posterior)
    right[np.arange(4000), of.truth] = 1.0
    for low in np.arange(0.0, 1.0, 0.1):
        which = (posterior >= low) & (posterior < low + 0.1)
        if which.sum() > 50:
            sigma = np.sqrt(np.mean(posterior[which] * (1 - posterior[which])) / which.sum())
            assert right[which].mean() == pytest.approx(posterior[which].mean(), abs=4 * sigma)


@pytest.mark.parametrize(("claimed", "true"), [(0.9, 0.6), (0.9, 0.9), (0.8, 0.4)])
def test_trust_learns_the_share_that_fits(claimed: float, true: float) -> None:
    rng = np.random.default_rng(4)
    truth = rng.integers(0, 4, 600)
    said = np.where(rng.random(600) < true, truth, (truth + rng.integers(1, 4, 600)) % 4)
    rows = by_confusion(bench.confusion(claimed), said)
    known = np.full((600, 4), 0.02) + 0.92 * np.eye(4)[truth]
    trust = taught_trust(unproven(2), np.zeros(600, dtype=int), rows, known)
    share = (true - 0.25) / (claimed - 0.25)  # share of claimed plus the rest by chance
    assert expected_trust(trust)[0] == pytest.approx(share, abs=0.1)  # 600 reports: sigma .03
    assert expected_trust(trust)[1] == expected_trust(unproven(1))[0]


def test_trust_can_be_lost() -> None:
    rows, known = by_confusion(bench.confusion(0.9), np.zeros(200, dtype=int)), np.eye(4)
    sources, trust = np.zeros(200, dtype=int), unproven(1)
    for truth in (0, 2):
        others = np.tile(0.96 * known[truth] + 0.01, (200, 1))
        trust = taught_trust(trust, sources, rows, others, forgetting=0.1)
        assert (expected_trust(trust)[0] > 0.9) == (truth == 0)


def test_log_loss() -> None:
    assert log_loss(np.array([[0.5, 0.5], [0.25, 0.75]]), np.array([0, 1])) == pytest.approx(
        -(np.log(0.5) + np.log(0.75)) / 2
    )
    assert log_loss(np.array([[0.0, 1.0]]), np.array([0])) == np.inf


def test_the_ways_of_the_bench_are_in_their_order() -> None:
    found = bench.losses(3, 1500, *bench.OVERRATED)
    assert found["trust learned"] < found["least possible"] + 0.02
    assert found["trust learned"] < found["discounted"] - 0.03
    assert found["discounted"] < found["as claimed"] - 0.03
    honest = bench.losses(3, 1500, *bench.HONEST)
    assert honest["trust learned"] < honest["least possible"] + 0.005


def test_repeats_are_left_out() -> None:
    counting, once = bench.repeats(1, 600)
    assert once < 0.5 * counting


def test_count_is_its_distribution() -> None:
    existence = np.random.default_rng(5).random(40)
    number = np.arange(200)
    for unseen in (0.0, 3.5):
        distribution = count_distribution(existence, unseen)
        mean = distribution @ number[: len(distribution)]
        found = object_count(existence, unseen)
        assert found.mean == pytest.approx(mean, abs=1e-9)
        square = distribution @ (number[: len(distribution)] - mean) ** 2
        assert found.sigma**2 == pytest.approx(square, abs=1e-9)
    assert object_count(np.empty(0)) == (0.0, 0.0)
    assert count_distribution(np.array([1.0, 1.0])).tolist() == [0.0, 0.0, 1.0]


def test_sure_pairs_seen_by_all_leave_no_doubt() -> None:
    assert count_of_pairs(5, 5, np.ones(5), (1.0, 1.0)) == (5.0, 0.0)
    assert count_of_pairs(5, 4, np.zeros(0), (1.0, 1.0)).mean == 9.0


def test_the_count_of_pairs_is_honest() -> None:
    mean, square = bench.count_honesty(6, 400)
    assert abs(mean) < 0.2  # 400 runs: sigma .05
    assert 0.75 < square < 1.3
