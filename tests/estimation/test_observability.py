"""Own axes, the bound, and the directions in words."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.arrays import Array
from estimation.frames import polar_from_east_north, rotation_clockwise
from estimation.relative_frame import (
    PolarLogs,
    RelativeFrame,
    RelativeFramePrior,
    closed_form,
    cramer_rao,
    directions,
    in_own_axes,
    prior_in_own_axes,
)

DEG = np.pi / 180
PRIOR = RelativeFramePrior.from_sigmas([9e3, -5e3], 1500, 1500, DEG, DEG)


def logs(east_north: Array) -> PolarLogs:
    return PolarLogs.from_sigmas(*polar_from_east_north(east_north), 0.5 * DEG, 100.0)


def unit_frame(theta: Array) -> RelativeFrame:
    """A frame of these corrections with the unit matrix for a covariance."""
    return RelativeFrame(theta[:2], theta[2], theta[3], np.eye(4), np.zeros(()), 0, 0)


def bound_of(targets: Array) -> Array:
    return cramer_rao(logs(targets), logs(targets - PRIOR.offset_m), PRIOR).own_axes


def names(targets: Array) -> list[tuple[str, str]]:
    prior = prior_in_own_axes(PRIOR).covariance
    return [(d.name, d.status) for d in directions(bound_of(targets), prior)]


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-5e3, 5e3), st.floats(-5e3, 5e3))
def test_own_axes_jacobian_is_the_derivative(c1: float, c2: float, x: float, y: float) -> None:
    point = np.array([x, y, c1, c2])

    def seen(theta: Array) -> Array:
        own = in_own_axes(unit_frame(theta), PRIOR)
        return np.append(own.q_m, own.D_rad)

    np.testing.assert_allclose(
        seen(point)[:2], rotation_clockwise(-c1) @ (PRIOR.offset_m + point[:2]), atol=1e-9
    )
    step = 1e-5
    columns = [(seen(point + h) - seen(point - h)) / (2 * step) for h in step * np.eye(4)]
    jacobian = np.stack(columns, axis=1)
    # central differences of lever arms of 2e4 m: 1e-5^2 / 6 of them, 1e-7 from rounding
    np.testing.assert_allclose(
        in_own_axes(unit_frame(point), PRIOR).covariance,
        jacobian @ jacobian.T,
        rtol=1e-6,
        atol=1e-3,
    )


def test_a_common_turn_is_unobservable_in_fixed_axes_only() -> None:
    """Turn offset, c1 and c2 together: no misclosure changes, so fixed axes keep that prior."""
    targets = np.random.default_rng(1).uniform(-15e3, 15e3, (500, 2))
    scene = logs(targets), logs(targets - PRIOR.offset_m), PRIOR
    bound = cramer_rao(*scene)
    norths = np.sqrt(np.diag(bound.fixed)[2:])
    np.testing.assert_allclose(norths, DEG / np.sqrt(2), rtol=0.01)  # D known, c1 + c2 as before
    assert np.sqrt(bound.own_axes[2, 2]) < 0.04 * DEG
    assert np.sqrt(np.trace(bound.own_axes[:2, :2])) < 20  # m; in fixed axes 127 m of c1 remain
    arm = np.linalg.norm(PRIOR.offset_m)
    floor = arm * DEG / np.sqrt(2)
    assert np.sqrt(np.trace(bound.fixed[:2, :2])) == pytest.approx(floor, rel=0.02)


def test_the_bound_is_the_covariance_at_the_truth() -> None:
    targets = np.random.default_rng(2).uniform(-15e3, 15e3, (6, 2))
    scene = logs(targets), logs(targets - PRIOR.offset_m), PRIOR
    frame = closed_form(*scene)
    np.testing.assert_allclose(frame.offset_correction_m, 0, atol=1e-8)
    np.testing.assert_allclose(cramer_rao(*scene).fixed, frame.covariance)


def test_no_targets_determine_nothing() -> None:
    assert sorted(names(np.empty((0, 2)))) == [
        ("location along 000 deg", "undetermined"),
        ("location along 090 deg", "undetermined"),
        ("orientation", "undetermined"),
    ]


def test_one_target_leaves_the_orientation() -> None:
    weakest, *others = names(np.array([[4e3, 7e3]]))
    assert weakest == ("orientation", "undetermined")
    assert {status for _, status in others} == {"determined"}


def test_many_targets_determine_all() -> None:
    targets = np.random.default_rng(3).uniform(-15e3, 15e3, (10, 2))
    assert {status for _, status in names(targets)} == {"determined"}


@given(
    st.integers(-180, 180),
    st.sampled_from(
        [
            (0.2, "determined"),
            (0.49, "determined"),
            (0.51, "weak"),
            (0.89, "weak"),
            (0.91, "undetermined"),
            (1.0, "undetermined"),
        ]
    ),
)
def test_a_direction_is_named_by_its_bearing(degrees: int, narrowed: tuple[float, str]) -> None:
    """Shrink an isotropic prior along every direction but one: that one is named."""
    ratio, status = narrowed
    prior = np.diag([1e6, 1e6, DEG**2])
    axis = np.array([np.sin(degrees * DEG), np.cos(degrees * DEG), 0.0])
    posterior = prior * 0.01**2 + (ratio**2 - 0.01**2) * 1e6 * np.outer(axis, axis)
    weakest = directions(posterior, prior)[0]
    assert weakest.ratio == pytest.approx(ratio)
    assert weakest.status == status
    assert weakest.name == f"location along {degrees % 180:03d} deg"
    np.testing.assert_allclose(np.abs(weakest.motion @ axis), 1e3)


def test_a_lever_arm_is_named_together() -> None:
    """Targets far beyond the prior of the turn: location is known but for the turn's arm."""
    prior = np.diag([1e6, 1e6, DEG**2])
    motion = np.array([500.0, 500.0, -DEG / np.sqrt(2)])  # one prior sigma in all
    weakest = directions(1e-4 * prior + np.outer(motion, motion), prior)[0]
    assert weakest.name == "location along 045 deg together with orientation"
    assert str(weakest).startswith("location along 045 deg together with orientation is ")


@given(st.floats(-np.pi, np.pi), st.floats(1e-3, 1e3))
def test_ratios_depend_neither_on_axes_nor_on_units(angle: float, unit: float) -> None:
    turn = np.eye(3)
    turn[:2, :2] = rotation_clockwise(angle) * unit
    prior = prior_in_own_axes(PRIOR).covariance
    posterior = bound_of(np.array([[4e3, 7e3], [-3e3, 1e4]]))
    straight = directions(posterior, prior)
    turned = directions(turn @ posterior @ turn.T, turn @ prior @ turn.T)
    np.testing.assert_allclose([d.ratio for d in turned], [d.ratio for d in straight], rtol=1e-6)


def test_a_prior_without_spread_is_refused() -> None:
    with pytest.raises(ValueError, match="positive definite"):
        directions(np.eye(3), np.diag([1.0, 1.0, 0.0]))
