"""Targets that each move as they like, and frames that are known but not exactly."""

from __future__ import annotations

import numpy as np
import pytest

from bench.bearings_only.carriers import SIGMA, Pair, pair
from bench.bearings_only.scenes import BENCHMARKS, heading, own_track
from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_ACCELERATION,
    CONSTANT_VELOCITY,
    Bearings,
    FrameDoubt,
    FramePrior,
    bearings,
    each_target,
    jointly,
    solve_many,
    spline,
)
from estimation.bearings_only.doubt import lessened
from estimation.bearings_only.motions import Motion
from estimation.bearings_only.normal_equations import general_normal
from estimation.consistency import mean_interval

PRIOR = FramePrior(np.radians(1), 50.0)


def only(truth: Pair, target: int) -> list[Bearings]:
    """Both carriers' bearings of one target."""
    return [c._replace(bearing_rad=c.bearing_rad[[target]]) for c in truth.carriers]


@pytest.mark.parametrize("motion", [CONSTANT_VELOCITY, CONSTANT_ACCELERATION, spline(4)])
def test_a_target_by_itself_says_what_the_joint_solution_of_it_alone_says(motion: Motion) -> None:
    truth = pair(np.random.default_rng(1))
    each = each_target(truth.carriers, [PRIOR], motion)
    for target in (0, 7):
        alone = jointly(only(truth, target), [PRIOR], motion)
        told = np.append(alone.yaw_rad[1], alone.offset_m[1])
        sigma = np.sqrt(np.diag(alone.covariance))
        np.testing.assert_allclose(each.frames[target] / sigma, told / sigma, atol=1e-4)
        np.testing.assert_allclose(each.covariance[target], alone.covariance, rtol=1e-3)
        assert each.chi2[target] == pytest.approx(alone.chi2, abs=1e-4)
        assert each.dof[target] == alone.dof


def test_targets_say_the_same_in_any_order_and_any_company() -> None:
    truth = pair(np.random.default_rng(2))
    whole = each_target(truth.carriers, [PRIOR], CONSTANT_VELOCITY)
    some = [c._replace(bearing_rad=c.bearing_rad[[9, 3]]) for c in truth.carriers]
    few = each_target(some, [PRIOR], CONSTANT_VELOCITY)
    np.testing.assert_allclose(few.frames, whole.frames[[9, 3]], rtol=1e-6, atol=1e-9)


def test_nothing_seen_leaves_the_prior() -> None:
    truth = pair(np.random.default_rng(3))
    blind = [c._replace(bearing_rad=np.full_like(c.bearing_rad, np.nan)) for c in truth.carriers]
    found = each_target(blind, [PRIOR], CONSTANT_VELOCITY)
    np.testing.assert_allclose(found.frames, 0, atol=1e-9)
    sigmas = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(sigmas, [[np.radians(1), 50, 50]] * len(sigmas), rtol=1e-3)
    assert (found.dof < 1).all()


def turning(rng: np.random.Generator) -> tuple[list[Bearings], float]:
    """A pair's carriers with targets that turn by 90 deg in 90 s; the other's true yaw."""
    truth = pair(rng)
    t = truth.carriers[0].t_s
    fine = np.arange(0.0, 601.0)
    course = rng.uniform(0, 360, (20, 1)) + np.clip(fine - rng.uniform(200, 350, (20, 1)), 0, 90)
    way = np.cumsum(5 * heading(course), axis=1)[:, t.astype(int)]
    begin = 5000 * heading(rng.uniform(0, 360, (20, 1))) + 3000
    seen = []
    for carrier, off in zip(truth.carriers, (0.0, truth.yaw_rad), strict=True):
        d = begin + way - (carrier.observer_m[:, 0] + 1j * carrier.observer_m[:, 1])
        noisy = np.arctan2(d.real, d.imag) - off + rng.normal(0, SIGMA / 6, d.shape)
        seen.append(bearings(t, carrier.observer_m, noisy, SIGMA / 6))
    return seen, truth.yaw_rad


def test_a_spline_follows_a_turn_and_its_frame_is_as_sure_as_it_says() -> None:
    """A polynomial that does not fit is off by many of its sigmas; the spline is not."""
    rng = np.random.default_rng(4)
    squared: list[float] = []
    poor: list[float] = []
    for _ in range(4):
        carriers, yaw = turning(rng)
        for motion, into in ((spline(8), squared), (CONSTANT_ACCELERATION, poor)):
            found = each_target(carriers, [PRIOR], motion)
            into.extend((found.frames[:, 0] - yaw) ** 2 / found.covariance[:, 0, 0])
    _, high = mean_interval(1, 4, 0.999)
    assert np.mean(squared) < high
    assert np.mean(poor) > 2 * np.mean(squared)


@pytest.mark.parametrize("pieces", [2, 4, 7])
def test_a_spline_is_smooth_and_holds_every_parabola(pieces: int) -> None:
    motion, t = spline(pieces), np.linspace(-1, 1, 201)[:, None]
    f = motion.basis(t, np.zeros((0, 1)))[0][:, :, 0].real
    assert len(f) == motion.degree + 1 == pieces + 2
    np.testing.assert_allclose(f[:3], np.stack([t**0, t, t**2 / 2])[:, :, 0])
    slope = np.diff(f, axis=1) / 0.01
    assert np.abs(np.diff(slope, axis=1)).max() < 0.011  # no slope jumps
    assert np.linalg.matrix_rank(f) == pieces + 2


def one_target(rng: np.random.Generator, count: int) -> tuple[Array, Array, Array, Array]:
    """Times, places, who and true bearings of a uniform target, two carriers in turn."""
    t = np.repeat(15.0 * np.arange(count), 2)
    who = np.tile([1, 0], count)
    own = own_track(BENCHMARKS["S"].own, t)
    other = 6000 - 2000j + 4 * heading(20) * t
    place = np.where(who == 1, other, own)
    d = 3000j + 2000 + 5 * heading(225) * t - place
    return t, place, who, np.arctan2(d.real, d.imag)


def test_frames_taken_as_exact_and_put_in_doubt_are_as_jointly_found() -> None:
    """With the frame's posterior in doubt a target is as unsure as jointly with the frame.

    The other carrier stands still: about where it is, its way does not turn with its north.
    """
    t, stands = 15.0 * np.arange(41), 6000 - 2000j
    target, own = 3000j + 2000 + 5 * heading(225) * t, own_track(BENCHMARKS["S"].own, t)
    carriers = []
    for place in (own, np.full(41, stands)):
        d = target - place
        places = np.stack([place.real, place.imag], axis=1)
        carriers.append(bearings(t, places, np.arctan2(d.real, d.imag)[None], 1e-3))
    found = jointly(carriers, [PRIOR])
    who, scene = np.tile([1, 0], 41), found.targets.scene
    moved = (who == 1)[:, None] * complex(*found.offset_m[1]) / scene.length_m
    toward = scene.toward * np.exp(-1j * found.yaw_rad[1] * (who == 1))[:, None]
    there = scene._replace(observer=scene.observer + moved, toward=toward)
    exact = general_normal(there, CONSTANT_VELOCITY, found.targets.p, None).matrix
    order = np.ix_((1, 2, 0), (1, 2, 0))
    pivot = np.array([[stands.real, stands.imag]]) + found.offset_m[1]
    doubt = FrameDoubt(who[None], pivot, found.covariance[order][None])
    less = lessened(exact, there, CONSTANT_VELOCITY, found.targets.p, doubt)
    joint = found.targets.state(600.0).covariance
    told, sure = (
        found.targets._replace(information=of).state(600.0).covariance for of in (less, exact)
    )
    np.testing.assert_allclose(told, joint, rtol=1e-3, atol=1e-6 * np.abs(joint).max())
    assert np.trace(sure[0]) < 0.5 * np.trace(joint[0])


def test_doubt_widens_and_none_changes_nothing() -> None:
    rng = np.random.default_rng(6)
    t, place, who, bearing = one_target(rng, 41)
    noisy = bearing + rng.normal(0, 1e-3, bearing.shape)
    given = bearings(t, np.stack([place.real, place.imag], axis=1), noisy[None], 1e-3)
    sure = solve_many(given)[0]
    widths = [sure.interval.high_m - sure.interval.low_m]
    for scale in (1e-9, 1.0, 5.0):
        covariance = np.diag([10.0, 10.0, 1e-3]) ** 2 * scale**2
        doubt = FrameDoubt(who[None], np.array([[6000.0, -2000.0]]), covariance[None])
        found = solve_many(given, doubt=doubt)[0]
        widths.append(found.interval.high_m - found.interval.low_m)
        assert found.candidates[0].motion == sure.candidates[0].motion
        assert found.candidates[0].p_value == pytest.approx(sure.candidates[0].p_value)
    assert widths[1] == pytest.approx(widths[0], rel=1e-3)
    assert widths[0] < 0.8 * widths[2] < 0.5 * widths[3]


def test_places_err_as_much_as_told_when_the_frame_is_off() -> None:
    """The frame is wrong by what its covariance says; so are the places, without the doubt more."""
    rng = np.random.default_rng(7)
    honest: list[float] = []
    blind: list[float] = []
    covariance = np.diag([15.0, 15.0, 2e-3]) ** 2
    pivot = np.array([6000.0, -2000.0])
    scenes, places = [], []
    for _ in range(48):
        t, place, who, bearing = one_target(rng, 41)
        east, north, turn = rng.multivariate_normal(np.zeros(3), covariance)
        moved = complex(*pivot) + (place - complex(*pivot)) * np.exp(-1j * turn) + east + 1j * north
        places.append(np.where(who == 1, moved, place))
        scenes.append(bearing + turn * (who == 1) + rng.normal(0, 1e-3, bearing.shape))
    true_place = 3000j + 2000 + 5 * heading(225) * t[-1]
    observer = np.stack([np.real(places), np.imag(places)], axis=-1)
    given = bearings(t, observer, np.array(scenes), 1e-3)
    doubt = FrameDoubt(np.tile(who, (48, 1)), pivot[None], covariance[None])
    for known, into in ((doubt, honest), (None, blind)):
        for one in solve_many(given, motions=[CONSTANT_VELOCITY], doubt=known):
            state = one.at(one.last_s)
            assert state is not None
            error = state.position_m - np.array([np.real(true_place), np.imag(true_place)])
            into.append(float(error @ np.linalg.solve(state.covariance[:2, :2], error)) / 2)
    low, high = mean_interval(2, 48, 0.999)
    assert low < np.mean(honest) < high
    assert np.mean(blind) > 1.5 * high
