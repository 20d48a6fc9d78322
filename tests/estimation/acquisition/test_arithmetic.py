"""The parts of the acquisition against dense algebra, numeric derivatives and enumeration."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import multivariate_normal

from estimation.acquisition.innovation import (
    Frames,
    fitted,
    linearised,
    log_likelihood,
    updated,
    with_covariance_along_own,
)
from estimation.acquisition.matching import all_assignments, best_assignment
from estimation.acquisition.problem import Side
from estimation.acquisition.sharing import Sharing
from estimation.arrays import Array
from estimation.frames import rotation_clockwise

SPEED_MPS = 12.0
NONE_BOUND = np.zeros((0, 2), dtype=np.intp)


def covariances(rng: np.random.Generator, shape: tuple[int, ...], size: int, scale: float) -> Array:
    root = scale * rng.standard_normal((*shape, size, size))
    return root @ root.mT + 0.1 * scale**2 * np.eye(size)


def side(rng: np.random.Generator, count: int, parts: int) -> Side:
    state = rng.uniform(-2e4, 2e4, (count, 2))
    spread = covariances(rng, (count,), 2, 150.0)
    if parts == 2:
        return Side(state, spread, np.zeros(count, dtype=bool))
    covariance = np.zeros((count, 4, 4))
    covariance[:, :2, :2] = spread
    covariance[:, 2:, 2:] = covariances(rng, (count,), 2, 1.0)
    rates = SPEED_MPS * rng.standard_normal((count, 2))
    return Side(np.concatenate([state, rates], axis=1), covariance, np.ones(count, dtype=bool))


def frames(rng: np.random.Generator, count: int) -> Frames:
    sigmas = np.array([1000, 1000, 0.02])
    shared = covariances(rng, (count,), 3, 0.5)
    return Frames(
        rng.standard_normal((count, 3)) * sigmas, shared * sigmas[:, None] * sigmas[None, :]
    )


@pytest.mark.parametrize("parts", [2, 4])
def test_derivatives_are_the_numeric_ones(parts: int) -> None:
    rng = np.random.default_rng(1)
    own, other, t = side(rng, 6, parts), side(rng, 6, parts), np.array([3e3, -2e3, 0.7])
    _, h = linearised(t, own, other)
    for k, step in enumerate((1.0, 1.0, 1e-5)):
        ahead, behind = (
            linearised(t + sign * step * np.eye(3)[k], own, other)[0] for sign in (1, -1)
        )
        numeric = (behind - ahead) / (2 * step)  # w falls as what is predicted grows
        np.testing.assert_allclose(h[..., k], numeric, rtol=1e-6, atol=1e-5)


def test_bearings_grow_with_the_turn() -> None:
    north = Side(np.array([[0.0, 1000.0]]), np.eye(2)[None], np.zeros(1, dtype=bool))
    w, _ = linearised(np.array([0.0, 0.0, np.pi / 2]), north, north)
    np.testing.assert_allclose(w, [[-1000.0, 1000.0]], atol=1e-9)  # north went east


def test_likelihood_of_places_is_the_dense_gaussian() -> None:
    rng = np.random.default_rng(2)
    own, other, some = side(rng, 5, 2), side(rng, 5, 2), frames(rng, 3)
    found = log_likelihood(some, own, other, SPEED_MPS)
    for b, k in itertools.product(range(3), range(5)):
        w, h = linearised(some.t[b], own.take(np.array([k])), other.take(np.array([k])))
        v = own.covariance[k] + other.covariance[k] + h[0] @ some.covariance[b] @ h[0].T
        assert found[b, k] == pytest.approx(multivariate_normal(cov=v).logpdf(w[0]), rel=1e-9)


def test_likelihood_with_velocities_is_the_dense_joint_gaussian() -> None:
    rng = np.random.default_rng(3)
    own, other, some = side(rng, 5, 4), side(rng, 5, 4), frames(rng, 3)
    found = log_likelihood(some, own, other, SPEED_MPS)
    for b, k in itertools.product(range(3), range(5)):
        w, h = linearised(some.t[b], own.take(np.array([k])), other.take(np.array([k])))
        v = own.covariance[k] + other.covariance[k] + h[0] @ some.covariance[b] @ h[0].T
        alone = multivariate_normal(cov=SPEED_MPS**2 * np.eye(2)).logpdf(own.state[k, 2:])
        same = multivariate_normal(cov=v).logpdf(w[0])
        assert found[b, k] == pytest.approx(same - alone, rel=1e-8)


def test_a_velocity_that_is_unknown_says_nothing() -> None:
    rng = np.random.default_rng(4)
    own, other, some = side(rng, 5, 4), side(rng, 5, 4), frames(rng, 2)
    mute = Side(own.state, own.covariance, np.zeros(5, dtype=bool))
    places = [Side(s.state[:, :2], s.covariance[:, :2, :2], s.moving) for s in (own, other)]
    np.testing.assert_allclose(
        log_likelihood(some, mute, other, SPEED_MPS), log_likelihood(some, *places, SPEED_MPS)
    )


@pytest.mark.parametrize("parts", [2, 4])
def test_an_update_is_that_of_information(parts: int) -> None:
    rng = np.random.default_rng(5)
    own, other, some = side(rng, 4, parts), side(rng, 4, parts), frames(rng, 4)
    after = updated(some, own, other)
    for b in range(4):
        w, h = linearised(some.t[b], own.take(np.array([b])), other.take(np.array([b])))
        s_inverse = np.linalg.inv(own.covariance[b] + other.covariance[b])
        covariance = np.linalg.inv(np.linalg.inv(some.covariance[b]) + h[0].T @ s_inverse @ h[0])
        np.testing.assert_allclose(after.covariance[b], covariance, rtol=1e-6, atol=1e-9)
        moved = covariance @ h[0].T @ s_inverse @ w[0]
        np.testing.assert_allclose(after.t[b] - some.t[b], moved, rtol=1e-5, atol=1e-8)


def test_the_fit_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(6)
    other, prior = side(rng, 8, 2), Frames(np.zeros((1, 3)), np.diag([1e6, 1e6, 0.01])[None])
    truth = np.array([800.0, -500.0, 0.15])
    seen = (rotation_clockwise(truth[2]) @ other.state[..., None])[..., 0] + truth[:2]
    own = side(rng, 8, 2)
    own = Side(seen + rng.normal(0, 150, seen.shape), own.covariance, own.moving)
    found = fitted(prior, prior.t[0], own, other, steps=8)
    s = own.covariance + with_covariance_along_own(other, float(found.t[0, 2])).covariance
    whiten = np.linalg.inv(np.linalg.cholesky(s))

    def residuals(z: Array) -> Array:
        w, _ = linearised(z * scale, own, other)
        return np.concatenate(
            [(whiten @ w[..., None]).ravel(), z * scale / np.sqrt([1e6, 1e6, 0.01])]
        )

    scale = np.array([100.0, 100.0, 0.01])
    best = least_squares(residuals, np.zeros(3), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    sigmas = np.sqrt(np.diag(found.covariance[0]))
    np.testing.assert_allclose((best.x * scale - found.t[0]) / sigmas, 0, atol=1e-4)


def assignments(rows: int, columns: int) -> list[list[tuple[int, int]]]:
    """All partial assignments."""
    return [
        list(zip(some, order, strict=True))
        for size in range(min(rows, columns) + 1)
        for some in itertools.combinations(range(rows), size)
        for order in itertools.permutations(range(columns), size)
    ]


@pytest.mark.parametrize("seed", range(5))
def test_the_best_assignment_is_the_best_of_all(seed: int) -> None:
    ratio = np.random.default_rng(seed).normal(0, 3, (4, 3))
    found = best_assignment(ratio, NONE_BOUND)
    best = max(sum(ratio[i, j] for i, j in each) for each in assignments(4, 3))
    assert ratio[found.own, found.other].sum() == pytest.approx(best)


def test_a_bound_pair_is_taken_at_any_price() -> None:
    ratio = np.array([[5.0, -40.0], [-np.inf, 5.0]])
    found = best_assignment(ratio, np.array([[0, 1]]))
    assert (list(found.own), list(found.other)) == ([0], [1])


def test_the_sum_over_assignments_is_exact_on_a_tree() -> None:
    ratio = np.full((3, 3), -np.inf)
    ratio[0, 0], ratio[0, 1], ratio[1, 1], ratio[1, 2], ratio[2, 2] = 2.0, 1.0, 3.0, -1.0, 0.5
    weights = {tuple(each): np.exp(sum(ratio[i, j] for i, j in each)) for each in assignments(3, 3)}
    total, probability = all_assignments(ratio)
    assert total == pytest.approx(np.log(sum(weights.values())), abs=1e-5)
    one = sum(w for each, w in weights.items() if (0, 1) in each) / sum(weights.values())
    assert probability[0, 1] == pytest.approx(one, abs=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_the_sum_over_assignments_is_near_with_loops(seed: int) -> None:
    ratio = np.random.default_rng(seed).normal(0, 2, (4, 4))
    exact = np.log(sum(np.exp(sum(ratio[i, j] for i, j in each)) for each in assignments(4, 4)))
    assert all_assignments(ratio)[0] == pytest.approx(exact, abs=0.35)  # Bethe, all pairs allowed


def test_shares_are_weighed_as_their_sum() -> None:
    sharing, shares = Sharing.of(5, 8, 2e8), (np.arange(40) + 0.5) / 40 * 5

    def evidence(pairs: int) -> float:
        alone = (5 - shares) ** (5 - pairs) * (8 - shares) ** (8 - pairs)
        return float(np.sum((2e8 * shares) ** pairs * alone * np.exp(shares)))

    assert sharing.log_weight(3) == pytest.approx(np.log(evidence(3) / evidence(0)))
    assert sharing.worth(5) > sharing.worth(3) > sharing.worth(0)
