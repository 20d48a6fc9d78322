"""The banded, bordered solver against the same least squares written out in full."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.arrays import Array
from estimation.bordered import (
    Chain,
    Linearised,
    Observed,
    block_covariances,
    last_covariance,
    minimise,
)


class Linear:
    """A random linear problem of n blocks of b, T constants, m rows of single epochs."""

    def __init__(self, rng: np.random.Generator, n: int, b: int, count: int, m: int) -> None:
        self.n, self.b, self.count = n, b, count
        self.chain = Chain(
            rng.standard_normal((n, b)),
            rng.standard_normal((n, b, b)),
            3 * np.eye(b) + rng.standard_normal((n, b, b)),
            rng.standard_normal((n, b, count)),
        )
        self.observed = Observed(
            rng.integers(0, n, m),
            rng.standard_normal(m),
            rng.standard_normal((m, b)),
            rng.standard_normal((m, count)),
        )

    def __call__(self, x: Array, theta: Array) -> Linearised:
        chain, seen = self.chain, self.observed
        before = np.vstack([np.zeros(self.b), x[:-1]])
        steps = chain.residual + np.einsum("krb,kb->kr", chain.by_epoch, x)
        steps = steps + np.einsum("krb,kb->kr", chain.by_previous, before) + chain.by_theta @ theta
        rows = seen.residual + np.sum(seen.by_epoch * x[seen.epoch], axis=1)
        rows = rows + seen.by_theta @ theta
        cost = float(np.sum(steps**2) + np.sum(rows**2) + theta @ theta)
        here = chain._replace(residual=steps), seen._replace(residual=rows)
        return Linearised(*here, theta, np.eye(self.count), cost)

    def dense(self) -> tuple[Array, Array]:
        """All rows, and their residuals at zero, by (x, theta)."""
        size = self.n * self.b
        rows, right = [], []
        for k in range(self.n):
            for r in range(self.b):
                row = np.zeros(size + self.count)
                row[k * self.b : (k + 1) * self.b] = self.chain.by_epoch[k, r]
                if k:
                    row[(k - 1) * self.b : k * self.b] = self.chain.by_previous[k, r]
                row[size:] = self.chain.by_theta[k, r]
                rows.append(row)
                right.append(self.chain.residual[k, r])
        for i, k in enumerate(self.observed.epoch):
            row = np.zeros(size + self.count)
            row[k * self.b : (k + 1) * self.b] = self.observed.by_epoch[i]
            row[size:] = self.observed.by_theta[i]
            rows.append(row)
            right.append(self.observed.residual[i])
        rows += list(np.eye(size + self.count)[size:])
        return np.array(rows), np.array([*right, *np.zeros(self.count)])


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 7),
    b=st.integers(1, 4),
    count=st.integers(1, 4),
    m=st.integers(0, 12),
)
def test_banded_is_dense(seed: int, n: int, b: int, count: int, m: int) -> None:
    problem = Linear(np.random.default_rng(seed), n, b, count, m)
    found = minimise(problem, np.zeros((n, b)), np.zeros(count))
    rows, right = problem.dense()
    covariance = np.linalg.inv(rows.T @ rows)
    best = -covariance @ rows.T @ right
    size = n * b
    scale = np.linalg.cond(rows) ** 2 * 1e-13 + 1e-8  # what the normal equations can hold
    np.testing.assert_allclose(found.x.ravel(), best[:size], atol=scale * (1 + abs(best).max()))
    np.testing.assert_allclose(found.theta, best[size:], atol=scale * (1 + abs(best).max()))
    largest = abs(covariance).max()
    np.testing.assert_allclose(found.covariance, covariance[size:, size:], atol=scale * largest)
    last = np.r_[size - b : size + count]
    np.testing.assert_allclose(
        last_covariance(found), covariance[np.ix_(last, last)], atol=scale * largest
    )
    for k, block in enumerate(block_covariances(found)):
        own = slice(k * b, (k + 1) * b)
        np.testing.assert_allclose(block, covariance[own, own], atol=scale * largest)


def test_a_bent_valley_is_followed_to_its_end() -> None:
    """A distance known a thousand times better than the prior: a quarter of a circle to go.

    It takes 560 steps; damped by the diagonal, which the distance fills, 1400.
    """
    mean = np.array([0.0, 1.0])

    def ring(x: Array, theta: Array) -> Linearised:
        chain = Chain(x, -np.ones((1, 1, 1)), np.ones((1, 1, 1)), np.zeros((1, 1, 2)))
        far = np.linalg.norm(theta)
        value, slope = 1e3 * (far - 1.0), 1e3 * theta / far
        seen = Observed(np.zeros(1, dtype=np.intp), value[None], np.zeros((1, 1)), slope[None])
        cost = float(np.sum(x**2) + value**2 + np.sum((theta - mean) ** 2))
        return Linearised(chain, seen, theta - mean, np.eye(2), cost)

    found = minimise(ring, np.zeros((1, 1)), np.array([1.0, 0.0]), most=700)
    assert found.converged
    np.testing.assert_allclose(found.theta, mean, atol=1e-3)


def test_a_step_that_does_not_pay_is_damped() -> None:
    """Gauss-Newton from 3 on arctan runs away; damped steps do not."""

    def bent(x: Array, theta: Array) -> Linearised:
        chain = Chain(x, -np.ones((1, 1, 1)), np.ones((1, 1, 1)), np.zeros((1, 1, 1)))
        value, slope = np.arctan(theta), 1 / (1 + theta**2)
        seen = Observed(np.zeros(1, dtype=np.intp), value, np.zeros((1, 1)), slope[:, None])
        cost = float(np.sum(x**2) + value @ value)
        return Linearised(chain, seen, np.zeros(0), np.zeros((0, 1)), cost)

    found = minimise(bent, np.zeros((1, 1)), np.array([3.0]))
    assert found.converged
    assert found.theta[0] == pytest.approx(0, abs=1e-3)
