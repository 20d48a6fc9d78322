"""The sparse assignment is the dense one, whatever its groups and order."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from estimation import assignment as module
from estimation.assignment import assignment, neighbours, pair_probabilities


def candidates(rng, rows: int, columns: int, share: float):
    first, second = np.nonzero(rng.random((rows, columns)) < share)
    return first, second, rng.normal(1.0, 2.0, len(first))


def best(first, second, gain, rows: int, columns: int) -> float:
    dense = np.zeros((rows, columns))
    dense[first, second] = np.maximum(gain, 0.0)
    return float(dense[linear_sum_assignment(dense, maximize=True)].sum())


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 7), (9, 1), (12, 30), (40, 15)])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.5, 1.0])
def test_total_is_that_of_the_dense_solver(rows: int, columns: int, share: float) -> None:
    rng = np.random.default_rng([rows, columns, int(100 * share)])
    for _ in range(20):
        first, second, gain = candidates(rng, rows, columns, share)
        chosen = assignment(first, second, gain)
        assert gain[chosen].sum() == pytest.approx(best(first, second, gain, rows, columns))
        assert len(set(first[chosen])) == len(set(second[chosen])) == len(chosen)
        assert (gain[chosen] > 0).all()
        assert (np.diff(chosen) > 0).all()


def test_many_batches_give_what_one_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, gain = candidates(np.random.default_rng(1), 300, 300, 0.003)
    whole = assignment(first, second, gain)
    monkeypatch.setattr(module, "_BATCH", 3)
    np.testing.assert_array_equal(assignment(first, second, gain), whole)


def test_the_order_of_candidates_does_not_matter() -> None:
    rng = np.random.default_rng(2)
    first, second, gain = candidates(rng, 60, 60, 0.1)
    order = rng.permutation(len(gain))
    shuffled = order[assignment(first[order], second[order], gain[order])]
    np.testing.assert_array_equal(np.sort(shuffled), assignment(first, second, gain))


def test_nothing_to_pair() -> None:
    none = np.empty(0, dtype=np.intp)
    assert assignment(none, none, np.empty(0)).size == 0
    one = np.array([3])
    assert assignment(one, one, np.array([0.0])).size == 0
    assert assignment(one, one, np.array([1e-12])).tolist() == [0]


def test_neighbours_are_those_of_the_full_table() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.uniform(0, 10, (80, 3)), rng.uniform(0, 10, (50, 3))
    a[5, 1], b[7] = np.nan, np.inf
    with np.errstate(invalid="ignore"):
        distance = np.linalg.norm(a[:, None] - b[None], axis=-1)
    i, j = neighbours(a, b, 2.5)
    expected = np.nonzero(distance <= 2.5)
    np.testing.assert_array_equal(i, expected[0])
    np.testing.assert_array_equal(j, expected[1])


def test_nobody_has_no_neighbours() -> None:
    i, j = neighbours(np.empty((0, 2)), np.zeros((3, 2)), 1.0)
    assert i.size == j.size == 0
    i, j = neighbours(np.full((2, 2), np.nan), np.zeros((3, 2)), 1.0)
    assert i.size == j.size == 0


def probabilities_by_trial(first, second, log_ratio):
    """Over every one-to-one set of candidates, one by one."""
    weights = np.zeros(len(first) + 1)
    for bits in range(2 ** len(first)):
        which = [k for k in range(len(first)) if bits >> k & 1]
        if len(set(first[which])) == len(set(second[which])) == len(which):
            weight = np.exp(log_ratio[which].sum())
            weights[which] += weight
            weights[-1] += weight
    return weights[:-1] / weights[-1]


def test_probabilities_are_exact_without_loops() -> None:
    first, second = np.array([0, 0, 1, 1, 2]), np.array([0, 1, 1, 2, 2])
    for seed in range(20):
        log_ratio = np.random.default_rng(seed).normal(0, 3, 5)
        expected = probabilities_by_trial(first, second, log_ratio)
        found = pair_probabilities(first, second, log_ratio)
        np.testing.assert_allclose(found, expected, atol=1e-3)


def test_probabilities_are_near_where_candidates_form_loops() -> None:
    first, second = np.repeat(np.arange(3), 3), np.tile(np.arange(3), 3)
    worst = 0.0
    for seed in range(30):
        log_ratio = np.random.default_rng(seed).normal(0, 2, 9)
        expected = probabilities_by_trial(first, second, log_ratio)
        worst = max(worst, np.abs(pair_probabilities(first, second, log_ratio) - expected).max())
    assert worst < 0.12  # Bethe's approximation; full 3 by 3 tables are its worst case


def test_certain_and_impossible_pairs() -> None:
    first, second = np.array([0, 0, 1]), np.array([0, 1, 1])
    found = pair_probabilities(first, second, np.array([1e9, -np.inf, -1e9]))
    np.testing.assert_allclose(found, [1.0, 0.0, 0.0], atol=1e-12)
    assert pair_probabilities(*np.empty((2, 0), dtype=np.intp), np.empty(0)).size == 0
