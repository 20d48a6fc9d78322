"""Wrong bearings cost little, and nothing when there are none."""

from __future__ import annotations

import numpy as np
import pytest

from bench.bearings_only.carriers import spoilt
from bench.bearings_only.scenes import benchmark
from bench.bearings_only.unknown import judged
from estimation.bearings_only import CONSTANT_VELOCITY, maximum_likelihood, student_t
from estimation.bearings_only.measurements import scene_of
from estimation.bearings_only.robust import kept, screened


@pytest.mark.parametrize("name", ["S", "M"])
def test_wrong_bearings(name: str) -> None:
    scene = spoilt(
        np.random.default_rng(1), benchmark(np.random.default_rng(2), name, "A", 60, 100)
    )
    ranges = {
        loss: 1 / maximum_likelihood(scene.given, CONSTANT_VELOCITY, loss).inverse_range().value
        for loss in (student_t(), None)
    }
    robust, plain = (np.median(np.abs(r / scene.range_m - 1)) for r in ranges.values())
    assert robust < 0.06
    assert plain > 3 * robust


def test_unknown_motion_with_wrong_bearings() -> None:
    scene = spoilt(np.random.default_rng(3), benchmark(np.random.default_rng(4), "S", "A", 60, 32))
    found = judged(scene, student_t())
    assert found.percentile(50) < 6 * 1.3  # 32 runs: a median to 20 %
    assert found.percentile(95) < 20
    assert found.alarms < 0.15


def test_nothing_is_lost_without_wrong_bearings() -> None:
    scene = benchmark(np.random.default_rng(5), "S", "A", 60, 300)
    errors = [
        np.std(1 / maximum_likelihood(scene.given, CONSTANT_VELOCITY, loss).inverse_range().value)
        for loss in (student_t(), None)
    ]
    assert errors[0] < 1.12 * errors[1]  # 4 degrees of freedom: 7 % in theory


def test_screening_finds_the_wrong_ones() -> None:
    clean = benchmark(np.random.default_rng(6), "M", "C", 10, 20)
    bad = spoilt(np.random.default_rng(7), clean)
    wrong = np.abs(bad.given.bearing_rad - clean.given.bearing_rad).T > 0.1
    left = screened(scene_of(bad.given), student_t()).weight > 0
    assert not (left & wrong).any()
    assert (~left & ~wrong).mean() < 0.01
    assert screened(scene_of(bad.given), None).weight.all()


def test_student_t_is_a_loss() -> None:
    squared = np.linspace(0, 50, 11)
    cost, weight = student_t()(squared)
    step = 1e-6
    slope = (student_t()(squared + step)[0] - cost) / step
    np.testing.assert_allclose(weight, slope, rtol=1e-4)
    assert (np.diff(weight) < 0).all()


def test_a_motion_that_rejects_most_explains_nothing() -> None:
    residual = np.concatenate([np.zeros(5), np.full(5, 10.0)])[:, None]
    chi2, counted = kept(residual, np.ones((10, 1)))
    assert (chi2, counted) == (500.0, 10.0)
    residual[5:9] = 1.0
    chi2, counted = kept(residual, np.ones((10, 1)))
    assert (chi2, counted) == (4.0, 9.0)
