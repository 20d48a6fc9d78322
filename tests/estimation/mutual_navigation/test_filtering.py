"""Joint filtering: equal to dense least squares, honest when only some are corrected."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.navigation import mutual
from estimation.mutual_navigation import (
    Gaussian,
    Pair,
    Scalar,
    Step,
    Wander,
    by_cosines,
    corrected,
    joint_start,
    joint_step,
    links,
    modified_update,
    network,
    predicted,
    seen,
    smoothed,
    updated,
)


def gaussian(rng: np.random.Generator, size: int) -> Gaussian:
    root = rng.standard_normal((size, size))
    return Gaussian(rng.standard_normal(size), root @ root.T + 0.1 * np.eye(size))


def test_the_papers_equations_are_the_kalman_filter() -> None:
    assert mutual.equations_differ(1, 200) < 1e-10


def test_a_correlation_of_one_is_refused() -> None:
    with pytest.raises(ValueError, match="between -1 and 1"):
        modified_update(Scalar(0, 1), Pair((0, 0), (1, 1), (1, 1), 1.0))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 8), rows=st.integers(1, 6))
def test_information_form_is_the_filter(seed: int, size: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    known = gaussian(rng, size)
    h, noise = rng.standard_normal((rows, size)), gaussian(rng, rows).covariance
    innovation = rng.standard_normal(rows)
    after = updated(known, innovation, h, noise)
    information = np.linalg.inv(known.covariance) + h.T @ np.linalg.solve(noise, h)
    dense = np.linalg.inv(information)
    tolerance = 1e-8 * np.abs(known.covariance).max() * max(1.0, np.linalg.cond(noise) * 1e-6)
    np.testing.assert_allclose(after.covariance, dense, atol=tolerance)
    moved = dense @ h.T @ np.linalg.solve(noise, innovation)
    np.testing.assert_allclose(after.mean - known.mean, moved, atol=1e-6 * (1 + abs(moved).max()))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), chosen=st.integers(0, 5))
def test_a_measurement_makes_nobody_less_certain(seed: int, chosen: int) -> None:
    """Whoever is corrected gains; who is only considered keeps what it had, to the last bit."""
    rng = np.random.default_rng(seed)
    known = gaussian(rng, 6)
    h, noise = rng.standard_normal((2, 6)), np.eye(2)
    improves = np.arange(chosen)
    after = updated(known, rng.standard_normal(2), h, noise, improves)
    left = np.setdiff1d(np.arange(6), improves)
    both = np.ix_(left, left)
    np.testing.assert_allclose(after.covariance[both], known.covariance[both], rtol=1e-12)
    np.testing.assert_array_equal(after.mean[left], known.mean[left])
    assert np.all(np.diag(after.covariance) <= np.diag(known.covariance) * (1 + 1e-9))
    full = updated(known, np.zeros(2), h, noise)
    assert np.all(np.diag(full.covariance) <= np.diag(after.covariance) * (1 + 1e-9))


def test_considered_covariances_are_the_true_ones() -> None:
    """Many draws through the one-way update scatter as it says."""
    rng = np.random.default_rng(5)
    known = gaussian(rng, 4)
    h, noise = rng.standard_normal((2, 4)), np.array([[2.0, 0.8], [0.8, 1.0]])
    runs = 20_000
    errors = rng.multivariate_normal(np.zeros(4), known.covariance, runs)  # estimate less truth
    measured = -errors @ h.T + rng.multivariate_normal(np.zeros(2), noise, runs)
    improves = np.array([0, 1])
    after = updated(known, np.zeros(2), h, noise, improves)
    ends = np.array(
        [
            updated(known._replace(mean=e), i, h, noise, improves).mean
            for e, i in zip(errors[:4000], measured[:4000], strict=True)
        ]
    )
    sample = ends.T @ ends / len(ends)
    # the scatter of a sample covariance of 4000 is some 2 % of the diagonal; five of them
    scale = np.sqrt(np.outer(np.diag(after.covariance), np.diag(after.covariance)))
    assert np.abs((sample - after.covariance) / scale).max() < 0.12


def test_a_wrong_gain_is_told_its_price() -> None:
    rng = np.random.default_rng(6)
    known = gaussian(rng, 3)
    h, noise = rng.standard_normal((1, 3)), np.eye(1)
    best = updated(known, np.zeros(1), h, noise)
    none = corrected(known, np.zeros(1), h, noise, np.zeros((3, 1)))
    np.testing.assert_allclose(none.covariance, known.covariance)
    worse = corrected(known, np.zeros(1), h, noise, np.full((3, 1), 0.3))
    assert np.trace(worse.covariance) > np.trace(best.covariance)


def test_smoothing_is_least_squares_over_all_instants() -> None:
    rng = np.random.default_rng(7)
    f, q = np.array([[1.0, 1.0], [0.0, 0.9]]), np.diag([0.1, 0.2])
    h, r = np.array([[1.0, 0.0]]), np.array([[0.5]])
    state, steps = gaussian(rng, 2), []
    first, values = state, rng.standard_normal(6)
    for value in values:
        ahead = predicted(state, f, q)
        state = updated(ahead, np.array([value]) - h @ ahead.mean, h, r)
        steps.append(Step(f, ahead, state))
    found = smoothed(steps)
    mean, covariance = dense(first, f, q, h, r, values)
    np.testing.assert_allclose([g.mean for g in found], mean, atol=1e-8)
    np.testing.assert_allclose([g.covariance for g in found], covariance, atol=1e-8)
    assert smoothed([]) == []


def dense(
    first: Gaussian, f: np.ndarray, q: np.ndarray, h: np.ndarray, r: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """All instants (n, 2) at once, by the normal equations."""
    n = len(values)
    information, vector = np.zeros((2 * n + 2, 2 * n + 2)), np.zeros(2 * n + 2)
    information[:2, :2] = np.linalg.inv(first.covariance)
    vector[:2] = information[:2, :2] @ first.mean
    for k in range(n):
        row = np.zeros((2, 2 * n + 2))
        row[:, 2 * k : 2 * k + 2], row[:, 2 * k + 2 : 2 * k + 4] = -f, np.eye(2)
        information += row.T @ np.linalg.solve(q, row)
        seen_row = np.zeros((1, 2 * n + 2))
        seen_row[:, 2 * k + 2 : 2 * k + 4] = h
        information += seen_row.T @ seen_row / r[0, 0]
        vector += seen_row[0] * values[k] / r[0, 0]
    covariance = np.linalg.inv(information)
    mean = (covariance @ vector)[2:].reshape(n, 2)
    blocks = [covariance[2 * k + 2 : 2 * k + 4, 2 * k + 2 : 2 * k + 4] for k in range(n)]
    return mean, np.array(blocks)


def test_steps_compose() -> None:
    """Twice two seconds are four: transition and noise are exact in continuous time."""
    wander = Wander(clock_walk_m_root_s=0.5)
    f2, q2 = wander.step(2.0)
    f4, q4 = wander.step(4.0)
    np.testing.assert_allclose(f2 @ f2, f4, atol=1e-12)
    np.testing.assert_allclose(f2 @ q2 @ f2.T + q2, q4, rtol=1e-4, atol=1e-9)
    far = Wander(memory_velocity_s=5.0)
    f3, q3 = far.step(3.0)
    _, q6 = far.step(6.0)
    np.testing.assert_allclose(f3 @ q3 @ f3.T + q3, q6, rtol=1e-9, atol=1e-12)


def test_the_markov_errors_keep_their_sigma() -> None:
    wander = Wander()
    transition, noise = wander.step(700.0)
    later = transition @ wander.start @ transition.T + noise
    index = [2, 3, 4]
    np.testing.assert_allclose(np.diag(later)[index], np.diag(wander.start)[index])


def test_pseudorange_rows_are_derivatives() -> None:
    rng = np.random.default_rng(8)
    net = network(2, 1, 1)
    places = rng.uniform(-1e4, 1e4, (4, 3))
    heard = links([(0, 1), (1, 2), (0, 3), (1, 0)], 5.0)
    mean = rng.standard_normal(net.size) * 10
    base = seen(net, places, mean, heard)
    for state in range(net.size):
        step = np.zeros(net.size)
        step[state] = 1e-2
        change = base.innovation - seen(net, places, mean + step, heard).innovation
        np.testing.assert_allclose(base.by_state[:, state], change / 1e-2, atol=1e-4)


def test_cosines_make_four_sources_singular() -> None:
    rng = np.random.default_rng(9)
    noise = by_cosines(rng.standard_normal((4, 3)), np.ones(4))
    assert np.linalg.matrix_rank(noise) == 3
    np.testing.assert_allclose(np.diag(noise), 1)


def test_joint_step_has_everybody_apart() -> None:
    transition, noise = joint_step([Wander(), Wander()], 2.0, [(30.0, 600.0)])
    assert transition.shape == noise.shape == (17, 17)
    assert np.all(transition[:7, 7:] == 0)
    assert joint_start([Wander()], [(30.0, 600.0)])[-1, -1] == 900
