"""The paper's two methods: what is identical, what is exact, and how they err."""

from __future__ import annotations

import numpy as np
import pytest

from bench.bearings_only.scenes import benchmark, geometry_of
from estimation.bearings_only import (
    Bearings,
    SeedTrack,
    chebyshev_first,
    chebyshev_second,
    n_bearings,
    n_polynomials,
)
from estimation.bearings_only.seeds import pseudo_linear_rows, rotated_rows


def noisy(kind: str = "C", runs: int = 40) -> Bearings:
    return benchmark(np.random.default_rng(4), "S", kind, 60, runs).given


def clean(kind: str) -> Bearings:
    scene = benchmark(np.random.default_rng(4), "S", kind, 1e-9, 1)
    return scene.given


def range_errors(track: SeedTrack, given: Bearings, true_m: float) -> np.ndarray:
    last = np.full(given.bearing_rad.shape[0], given.t_s[-1])
    apart = track.position_m(last) - given.observer_m[-1]
    return np.asarray(np.linalg.norm(apart, axis=-1) / true_m - 1)


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_the_rotated_form_is_the_pseudo_linear_one(degree: int) -> None:
    given = noisy()
    values = chebyshev_first(np.linspace(-1, 1, 41), degree)
    for one, other in zip(
        pseudo_linear_rows(given, values), rotated_rows(given, values), strict=True
    ):
        np.testing.assert_allclose(one, -other, atol=1e-12 * np.abs(one).max())


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_both_kinds_give_the_same_track(degree: int) -> None:
    given = noisy()
    t = np.full(40, 333.0)
    first = n_polynomials(given, degree, chebyshev_first)
    second = n_polynomials(given, degree, chebyshev_second)
    np.testing.assert_allclose(first.position_m(t), second.position_m(t), atol=1e-6)
    np.testing.assert_allclose(first.velocity_mps(t), second.velocity_mps(t), atol=1e-6)


def test_chebyshev_polynomials() -> None:
    tau = np.linspace(-1, 1, 9)
    angle = np.arccos(tau)
    np.testing.assert_allclose(chebyshev_first(tau, 3)[:, 3], np.cos(3 * angle), atol=1e-12)
    inside = slice(1, -1)
    expected = np.sin(4 * angle[inside]) / np.sin(angle[inside])
    np.testing.assert_allclose(chebyshev_second(tau, 3)[inside, 3], expected, atol=1e-12)


def test_exact_without_noise() -> None:
    scene = benchmark(np.random.default_rng(1), "S", "A", 1e-9, 1)
    for track in (n_bearings(scene.given), n_polynomials(scene.given, 1)):
        assert abs(range_errors(track, scene.given, scene.range_m[0])[0]) < 1e-6
        speed = np.linalg.norm(track.velocity_mps(np.array([600.0])))
        np.testing.assert_allclose(speed, scene.speed_mps[0], rtol=1e-6)
    scene = benchmark(np.random.default_rng(1), "S", "C", 1e-9, 1)
    error = range_errors(n_polynomials(scene.given, 2), scene.given, scene.range_m[0])
    assert abs(error[0]) < 1e-6


@pytest.mark.parametrize("name", ["S", "M"])
def test_noise_pulls_the_range_to_zero(name: str) -> None:
    scene = benchmark(np.random.default_rng(2), name, "A", 60, 200)
    for track in (n_bearings(scene.given), n_polynomials(scene.given, 1)):
        error = range_errors(track, scene.given, scene.range_m[0])
        assert error.mean() < -2 * error.std() / np.sqrt(200)


def test_turning_and_moving_the_scene_turns_and_moves_the_track() -> None:
    given, angle, shift = noisy(), 0.7, np.array([5e3, -2e3])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    moved = given._replace(
        observer_m=given.observer_m @ turn.T + shift, bearing_rad=given.bearing_rad + angle
    )
    t = np.full(40, 450.0)
    for method in (n_bearings, lambda g: n_polynomials(g, 2)):
        np.testing.assert_allclose(
            method(moved).position_m(t), method(given).position_m(t) @ turn.T + shift, atol=1e-5
        )


def test_what_is_not_seen_is_left_out() -> None:
    given = noisy(runs=2)
    some = np.arange(41) % 5 != 0
    holes = given._replace(bearing_rad=np.where(some, given.bearing_rad, np.nan))
    fewer = Bearings(
        given.t_s[some], given.observer_m[some], given.bearing_rad[:, some], given.sigma_rad[some]
    )
    t = np.full(2, 300.0)
    np.testing.assert_allclose(
        n_bearings(holes).position_m(t), n_bearings(fewer).position_m(t), rtol=1e-6
    )


def test_a_carrier_without_a_manoeuvre_is_no_exception() -> None:
    given = geometry_of("S", 20.0)._replace(observer_m=np.zeros((41, 2)))
    assert np.isfinite(n_bearings(given).coefficients).all()
    assert np.isfinite(n_polynomials(given, 3).coefficients).all()
