"""Features: ratios against integrals, missing values, dictionaries that differ, what is learned."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from estimation.feature_learning import (
    confusion_of,
    declared_reports,
    declared_variance,
    taught_reports,
    taught_scale,
    taught_variance,
    with_learned,
)
from estimation.features import (
    UNSAID,
    Behavioural,
    Declared,
    Parametric,
    behavioural_log_ratio,
    common_confusion,
    every_category,
    parametric_log_ratio,
    shared,
)

LENGTH = Parametric("length", 10.0, 310.0, 2 * 5.0**2)


@pytest.mark.parametrize("tolerance", [0.0, 1e-3, 4.0, 60.0])
@pytest.mark.parametrize("difference", [0.0, 3.0, -12.0, 55.0, 150.0])
def test_ratio_is_the_integral_over_what_the_truth_may_be(tolerance, difference) -> None:
    feature = LENGTH._replace(tolerance=tolerance)
    sigma = np.sqrt(feature.variance)
    density = norm.pdf(difference, 0, sigma)
    if tolerance:
        density = quad(
            lambda x: norm.pdf(difference, x, sigma) / (2 * tolerance), -tolerance, tolerance
        )[0]
    expected = np.log((1 - feature.wrong) * density * 300.0 + feature.wrong)
    assert parametric_log_ratio(feature, 100.0 + difference, 100.0) == pytest.approx(
        expected, abs=1e-6
    )


def test_the_ratio_averages_to_one_over_two_targets() -> None:
    """E(ratio | two targets) = 1: no evidence is made up (edges of the population aside)."""
    rng = np.random.default_rng(1)
    a, b = rng.uniform(10, 310, (2, 400_000))
    ratio = np.exp(parametric_log_ratio(LENGTH, a, b))
    assert ratio.mean() == pytest.approx(1.0, abs=0.03)  # 2 % is lost at the edges


def test_what_is_missing_says_nothing() -> None:
    assert parametric_log_ratio(LENGTH, [np.nan, 5.0], [3.0, np.nan]).tolist() == [0, 0]
    kind = Behavioural("kind", np.full(2, 0.5), np.eye(2), np.eye(2))
    said = behavioural_log_ratio(kind, np.array([UNSAID, 1]), np.array([0, UNSAID]))
    assert said.tolist() == [0, 0]


def test_a_single_absurd_value_cannot_forbid_a_pair() -> None:
    ratio = parametric_log_ratio(LENGTH, 1e300, -1e300)
    assert ratio == pytest.approx(np.log(LENGTH.wrong))


def test_sigmas_of_the_logs_come_before_the_features() -> None:
    own = parametric_log_ratio(LENGTH, 100.0, 130.0, variance=1e4)
    assert own > 0 > parametric_log_ratio(LENGTH, 100.0, 130.0)


def test_words_are_compared_by_bayes() -> None:
    population = np.array([0.7, 0.3])
    own, other = np.array([[0.9, 0.1], [0.2, 0.8]]), np.array([[0.6, 0.4], [0.5, 0.5]])
    kind = Behavioural("kind", population, own, other)
    together = sum(population[k] * own[k, 1] * other[k, 0] for k in range(2))
    apart = (population @ own[:, 1]) * (population @ other[:, 0])
    found = behavioural_log_ratio(kind, np.array([1]), np.array([0]))
    assert found[0] == pytest.approx(np.log(together / apart))


def test_infallible_words_that_differ_are_nearly_impossible_not_infinitely() -> None:
    kind = Behavioural("kind", np.full(2, 0.5), np.eye(2), np.eye(2))
    found = behavioural_log_ratio(kind, np.array([0, 0]), np.array([0, 1]))
    assert found[0] == pytest.approx(np.log(2))
    assert -10 < found[1] < -5


OWN = [
    Declared("length", 5.0, 10.0, 300.0),
    Declared("height", 1.0, 0.0, 50.0),
    Declared("kind", categories=("ship", "boat"), confusion=np.array([[0.9, 0.1], [0.2, 0.8]])),
    Declared("speed", 1.0, 0.0, 30.0),
]
OTHER = [
    Declared("length", 12.0, 20.0, 400.0),
    Declared("kind", categories=("boat", "buoy"), confusion=np.array([[0.7, 0.3], [0.1, 0.9]])),
    Declared("speed", categories=("slow", "fast"), confusion=np.eye(2)),
]


def test_dictionaries_share_what_both_mean_alike() -> None:
    parametric, behavioural = shared(OWN, OTHER)
    assert [(f.name, f.least, f.greatest, f.variance) for f in parametric] == [
        ("length", 10.0, 400.0, 169.0)
    ]
    assert [f.name for f in behavioural] == ["kind"]  # speed is a number here and a word there
    assert behavioural[0].own.shape == behavioural[0].other.shape == (3, 2)
    assert shared(OWN, []) == ([], [])


def test_a_word_that_the_other_does_not_know_is_no_contradiction() -> None:
    _, (kind,) = shared(OWN, OTHER)
    ship, boat, buoy = 0, 1, 1
    said = behavioural_log_ratio(kind, np.array([boat, ship]), np.array([0, buoy]))
    assert said[0] > 0.1  # boat and boat
    assert abs(said[1]) < 0.5  # ship and buoy: neither is a word of both
    names = every_category(("a", "b"), ("b", "c"))
    assert names == ("a", "b", "c")
    rows = common_confusion(names, ("b", "c"), np.array([[0.9, 0.1], [0.3, 0.7]]))
    np.testing.assert_allclose(rows, [[0.6, 0.4], [0.9, 0.1], [0.3, 0.7]])


@pytest.mark.parametrize("tolerance", [0.0, 20.0])
@pytest.mark.parametrize("declared", [0.25, 1.0, 4.0])
def test_a_wrong_sigma_is_learned_from_pairs_of_which_some_are_wrong(declared, tolerance) -> None:
    rng = np.random.default_rng(2)
    true = 2 * 5.0**2
    feature = LENGTH._replace(variance=true * declared**2, tolerance=tolerance)
    learned = declared_variance(feature.variance)
    for _ in range(40):
        same = rng.random(50) < 0.9
        noise = rng.normal(0, np.sqrt(true), 50) + rng.uniform(-tolerance, tolerance, 50)
        other = np.subtract(*rng.uniform(10, 310, (2, 50)))
        difference = np.where(same, noise, other)
        difference[::10] = np.nan
        learned = taught_variance(learned, feature, difference, np.full(50, 0.9))
        feature = with_learned(feature, learned)
    # 1600 pairs; the first batches were weighed with the wrong sigma and are not forgotten
    assert feature.variance == pytest.approx(true, rel=0.35)


def test_forgetting_follows_a_change() -> None:
    rng = np.random.default_rng(3)
    feature, learned = LENGTH, declared_variance(LENGTH.variance)
    for sigma in (7.0, 21.0):
        for _ in range(30):
            difference = rng.normal(0, sigma, 50)
            learned = taught_variance(learned, feature, difference, np.full(50, 0.99), 0.8)
            feature = with_learned(feature, learned)
        assert np.sqrt(feature.variance) == pytest.approx(sigma, rel=0.15)
    assert learned.weight < 300  # memory of five batches, not of sixty


def test_certain_pairs_teach_without_a_division_by_nothing() -> None:
    learned = taught_variance(
        declared_variance(50.0), LENGTH, np.array([0.0, 9.0]), np.array([0.0, 1.0])
    )
    assert learned.weight == pytest.approx(9.0, abs=0.01)


def test_a_wrong_confusion_is_learned_from_what_others_say() -> None:
    rng = np.random.default_rng(4)
    true = np.array([[0.6, 0.3, 0.1], [0.1, 0.6, 0.3], [0.2, 0.2, 0.6]])
    reports = declared_reports(0.85 * np.eye(3) + 0.05)
    for _ in range(30):
        truth = rng.integers(0, 3, 100)
        told = np.full((100, 3), 0.05) + 0.85 * np.eye(3)[truth]
        mistaken = rng.random(100) < 0.1
        told[mistaken] = told[mistaken][:, [1, 2, 0]]
        reported = (rng.random(100)[:, None] > true[truth].cumsum(axis=1)).sum(axis=1)
        reported[::9] = UNSAID
        reports = taught_reports(reports, told, reported)
    np.testing.assert_allclose(confusion_of(reports), true, atol=0.06)
    assert reports.sum() == pytest.approx(3 * 8 + 30 * 88, abs=30)


@pytest.mark.parametrize("scale", [0.04, 1.0, 9.0])
def test_the_scale_of_stated_variances_is_found(scale: float) -> None:
    """Values of unlike sigmas about targets that are not known exactly."""
    rng = np.random.default_rng(11)
    learned = declared_variance(1.0)
    for _ in range(200):
        stated, known = rng.uniform(1.0, 5.0, 50), rng.uniform(0.1, 2.0, 50) * scale
        apart = rng.normal(0.0, np.sqrt(scale * stated + known))
        learned = taught_scale(learned, apart, known, stated, np.ones(50), 1000.0)
    assert learned.weight <= 1000.0
    assert learned.squares / learned.weight == pytest.approx(scale, rel=0.15)
