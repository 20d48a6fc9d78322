"""Sources in the report: sums over the run, squares over its parts, intervals of honest ones."""

from __future__ import annotations

import numpy as np
import pytest

from crossfix.report.sources import FEWEST, MOST_PARTS, mean_interval, squares_over_time
from estimation.consistency import mean_interval as interval_of

RUN_S = 1000.0


def test_the_interval_is_that_of_the_consistency_tests() -> None:
    low, high = mean_interval(np.array([2, 30, 0]))
    assert (low[0], high[0]) == pytest.approx(interval_of(2, 1))
    assert (low[1], high[1]) == pytest.approx(interval_of(3, 10))
    assert np.isnan([low[2], high[2]]).all()


def test_parts_of_the_run_keep_the_mean_of_the_whole() -> None:
    generator = np.random.default_rng(1)
    t_s, dof = np.arange(1.0, RUN_S + 1), generator.integers(1, 40, 1000).astype(float)
    squares = generator.chisquare(dof)
    found = squares_over_time(t_s, squares, dof, RUN_S)
    assert len(found.mean) == MOST_PARTS
    per_part = np.add.reduceat(dof, np.searchsorted(t_s, edges(MOST_PARTS)[:-1], side="right"))
    assert found.mean @ per_part == pytest.approx(squares.sum())


def test_honest_squares_lie_in_their_interval_as_often_as_it_says() -> None:
    generator = np.random.default_rng(2)
    t_s, dof = np.linspace(1, RUN_S, 6000), np.full(6000, 4.0)
    inside = []
    for _ in range(20):
        found = squares_over_time(t_s, generator.chisquare(dof), dof, RUN_S)
        inside += [*(found.low < found.mean) & (found.mean < found.high)]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)  # three sigma of 1200 draws
    doubled = squares_over_time(t_s, 2 * generator.chisquare(dof), dof, RUN_S)
    assert (doubled.mean > doubled.high).mean() > 0.9


def test_a_source_that_speaks_seldom_has_fewer_parts_and_no_holes() -> None:
    t_s = np.linspace(5, RUN_S, 20)
    found = squares_over_time(t_s, np.full(20, 2.0), np.full(20, 2.0), RUN_S)
    assert len(found.mean) == 20 // FEWEST
    assert found.mean == pytest.approx(np.ones(20 // FEWEST))


def test_what_was_never_measured_is_unknown() -> None:
    found = squares_over_time(np.arange(9.0), np.full(9, np.nan), np.zeros(9), 9.0)
    assert np.isnan(found.mean).all()


def edges(count: int) -> np.ndarray:
    return np.linspace(0, RUN_S, count + 1)
