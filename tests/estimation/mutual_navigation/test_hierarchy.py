"""Benchmark S: what each way of passing fixes on is worth, and whether it says so honestly."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.navigation import hierarchy, mutual
from bench.navigation.hierarchy import Run
from estimation.mutual_navigation import Fix, Message, fused, predicted_fix


@cache
def ideal() -> Run:
    return hierarchy.exact(None, ideal=True)


@cache
def centralised() -> Run:
    return hierarchy.exact(None)


@cache
def two_way() -> Run:
    return hierarchy.exact(hierarchy.ALL_USERS)


@cache
def one_way() -> Run:
    return hierarchy.exact(hierarchy.ALL_USERS, two_way=False)


@cache
def uncorrelated() -> Run:
    return hierarchy.local(hierarchy.uncorrelated)


def test_the_more_is_kept_the_better() -> None:
    order = (ideal(), centralised(), two_way(), one_way(), uncorrelated())
    for better, worse in pairwise(order):
        assert better.true_m[-1] < worse.true_m[-1]


def test_demands_of_the_exact_filters() -> None:
    assert centralised().true_m[-1] <= 56
    assert one_way().true_m[-1] <= 106


@pytest.mark.parametrize("method", [centralised, two_way, one_way])
def test_bookkeeping_believes_what_is_true(method: object) -> None:
    run = method()  # type: ignore[operator]
    np.testing.assert_allclose(run.true_m, run.believed_m, rtol=1e-9)
    np.testing.assert_allclose(run.nees, 1, rtol=1e-6)


def test_fixes_taken_as_independent_are_believed_far_too_much() -> None:
    run = uncorrelated()
    assert run.nees[-1] > 50
    assert run.believed_m[-1] < run.true_m[-1] / 3


def test_the_papers_cosines_do_not_mend_it() -> None:
    run = hierarchy.local(hierarchy.cosines)
    assert run.nees[-1] > 50


def test_split_intersection_never_believes_too_much() -> None:
    run = hierarchy.split(60.0)
    assert run.excess.max() <= 1 + 1e-9
    start = 2 * np.sqrt(2 * 100**2 + 10**2)  # of place and height, before the first range
    assert run.true_m[-1] < 0.8 * start


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), correlation=st.floats(-0.999, 0.999))
def test_split_intersection_covers_any_correlation(seed: int, correlation: float) -> None:
    """The dependent errors of fix and sender tied in any way: the result still covers the truth."""
    rng = np.random.default_rng(seed)
    independent, dependent = (_covariance(rng, 2) for _ in range(2))
    fix = Fix(np.zeros(2), independent, dependent, frozenset({"a"}))
    h = rng.standard_normal((1, 2))
    own, sent = rng.uniform(0.1, 2), rng.uniform(0.1, 2)
    message = Message(np.zeros(1), h, np.array([[own]]), np.array([[sent]]), frozenset({"b"}))
    after, gain = fused(fix, message)
    direction = np.linalg.cholesky(dependent) @ _unit(rng, 2)
    tie = correlation * np.sqrt(sent) * direction  # E[dependent error, sender's error]
    kept = np.eye(2) - gain @ h
    cross = kept @ tie[:, None] @ gain.T
    true = kept @ (independent + dependent) @ kept.T + gain @ gain.T * (own + sent)
    true = true + cross + cross.T
    assert np.linalg.eigvals(np.linalg.solve(after.covariance, true)).real.max() <= 1 + 1e-6
    assert after.sources == {"a", "b"}
    assert np.linalg.eigvalsh(after.independent).min() >= 0


def test_an_independent_message_is_a_kalman_update() -> None:
    rng = np.random.default_rng(1)
    covariance = _covariance(rng, 3)
    fix = Fix(np.zeros(3), covariance, np.zeros((3, 3)), frozenset())
    h = rng.standard_normal((1, 3))
    nothing = np.zeros((1, 1))
    after, _ = fused(fix, Message(np.ones(1), h, np.eye(1), nothing, frozenset()))
    exact = np.linalg.inv(np.linalg.inv(covariance) + h.T @ h)
    np.testing.assert_allclose(after.covariance, exact, atol=1e-9)


def test_time_makes_new_errors_nobody_elses() -> None:
    rng = np.random.default_rng(2)
    fix = Fix(np.zeros(2), _covariance(rng, 2), _covariance(rng, 2), frozenset())
    later = predicted_fix(fix, 2 * np.eye(2), np.eye(2))
    np.testing.assert_allclose(later.dependent, 4 * fix.dependent)
    np.testing.assert_allclose(later.independent, 4 * fix.independent + np.eye(2))


def test_figure_two() -> None:
    correlations = mutual.figure_two(1, 400)
    # the median is near cos 25 deg = .906, and the paper's .954 is one draw among others
    assert 0.8 < np.median(correlations) < 0.95
    assert 0.02 < np.mean(correlations > 0.954) < 0.6


def test_fifty_carriers_take_a_tenth_of_a_second() -> None:
    assert mutual.fifty(1) < 0.3  # three times the demand, for a busy machine


def _covariance(rng: np.random.Generator, size: int) -> np.ndarray:
    root = rng.standard_normal((size, size))
    return root @ root.T + 0.2 * np.eye(size)


def _unit(rng: np.random.Generator, size: int) -> np.ndarray:
    vector = rng.standard_normal(size)
    return vector / np.linalg.norm(vector)
