"""Small systems, scenes, starts, descents: the parts under every method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.bearings_only.scenes import MOTIONS, benchmark, ensemble
from bench.bearings_only.unknown import seed_errors
from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_VELOCITY,
    FAMILY,
    THREE_LEGS,
    TWO_LEGS,
    Bearings,
    Estimate,
    Motion,
    MotionPrior,
    bearings,
    cramer_rao,
    n_polynomials,
    polynomial,
)
from estimation.bearings_only.criterion import criterion
from estimation.bearings_only.family import modes, second_turns
from estimation.bearings_only.fitting import begun, grid_of, lowest
from estimation.bearings_only.levenberg_marquardt import minimised
from estimation.bearings_only.linear_algebra import cholesky, inverted, log_determinant, solved
from estimation.bearings_only.measurements import padded, scene_of
from estimation.bearings_only.normal_equations import Normal
from estimation.bearings_only.starts import lines_of, misfit, ridge, scales_of, taubin


def positive(size: int, batch: int, seed: int = 1) -> Array:
    """Well-conditioned symmetric matrices (M, M, B)."""
    roots = np.random.default_rng(seed).normal(size=(batch, size, size + 3))
    return np.ascontiguousarray(np.moveaxis(roots @ np.swapaxes(roots, 1, 2), 0, 2))


@pytest.mark.parametrize("size", [1, 2, 5, 11])
def test_systems_are_solved(size: int) -> None:
    matrix, right = positive(size, 7), np.random.default_rng(2).normal(size=(size, 7))
    factor = cholesky(matrix)
    x = solved(factor, right)
    np.testing.assert_allclose(np.einsum("ijb,jb->ib", matrix, x), right, atol=1e-9)
    expected = np.linalg.slogdet(np.moveaxis(matrix, 2, 0))[1]
    np.testing.assert_allclose(log_determinant(factor), expected, atol=1e-9)
    product = np.einsum("ijb,jkb->ikb", matrix, inverted(matrix))
    np.testing.assert_allclose(product, np.eye(size)[..., None] + 0 * product, atol=1e-7)


def test_a_singular_system_knows_one_direction_badly() -> None:
    matrix = np.array([[1.0, 1.0], [1.0, 1.0]])[..., None]
    covariance = inverted(matrix)[..., 0]
    assert covariance[0, 0] > 1e10
    along = np.ones(2)
    np.testing.assert_allclose(matrix[..., 0] @ covariance @ matrix[..., 0] @ along, 2, rtol=0.1)
    with np.errstate(over="ignore"):
        assert (np.einsum("iib->ib", inverted(np.zeros((3, 3, 2)))) > 1e10).all()


def test_systems_of_a_batch_do_not_meet() -> None:
    matrix, right = positive(5, 4), np.ones((5, 4))
    together = solved(cholesky(matrix), right)
    for b in range(4):
        one = slice(b, b + 1)
        alone = solved(cholesky(matrix[..., one]), right[:, one])
        np.testing.assert_array_equal(together[:, one], alone)


class Bowl(NamedTuple):
    """Rosenbrock's valley for several targets, without a gauge."""

    scale: Array

    def evaluate(self, p: Array) -> Normal:
        residual = np.stack([self.scale * (p[1] - p[0] ** 2), 1 - p[0]])
        jacobian = np.zeros((2, 2, p.shape[1]))
        jacobian[0, 0], jacobian[0, 1] = -2 * self.scale * p[0], self.scale
        jacobian[1, 0] = -1
        return Normal(
            (residual**2).sum(axis=0),
            np.einsum("rmb,rb->mb", jacobian, residual),
            np.einsum("rmb,rnb->mnb", jacobian, jacobian),
        )

    def admissible(self, p: Array) -> Array:
        return p

    def gauge(self, p: Array) -> Array:
        return np.zeros_like(p)

    def take(self, columns: NDArray[np.int_]) -> Bowl:
        return Bowl(self.scale[columns])


def test_a_crooked_valley_is_followed_to_its_end() -> None:
    start = np.array([[-1.2, -1.2, 1.0], [1.0, 1.0, 1.0]])
    end = minimised(Bowl(np.array([1.0, 10.0, 3.0])), start, steps=300, settled=1e-12)
    assert end.converged.all()
    np.testing.assert_allclose(end.p, 1.0, atol=1e-4)
    np.testing.assert_allclose(end.normal.cost, 0, atol=1e-8)


def test_too_few_steps_are_not_called_an_end() -> None:
    end = minimised(Bowl(np.array([10.0])), np.array([[-1.2], [1.0]]), steps=2)
    assert not end.converged.any()


def test_a_scene_has_units_of_its_own() -> None:
    given = benchmark(np.random.default_rng(1), "S", "A", 10, 3).given
    scene = scene_of(given)
    assert scene.time[0, 0] == -1
    assert scene.time[-1, 0] == 1
    assert abs(scene.observer.mean()) < 1e-12
    assert np.mean(np.abs(scene.observer) ** 2) == pytest.approx(1)
    assert scene.shared
    assert scene.targets == 3
    part = scene.take(np.array([2, 2, 0, 1]))
    assert part.targets == 4
    np.testing.assert_array_equal(part.toward[:, 1], scene.toward[:, 2])


def test_a_scene_holds_no_nan() -> None:
    given = bearings(
        [0.0, 1.0, np.nan, 3.0], [[0, 0], [np.inf, 0], [1, 1], [2, 2]], [0.1, 0.2, 0.3, np.nan], 0.1
    )
    scene = scene_of(given)
    assert scene.seen.tolist() == [1]
    for field in scene:
        assert np.isfinite(field).all()


def test_no_bearing_is_one_that_was_not_seen() -> None:
    none = bearings(np.zeros(0), np.zeros((0, 2)), np.zeros(0), 0.1)
    assert padded(none).bearing_rad.shape == (1,)
    assert scene_of(none).seen.tolist() == [0]
    one = bearings(np.zeros(1), np.zeros((1, 2)), np.zeros(1), 0.1)
    assert padded(one) is one


@pytest.mark.parametrize("kind", "AC")
def test_taubin_is_exact_without_noise(kind: str) -> None:
    scene = benchmark(np.random.default_rng(2), "M", kind, 1e-6, 2)
    motion = MOTIONS[kind]
    lines = lines_of(scene_of(scene.given), motion, grid_of(motion))
    start = taubin(lines)
    np.testing.assert_allclose(misfit(lines, start), 0, atol=100)  # of sigmas of 1e-6 minutes
    problem = criterion(scene_of(scene.given), motion)
    end = minimised(problem, start)
    np.testing.assert_allclose(end.p / end.p[-1], start / start[-1], rtol=1e-4, atol=1e-4)


def test_taubin_is_less_biased_than_least_squares() -> None:
    scene = benchmark(np.random.default_rng(3), "S", "A", 60, 300)
    problem = criterion(scene_of(scene.given), CONSTANT_VELOCITY)
    p = taubin(lines_of(problem.scene, CONSTANT_VELOCITY, grid_of(CONSTANT_VELOCITY)))
    at = problem.evaluate(problem.admissible(p))
    start = Estimate(problem.scene, CONSTANT_VELOCITY, p, at.matrix, at.cost, at.cost > 0)
    closed = np.median(1 / start.inverse_range().value / scene.range_m - 1)
    naive = np.median(seed_errors(scene, n_polynomials(scene.given, 1))[0]) / 100
    assert abs(closed) < 0.3 * abs(naive)


def test_a_ridge_start_lies_at_its_range() -> None:
    """A carrier that does not turn: the assumed range is all there is."""
    t = np.arange(20) * 10.0
    given = bearings(t, np.stack([3 * t, 0 * t], axis=1), np.full(20, 0.3), 0.01)
    scene, prior = scene_of(given), MotionPrior()
    lines = lines_of(scene, CONSTANT_VELOCITY, grid_of(CONSTANT_VELOCITY))
    scales = scales_of(scene, CONSTANT_VELOCITY, prior)
    for range_m in (1000.0, 8000.0):
        p = ridge(lines, scales, range_m / scene.length_m)
        place = np.hypot(p[0], p[2]) / p[4] * scene.length_m
        assert place[0] == pytest.approx(range_m, rel=0.1)


@pytest.mark.parametrize("motion", [*FAMILY, THREE_LEGS], ids=lambda motion: motion.name)
def test_starts_are_sorted_and_descents_only_descend(motion: Motion) -> None:
    scene = scene_of(benchmark(np.random.default_rng(4), "S", "D", 10, 2).given)
    problem = criterion(scene, motion, MotionPrior())
    with np.errstate(all="ignore"):  # as all entry points do
        starts = begun(problem, grid_of(motion), scene)
        assert starts.shape[1:] == (motion.size, 2)
        first = problem.evaluate(problem.admissible(starts[0])).cost
        end = lowest(problem, starts[:4])
    assert (end.normal.cost <= np.nan_to_num(first, nan=np.inf) + 1e-9).all()


def test_evidence_prefers_the_simpler_of_two_that_fit() -> None:
    scene = scene_of(benchmark(np.random.default_rng(5), "M", "A", 60, 10).given)
    found = [
        modes(criterion(scene, m, MotionPrior()), grid_of(m), scene)[0]
        for m in (CONSTANT_VELOCITY, polynomial(2), TWO_LEGS)
    ]
    simple, *others = (h.log_evidence for h in found)
    for other in others:
        assert (simple > other).mean() > 0.8
    # and the more complicated one fits better all the same
    assert (found[1].estimate.chi2 <= found[0].estimate.chi2 + 0.5).all()
    assert (found[0].dof >= found[1].dof - 0.5).all()


def test_dof_counts_what_the_bearings_determine() -> None:
    scene = scene_of(benchmark(np.random.default_rng(6), "M", "A", 10, 5).given)
    (found,) = modes(
        criterion(scene, CONSTANT_VELOCITY, MotionPrior()), grid_of(CONSTANT_VELOCITY), scene
    )
    np.testing.assert_allclose(found.dof, 41 - 4, atol=0.1)
    assert (found.alone.sigma >= found.aided.sigma * 0.999).all()


def test_second_turns_come_in_order_of_time() -> None:
    shapes = second_turns(np.array([[0.5, -0.5], [0.1, -0.6], [-1.0, -1.5]]))
    assert shapes.shape[0] == 6
    assert (shapes[1] <= shapes[4]).all()
    known = (shapes[0] == 0.5) | (shapes[3] == 0.5)
    assert known[:, 0].all()


def test_the_bound_of_a_batch_is_that_of_its_members() -> None:
    scene = ensemble(np.random.default_rng(7), "uniform", 3)
    for i in range(3):
        one = Bearings(*(np.asarray(field[i]) for field in scene.given))
        span = one.t_s[-1] - one.t_s[0]
        found = cramer_rao(one, CONSTANT_VELOCITY, _coefficients(scene.place_m[i], span))
        assert found.inverse_range().value[0] == pytest.approx(1 / scene.range_m[i], rel=1e-6)


def _coefficients(place_m: Array, span_s: float) -> NDArray[np.complex128]:
    """A motion that ends at a place."""
    velocity = 3.0 - 2.0j
    return np.array([complex(*place_m) - velocity * span_s / 2, velocity])
