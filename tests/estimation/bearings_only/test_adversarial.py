"""No geometry raises, and what is not determined is never a bare number."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from estimation.bearings_only import (
    CONSTANT_VELOCITY,
    Bearings,
    Elevations,
    FramePrior,
    Solution,
    bearings,
    best_turn,
    gross_errors,
    in_space,
    jointly,
    maximum_likelihood,
    n_bearings,
    n_polynomials,
    polynomial,
    solve,
    solve_many,
    student_t,
)

COUNTS = st.integers(0, 9)
PLACES = st.one_of(
    st.just(0.0), st.sampled_from([1.0, -1.0, 1e-9, 1e7, 500.0]), st.floats(-1e5, 1e5)
)
TIMES = st.one_of(st.just(0.0), st.sampled_from([1.0, 1e9, 1e-6]), st.floats(0, 2000))
ANGLES = st.one_of(
    st.just(0.0), st.sampled_from([np.pi, -np.pi, np.nan, np.pi / 2]), st.floats(-10, 10)
)
SIGMAS = st.sampled_from([1e-12, 1e-4, 1e-3, 0.02, 3.0])


@st.composite
def geometries(draw: st.DrawFn) -> Bearings:
    n = draw(COUNTS)
    times = np.sort(draw(arrays(float, n, elements=TIMES)))
    places = draw(arrays(float, (n, 2), elements=PLACES))
    angles = draw(arrays(float, n, elements=ANGLES))
    return bearings(times, places, angles, draw(SIGMAS))


def honest(found: Solution) -> None:
    """What holds of every solution."""
    low, high = found.interval
    assert 0 <= low <= high
    assert (found.status == "undetermined") == (found.at(found.last_s) is None)
    assert sum(c.weight for c in found.candidates) == pytest.approx(1 if found.candidates else 0)
    assert all(0 <= c.p_value <= 1 for c in found.candidates)
    if found.status == "determined":
        state = found.at(found.last_s)
        assert state is not None
        assert np.isfinite(state.covariance).all()
        assert found.relative_sigma < 0.1


@settings(max_examples=15, deadline=None)
@given(geometries())
def test_any_geometry_is_solved(scene: Bearings) -> None:
    honest(solve(scene))


@settings(max_examples=15, deadline=None)
@given(geometries())
def test_any_geometry_is_solved_robustly(scene: Bearings) -> None:
    honest(solve(scene, motions=(CONSTANT_VELOCITY,), loss=gross_errors()))
    honest(solve(scene, motions=(CONSTANT_VELOCITY,), loss=student_t()))


@settings(max_examples=30, deadline=None)
@given(geometries(), st.integers(0, 4))
def test_any_geometry_has_a_seed_and_a_likelihood(scene: Bearings, degree: int) -> None:
    if scene.t_s.size:
        assert n_polynomials(scene, degree).coefficients.shape == (degree + 1, 2)
        assert n_bearings(scene).coefficients.shape == (2, 2)
    found = maximum_likelihood(scene, polynomial(max(degree, 1)))
    assert found.inverse_range().sigma.shape == (1,)


@settings(max_examples=10, deadline=None)
@given(geometries(), geometries())
def test_any_two_carriers(one: Bearings, two: Bearings) -> None:
    both = [g._replace(bearing_rad=g.bearing_rad[None]) for g in (one, two)]
    found = jointly(both, [FramePrior(0.02, 100.0)])
    assert found.yaw_rad.shape == (2,)


@settings(max_examples=10, deadline=None)
@given(geometries(), st.floats(-2, 2), st.sampled_from([0.0, 1e4, np.nan]))
def test_any_elevation(scene: Bearings, elevation: float, altitude: float) -> None:
    shape = scene.bearing_rad.shape
    angles = Elevations(np.full(shape, elevation), np.full(shape, 0.01), np.full(shape, 300.0))
    assert in_space(scene, angles, altitude, 5.0).altitude_m.shape == (1,)


@settings(max_examples=10, deadline=None)
@given(geometries())
def test_any_next_turn(scene: Bearings) -> None:
    found = solve(scene, motions=(CONSTANT_VELOCITY,))
    plan = best_turn(scene, found, 5.0, 300.0)
    assert plan is None or np.isfinite(plan.relative_sigma).all()


@pytest.mark.parametrize("count", [0, 1, 2, 3, 5])
def test_a_few_bearings_from_a_straight_carrier_determine_nothing(count: int) -> None:
    t = np.arange(count) * 15.0
    places = np.stack([5 * t, 0 * t], axis=1)
    scene = bearings(t, places, 0.3 + 0.001 * t, 0.002)
    found = solve(scene)
    honest(found)
    assert found.status == "undetermined"
    assert found.interval.high_m == np.inf


def test_a_carrier_that_stands_still_sees_no_range() -> None:
    t = np.arange(41) * 15.0
    rng = np.random.default_rng(1)
    angle = np.arctan2(1000 + 3 * t, 3000 - 2 * t) + rng.normal(0, 0.002, 41)
    honest(found := solve(bearings(t, np.zeros((41, 2)), angle, 0.002)))
    assert found.status == "undetermined"


def test_targets_of_a_batch_may_all_be_strange() -> None:
    t, places = np.arange(20) * 10.0, np.zeros((20, 2))
    angles = np.stack(
        [np.zeros(20), np.full(20, np.nan), np.linspace(0, 40, 20), np.tile([0, np.pi], 10)]
    )
    for found in solve_many(bearings(t, places, angles, 0.01)):
        honest(found)


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match="as many times"):
        bearings(np.zeros(3), np.zeros((2, 2)), np.zeros(3), 0.1)
    with pytest.raises(ValueError, match="positive sigmas"):
        bearings(np.zeros(2), np.zeros((2, 2)), np.zeros(2), 0.0)
    with pytest.raises(ValueError, match="need"):
        bearings(0.0, np.zeros(2), 0.0, 0.1)
    two = bearings(np.arange(3.0), np.zeros((3, 2)), np.zeros((2, 3)), 0.1)
    with pytest.raises(ValueError, match="one target"):
        solve(two)
