"""Wrong bearings cost little, and nothing when there are none."""

from __future__ import annotations

import numpy as np
import pytest

from bench.bearings_only.carriers import spoilt
from bench.bearings_only.scenes import benchmark
from bench.bearings_only.unknown import judged
from estimation.bearings_only import (
    CONSTANT_VELOCITY,
    gross_errors,
    likely_ranges,
    maximum_likelihood,
    student_t,
)
from estimation.bearings_only.measurements import scene_of
from estimation.bearings_only.normal_equations import Loss
from estimation.bearings_only.robust import kept, screened


@pytest.mark.parametrize("name", ["S", "M"])
def test_wrong_bearings(name: str) -> None:
    scene = spoilt(
        np.random.default_rng(1), benchmark(np.random.default_rng(2), name, "A", 60, 100)
    )
    ranges = {
        loss: 1 / maximum_likelihood(scene.given, CONSTANT_VELOCITY, loss).inverse_range().value
        for loss in (gross_errors(), None)
    }
    robust, plain = (np.median(np.abs(r / scene.range_m - 1)) for r in ranges.values())
    assert robust < 0.06
    assert plain > 3 * robust


def test_unknown_motion_with_wrong_bearings() -> None:
    scene = spoilt(np.random.default_rng(3), benchmark(np.random.default_rng(4), "S", "A", 60, 32))
    found = judged(scene, gross_errors())
    assert found.percentile(50) < 6 * 1.3  # 32 runs: a median to 20 %
    assert found.percentile(95) < 20
    assert found.alarms < 0.15


def test_nothing_is_lost_without_wrong_bearings() -> None:
    scene = benchmark(np.random.default_rng(5), "S", "A", 60, 300)
    errors = [
        np.std(1 / maximum_likelihood(scene.given, CONSTANT_VELOCITY, loss).inverse_range().value)
        for loss in (student_t(), gross_errors(), None)
    ]
    assert errors[0] < 1.12 * errors[2]  # 4 degrees of freedom: 7 % in theory
    assert errors[1] < 1.02 * errors[2]


@pytest.mark.parametrize("wrong", [False, True])
def test_intervals_of_a_known_motion_cover(wrong: bool) -> None:
    """1000 runs, 95 % to .7 % (one sigma), with gross errors and without; Student's t has .97."""
    scene = benchmark(np.random.default_rng(8), "S", "A", 60, 1000)
    if wrong:
        scene = spoilt(np.random.default_rng(9), scene)
    found = maximum_likelihood(scene.given, CONSTANT_VELOCITY, gross_errors())
    low, high = likely_ranges(found, gross_errors())
    assert 0.93 < np.mean((low <= scene.range_m) & (scene.range_m <= high)) < 0.965
    value, sigma = found.inverse_range()
    assert 0.93 < np.mean(np.abs(value - 1 / scene.range_m) < 1.96 * sigma) < 0.965


def test_screening_finds_the_wrong_ones() -> None:
    clean = benchmark(np.random.default_rng(6), "M", "C", 10, 20)
    bad = spoilt(np.random.default_rng(7), clean)
    wrong = np.abs(bad.given.bearing_rad - clean.given.bearing_rad).T > 0.1
    left = screened(scene_of(bad.given), gross_errors()).weight > 0
    assert not (left & wrong).any()
    assert (~left & ~wrong).mean() < 0.01
    assert screened(scene_of(bad.given), None).weight.all()


@pytest.mark.parametrize("loss", [student_t(), gross_errors(), gross_errors(0.3)])
def test_the_weight_of_a_loss_is_its_slope(loss: Loss) -> None:
    squared, by_sigma = np.linspace(0, 40, 11), np.full(11, 172.0)
    cost, weight = loss(squared, by_sigma)
    step = 1e-6
    slope = (loss(squared + step, by_sigma)[0] - cost) / step
    np.testing.assert_allclose(weight, slope, rtol=1e-4, atol=1e-8)
    assert (np.diff(weight) < 0).all()
    assert loss(np.zeros(1), np.zeros(1))[0] == 0


def test_gross_errors_are_a_density() -> None:
    """Of all bearings there may be: exp(-cost / 2) is one but for a factor, the weight its part."""
    sigma, share = np.radians(2), 0.1
    angle = np.linspace(-np.pi, np.pi, 20_001)
    cost, weight = gross_errors(share)((angle / sigma) ** 2, np.full(angle.shape, 1 / sigma))
    density = np.exp(-cost / 2)
    good = np.trapezoid(weight * density, angle) / np.trapezoid(density, angle)
    assert good == pytest.approx(1 - share, rel=1e-6)


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1, np.nan])
def test_a_share_is_between_none_and_all(share: float) -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        gross_errors(share)


def test_a_motion_that_rejects_most_explains_nothing() -> None:
    residual = np.concatenate([np.zeros(5), np.full(5, 10.0)])[:, None]
    chi2, counted = kept(residual, np.ones((10, 1)))
    assert (chi2, counted) == (500.0, 10.0)
    residual[5:9] = 1.0
    chi2, counted = kept(residual, np.ones((10, 1)))
    assert (chi2, counted) == (4.0, 9.0)
