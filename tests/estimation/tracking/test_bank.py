"""The bank against one filter at a time, and against the truth it claims to know."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.consistency import mean_interval, nees
from estimation.tracking.bank import Bank, begun, carried, improved, innovations_of

Q, SIGMA_V = 0.5, 20.0


def some(rng: np.random.Generator, count: int) -> Bank:
    root = rng.normal(0, 1, (count, 4, 4)) * [30, 30, 3, 3]
    return Bank(rng.normal(0, 1000, (count, 4)), np.swapaxes(root, 1, 2) @ root)


def spreads(rng: np.random.Generator, count: int) -> Array:
    root = rng.normal(0, 40, (count, 2, 2))
    covariance: Array = np.swapaxes(root, 1, 2) @ root + 100 * np.eye(2)
    return covariance


def test_a_bank_is_its_filters_one_by_one() -> None:
    """Predicted and improved as the textbook writes it for one target; equal to rounding."""
    rng = np.random.default_rng(1)
    bank, dt = some(rng, 7), rng.uniform(-2, 5, 7)
    place, r = rng.normal(0, 1000, (7, 2)), spreads(rng, 7)
    after = improved(carried(bank, dt, Q), place, r)
    h = np.eye(2, 4)
    for i in range(7):
        f = np.eye(4) + dt[i] * np.eye(4, k=2)
        block = abs(dt[i]) * np.array([[dt[i] ** 2 / 3, dt[i] / 2], [dt[i] / 2, 1]])
        p = f @ bank.covariance[i] @ f.T + Q * np.kron(block, np.eye(2))
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r[i])
        x = f @ bank.state[i]
        np.testing.assert_allclose(after.state[i], x + gain @ (place[i] - h @ x), rtol=1e-9)
        np.testing.assert_allclose(after.covariance[i], p - gain @ h @ p, rtol=1e-6, atol=1e-6)


def test_innovations_are_those_of_the_carried_filters() -> None:
    rng = np.random.default_rng(2)
    bank, place, r = some(rng, 4), rng.normal(0, 1000, (6, 2)), spreads(rng, 6)
    dt = rng.uniform(-3, 3, (4, 6))
    found = innovations_of(bank, dt, Q, place, r)
    for j in range(6):
        there = carried(bank, dt[:, j], Q)
        s = there.covariance[:, :2, :2] + r[j]
        np.testing.assert_allclose(
            found.distance2[:, j], nees(place[j] - there.state[:, :2], s), rtol=1e-9
        )
        np.testing.assert_allclose(found.log_determinant[:, j], np.log(np.linalg.det(s)))


def test_there_and_back_costs_nothing_without_noise() -> None:
    bank = some(np.random.default_rng(3), 5)
    back = carried(carried(bank, 7.0, 0.0), -7.0, 0.0)
    np.testing.assert_allclose(back.state, bank.state)
    np.testing.assert_allclose(back.covariance, bank.covariance, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("scans", [1, 2, 5, 30])
def test_errors_are_what_the_bank_claims(scans: int) -> None:
    """1000 targets that do wander as assumed, plots at uneven times; NEES of 4 dof."""
    rng, count = np.random.default_rng(scans), 1000
    truth = np.concatenate([np.zeros((count, 2)), rng.normal(0, SIGMA_V, (count, 2))], axis=1)
    r = np.array([[900.0, 300.0], [300.0, 400.0]])
    spread = np.tile(r, (count, 1, 1))
    bank = begun(truth[:, :2] + rng.multivariate_normal([0, 0], r, count), spread, SIGMA_V)
    for _ in range(scans - 1):
        dt = rng.uniform(0.2, 3)
        noise = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) * Q
        kick = rng.multivariate_normal([0, 0], noise, (count, 2))
        truth[:, :2] += truth[:, 2:] * dt + kick[..., 0]
        truth[:, 2:] += kick[..., 1]
        plots = truth[:, :2] + rng.multivariate_normal([0, 0], r, count)
        bank = improved(carried(bank, dt, Q), plots, spread)
    low, high = mean_interval(4, count, 0.999)
    assert low < nees(truth - bank.state, bank.covariance).mean() / 4 < high


def test_what_cannot_be_inverted_is_nan_and_no_exception() -> None:
    bank = begun(np.zeros((1, 2)), np.zeros((1, 2, 2)), 0.0)
    with np.errstate(all="ignore"):
        assert np.isnan(improved(bank, np.ones((1, 2)), np.zeros((1, 2, 2))).state).any()
