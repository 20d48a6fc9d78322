"""Motions: derivatives are derivatives, special cases meet, speeds are what the name says."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_VELOCITY,
    FAMILY,
    FINITE_TURN,
    STRAIGHT_ACCELERATED,
    THREE_LEGS,
    TURN_RATE,
    TWO_LEGS,
    Motion,
    MotionPrior,
    bearings,
    polynomial,
)
from estimation.bearings_only.criterion import criterion
from estimation.bearings_only.measurements import Scene, scene_of
from estimation.bearings_only.normal_equations import residuals
from estimation.bearings_only.prior import prior_rows

TIME = np.linspace(-1, 1, 81)[:, None]
SHAPED = [motion for motion in (*FAMILY, THREE_LEGS) if motion.shape_names]
SHAPES = {
    "kappa": 0.6,
    "omega": 1.3,
    "angle": -1.1,
    "middle": 0.13,
    "duration": -1.2,
}
EVERY = pytest.mark.parametrize("motion", [*FAMILY, THREE_LEGS], ids=lambda motion: motion.name)


def shape_of(motion: Motion) -> Array:
    """Some shape (P, 1), the second turn later than the first."""
    shape = np.array([SHAPES[name] for name in motion.shape_names])
    if motion is THREE_LEGS:
        shape[1], shape[3], shape[4] = -0.5, 0.8, 0.5
    return shape[:, None]


@pytest.mark.parametrize("motion", SHAPED, ids=lambda motion: motion.name)
def test_slopes_are_derivatives(motion: Motion) -> None:
    shape, step = shape_of(motion), 1e-6
    _, slopes = motion.basis(TIME, shape)
    for k in range(len(shape)):
        up, down = shape.copy(), shape.copy()
        up[k] += step
        down[k] -= step
        change = (motion.basis(TIME, up)[0][1] - motion.basis(TIME, down)[0][1]) / (2 * step)
        np.testing.assert_allclose(slopes[k], change, atol=1e-5)  # a kink is 1e-6 wide


@pytest.mark.parametrize("motion", [TURN_RATE, TWO_LEGS, FINITE_TURN, THREE_LEGS])
def test_turns_keep_the_speed(motion: Motion) -> None:
    fine = np.linspace(-1, 1, 20001)[:, None]
    path = motion.basis(fine, shape_of(motion))[0][1][:, 0]
    speed = np.abs(np.diff(path)) / (fine[1, 0] - fine[0, 0])
    assert np.mean(np.abs(speed - 1) > 1e-6) < 1e-3  # the corner of two legs is within one step


def test_a_turn_to_the_right_is_positive() -> None:
    """North first: after a quarter turn to the right the target moves east."""
    shape = np.array([[np.pi / 2], [0.0], [-2.0]])
    path = FINITE_TURN.basis(TIME, shape)[0][1][:, 0] * 1j
    np.testing.assert_allclose(np.diff(path)[-1] / 0.025, 1, atol=1e-9)
    circle = TURN_RATE.basis(TIME, np.array([[0.5]]))[0][1][:, 0] * 1j
    assert circle[-1].real > 0


def test_no_turn_is_constant_velocity() -> None:
    for motion in (TURN_RATE, STRAIGHT_ACCELERATED):
        np.testing.assert_allclose(motion.basis(TIME, np.zeros((1, 1)))[0][1], TIME, atol=1e-12)
    straight = np.array([[0.0], [0.2], [-1.0]])
    np.testing.assert_allclose(FINITE_TURN.basis(TIME, straight)[0][1], TIME, atol=1e-12)
    both = np.concatenate([straight, straight])
    np.testing.assert_allclose(THREE_LEGS.basis(TIME, both)[0][1], TIME, atol=1e-12)


def test_a_turn_in_no_time_is_two_legs() -> None:
    legs = TWO_LEGS.basis(TIME, np.array([[0.9], [0.11]]))[0][1]
    turn = FINITE_TURN.basis(TIME, np.array([[0.9], [0.11], [-14.0]]))[0][1]
    np.testing.assert_allclose(turn, legs, atol=1e-5)


def test_three_legs_without_the_second_turn_are_one_turn() -> None:
    first = np.array([[0.9], [-0.4], [-1.5]])
    both = np.concatenate([first, [[0.0], [0.5], [-1.5]]])
    np.testing.assert_allclose(
        THREE_LEGS.basis(TIME, both)[0][1], FINITE_TURN.basis(TIME, first)[0][1], atol=1e-12
    )


def test_coefficients_of_polynomials_are_derivatives() -> None:
    f, _ = polynomial(4).basis(TIME, np.zeros((0, 1)))
    np.testing.assert_allclose(f[4], TIME**4 / 24)


def a_scene(targets: int = 2) -> Scene:
    t = np.arange(12) * 30.0
    places = np.stack([4 * t, np.abs(t - 150)], axis=1)
    rng = np.random.default_rng(2)
    return scene_of(bearings(t, places, rng.uniform(-0.5, 0.5, (targets, 12)), 0.01))


def parameters(motion: Motion, targets: int = 2) -> Array:
    p = np.random.default_rng(3).normal(size=(motion.size, targets)) * 0.3
    p[motion.degree + 1] += 2  # in front, to the north
    p[motion.scale_row] = 0.4
    p[motion.scale_row + 1 :] = shape_of(motion)
    return p


@EVERY
def test_jacobian_of_the_bearings(motion: Motion) -> None:
    scene, p, step = a_scene(), parameters(motion), 1e-6
    _, jacobian = residuals(scene, motion, p)
    for k in range(motion.size):
        shift = np.zeros_like(p)
        shift[k] = step
        up, down = (residuals(scene, motion, p + sign * shift)[0] for sign in (1, -1))
        change = scene_wrapped(scene, up - down) / (2 * step)
        np.testing.assert_allclose(jacobian[k], change, rtol=1e-4, atol=1e-3)


def scene_wrapped(scene: Scene, difference: Array) -> Array:
    """Standardised angles across the cut."""
    turn = 2 * np.pi * scene.weight
    return np.asarray(difference - turn * np.round(difference / turn))


@EVERY
def test_jacobian_of_the_prior(motion: Motion) -> None:
    scene, p, step = a_scene(), parameters(motion), 1e-6
    rows = prior_rows(scene, motion, MotionPrior(), p)
    for k in range(motion.size):
        shift = np.zeros_like(p)
        shift[k] = step
        up, down = (
            prior_rows(scene, motion, MotionPrior(), p + s * shift).residual for s in (1, -1)
        )
        np.testing.assert_allclose(rows.jacobian[k], (up - down) / (2 * step), rtol=1e-4, atol=1e-5)


@EVERY
def test_the_length_of_homogeneous_parameters_means_nothing(motion: Motion) -> None:
    scene, p = a_scene(), parameters(motion)
    problem = criterion(scene, motion, MotionPrior())
    scaled = p.copy()
    scaled[: motion.scale_row + 1] *= 7.0
    np.testing.assert_allclose(problem.evaluate(p).cost, problem.evaluate(scaled).cost, rtol=1e-10)
    along = np.einsum("ijb,jb->ib", problem.evaluate(p).matrix, problem.gauge(p))
    np.testing.assert_allclose(along, 0, atol=1e-6 * np.abs(problem.evaluate(p).matrix).max())


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_tables_give_the_same_normal_equations(degree: int) -> None:
    scene, p = a_scene(), parameters(polynomial(degree))
    fast = criterion(scene, polynomial(degree))
    slow = fast._replace(tables=None)
    assert fast.tables is not None
    for one, other in zip(fast.evaluate(p), slow.evaluate(p), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


def test_what_is_not_seen_counts_nothing() -> None:
    scene, p = a_scene(), parameters(CONSTANT_VELOCITY)
    blind = scene._replace(weight=np.where(np.arange(12)[:, None] < 5, scene.weight, 0.0))
    cost = criterion(blind, CONSTANT_VELOCITY).evaluate(p).cost
    residual, _ = residuals(scene, CONSTANT_VELOCITY, p)
    np.testing.assert_allclose(cost, np.square(residual[:5]).sum(axis=0))
