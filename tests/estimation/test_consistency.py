"""Normalised errors against their own statistics."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.consistency import mean_interval, nees, nis, rms

COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]])


def test_honest_errors_fall_in_the_interval() -> None:
    errors = np.random.default_rng(1).multivariate_normal(np.zeros(3), COVARIANCE, 5000)
    low, high = mean_interval(3, 5000)
    assert low < nees(errors, COVARIANCE).mean() / 3 < high
    assert nees(1.2 * errors, COVARIANCE).mean() / 3 > high
    np.testing.assert_array_equal(nis(errors, COVARIANCE), nees(errors, COVARIANCE))


def test_the_interval_holds_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    low, high = mean_interval(2, 50, confidence=0.9)
    means = rng.chisquare(2, (20_000, 50)).mean(axis=1) / 2
    inside = np.mean((means > low) & (means < high))
    assert inside == pytest.approx(0.9, abs=0.01)  # 20 000 draws: sigma .002


def test_batches_of_covariances() -> None:
    errors = np.random.default_rng(3).normal(size=(4, 2, 3))
    covariances = COVARIANCE * np.arange(1.0, 5.0)[:, None, None, None]
    batch = nees(errors, covariances)
    expected = errors[3, 1] @ np.linalg.inv(covariances[3, 0]) @ errors[3, 1]
    assert batch.shape == (4, 2)
    assert batch[3, 1] == pytest.approx(expected)


def test_rms() -> None:
    assert rms([3.0, 4.0]) == pytest.approx(np.sqrt(12.5))
    np.testing.assert_allclose(rms([[3.0, 4.0], [0.0, 0.0]], axis=1), [np.sqrt(12.5), 0.0])
