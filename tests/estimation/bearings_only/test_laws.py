"""Laws of a solution, and geometries that are out to break it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_ACCELERATION,
    CONSTANT_VELOCITY,
    Bearings,
    FrameDoubt,
    FramePrior,
    Solution,
    bearings,
    each_target,
    likely_ranges,
    maximum_likelihood,
    solve_many,
    spline,
)

T: Array = np.linspace(0.0, 450.0, 31)
FEW = (CONSTANT_VELOCITY, CONSTANT_ACCELERATION)
FLAT = (CONSTANT_VELOCITY,)


def zigzag(speed_mps: float = 5.0) -> Array:
    """Places (N, 2) of a carrier that turns twice."""
    legs = np.radians(np.where(T < 150, 210.0, np.where(T < 300, 300.0, 210.0)))
    step = speed_mps * 15 * np.stack([np.sin(legs), np.cos(legs)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)[:-1]])


def seen(target: Array, places: Array, sigma: float = 1e-3, seed: int = 0) -> Bearings:
    """Noisy bearings of a target at places (N, 2)."""
    d = target - places
    noise = np.random.default_rng(seed).normal(0, sigma, len(T))
    return bearings(T, places, np.arctan2(d[:, 0], d[:, 1]) + noise, sigma)


def uniform(east: float, north: float, v_east: float, v_north: float) -> Array:
    """Places (N, 2) [m] of a uniform motion [m/s]."""
    places: Array = np.array([east, north]) + T[:, None] * np.array([v_east, v_north])
    return places


def solved(scene: Bearings) -> Solution:
    return solve_many(scene, motions=FEW)[0]


PLAIN = uniform(0, 3000, -3, -3)


def far(found: Solution) -> tuple[float, ...]:
    """What does not depend on where north is."""
    assert found.line is not None
    line = found.line
    return (*found.interval, found.relative_sigma, float(line.range_rate_over_range))


@settings(max_examples=4, deadline=None)
@given(st.floats(-7, 7))
def test_turning_the_scene_turns_the_line_and_nothing_else(angle: float) -> None:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    first = seen(PLAIN, zigzag())
    second = first._replace(
        observer_m=zigzag() @ turn.T, bearing_rad=first.bearing_rad + angle + 4 * np.pi
    )
    one, two = solved(first), solved(second)
    assert far(two) == pytest.approx(far(one), rel=2e-2)
    assert one.line is not None
    assert two.line is not None
    apart = two.line.bearing_rad - one.line.bearing_rad - angle
    assert np.angle(np.exp(1j * apart)) == pytest.approx(0, abs=1e-5)


@settings(max_examples=6, deadline=None)
@given(st.floats(-1e6, 1e6), st.floats(-1e9, 1e9))
def test_neither_the_origin_nor_the_epoch_matters(east: float, begin: float) -> None:
    first = seen(PLAIN, zigzag())
    moved = first._replace(
        observer_m=zigzag() + np.array([east, -east]), t_s=T + float(round(begin))
    )
    assert far(solved(moved)) == pytest.approx(far(solved(first)), rel=2e-2)


def test_a_mirror_mirrors_it() -> None:
    first = seen(PLAIN, zigzag())
    second = first._replace(observer_m=zigzag() * [-1, 1], bearing_rad=-first.bearing_rad)
    one, two = solved(first), solved(second)
    assert far(two) == pytest.approx(far(one), rel=2e-2)
    assert one.velocities is not None
    assert two.velocities is not None
    np.testing.assert_allclose(
        two.velocities.by_range, one.velocities.by_range * [-1, 1], rtol=1e-2, atol=1e-7
    )


@settings(max_examples=6, deadline=None)
@given(st.floats(1e-2, 1e4))
def test_likelihood_knows_no_length(scale: float) -> None:
    """Everything, speeds too, ten thousand times as large or a hundred times as small."""
    first = seen(PLAIN, zigzag())
    found = maximum_likelihood(first, CONSTANT_VELOCITY).inverse_range()
    other = maximum_likelihood(
        first._replace(observer_m=zigzag() * scale), CONSTANT_VELOCITY
    ).inverse_range()
    np.testing.assert_allclose(other.value * scale, found.value, rtol=1e-4)
    np.testing.assert_allclose(other.sigma * scale, found.sigma, rtol=1e-3)


def test_bearings_that_are_not_there_change_nothing() -> None:
    first = seen(PLAIN, zigzag())
    padded = bearings(
        np.insert(T, 4, T[4]),
        np.insert(zigzag(), 4, 1e5, axis=0),
        np.insert(first.bearing_rad, 4, np.nan),
        1e-3,
    )
    one, two = solved(first), solved(padded)
    assert two.used == one.used == len(T)
    assert two.interval.low_m == pytest.approx(one.interval.low_m, rel=1e-2)


STRANGE = {
    "target through the carrier": (uniform(0, 1500, 0, -5), np.zeros((31, 2))),
    "target through a carrier that turns": (uniform(-600, -600, 2.1, 1.3), zigzag()),
    "all bearings equal": (uniform(0, 3000, 0, 0), np.zeros((31, 2))),
    "target on the course line": (uniform(0, 3000, 0, 2), uniform(0, 0, 0, 5)),
    "target on the course line, astern": (uniform(0, -3000, 0, 2), uniform(0, 0, 0, 5)),
    "a collision course": (uniform(3000, 3000, -5, 0), uniform(0, 0, 0, 5)),
    "same course and speed": (uniform(2000, 500, 3, 4), uniform(0, 0, 3, 4)),
    "carrier at rest": (uniform(1000, 3000, 3, -2), np.zeros((31, 2))),
    "very near": (zigzag() + np.array([2.0, 1.0]), zigzag()),
    "very far": (uniform(0, 3e7, 0, 0), zigzag()),
    "bearings over north and south": (uniform(30, 900, 0, -6), zigzag()),
}
UNKNOWN = {
    "all bearings equal",
    "target on the course line",
    "target on the course line, astern",
    "a collision course",
    "same course and speed",
    "carrier at rest",
    "very far",
}


@pytest.fixture(scope="module")
def strange() -> dict[str, Solution]:
    """All of them in one batch, by the whole family."""
    scenes = [seen(target, places) for target, places in STRANGE.values()]
    stacked = Bearings(T, *(np.stack([s[k] for s in scenes]) for k in (1, 2, 3)))
    return dict(zip(STRANGE, solve_many(stacked), strict=True))


@pytest.mark.parametrize("name", STRANGE)
def test_strange_geometries_have_a_status_and_no_nan(
    name: str, strange: dict[str, Solution]
) -> None:
    found = strange[name]
    low, high = found.interval
    assert 0 <= low <= high
    assert not np.isnan(found.relative_sigma)
    assert all(np.isfinite([c.weight, c.chi2, c.dof, c.p_value]).all() for c in found.candidates)
    state = found.at(found.last_s)
    assert (state is None) == (found.status == "undetermined")
    assert state is None or np.isfinite(np.r_[state.position_m, state.covariance.ravel()]).all()
    if name in UNKNOWN:
        assert found.status == "undetermined"
        true_m = float(np.hypot(*(STRANGE[name][0][-1] - STRANGE[name][1][-1])))
        assert low <= true_m <= high


@settings(max_examples=8, deadline=None)
@given(
    st.lists(st.floats(-4, 4), min_size=2, max_size=6),
    st.sampled_from([0.0, 1e-9, 1.0, 1e6]),
    st.sampled_from([0.0, 1e-6, 5.0, 1e7]),
)
def test_a_few_bearings_of_any_spacing_say_nothing_of_a_range(
    angles: list[float], every_s: float, speed_mps: float
) -> None:
    """Two bearings, identical times, a carrier that rests or races: never a bare number."""
    t = every_s * np.arange(len(angles))
    places = np.stack([speed_mps * t, 0 * t], axis=1)
    scene = bearings(t, places, np.array(angles), 1e-2)
    (found,) = solve_many(scene, motions=FLAT)
    assert found.status != "determined" or len(angles) > 3
    assert found.interval.low_m >= 0
    low, high = likely_ranges(maximum_likelihood(scene, CONSTANT_VELOCITY))
    assert not np.isnan(low + np.where(np.isinf(high), 0, high)).any()
    each = each_target(
        [s._replace(bearing_rad=s.bearing_rad[None]) for s in (scene, scene)],
        [FramePrior(0.02, 50.0)],
        spline(2),
    )
    assert each.frames.shape == (1, 3)
    assert not (each.converged & ~np.isfinite(each.covariance).all(axis=(1, 2))).any()


@settings(max_examples=8, deadline=None)
@given(st.sampled_from([1e-9, 1.0, 1e6]), st.sampled_from([0.0, 1e8]))
def test_any_doubt_leaves_a_status(sigma_m: float, away: float) -> None:
    doubt = FrameDoubt(
        np.tile([0, 1], 16)[None, :31],
        np.array([[away, -away]]),
        np.diag([sigma_m, sigma_m, 1e-3])[None] ** 2,
    )
    scene = seen(PLAIN, zigzag())
    (found,) = solve_many(
        scene._replace(bearing_rad=scene.bearing_rad[None]), motions=FLAT, doubt=doubt
    )
    assert found.status in {"determined", "weak", "undetermined"}
    assert not np.isnan(found.interval).any()
