"""Laws of the exact adjustment: the same minimum as an independent solver, the bound, honesty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.registration import adjusted
from bench.registration.scenes import DEG, errors_own, experiment, logs_of
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import polar_from_east_north, rotation_clockwise, wrap_pi
from estimation.relative_frame import (
    Method,
    OwnAxesFrame,
    PolarLogs,
    RelativeFramePrior,
    adjustment,
    closed_form,
    in_own_axes,
    linearised_once,
    motion_to,
    prior_in_own_axes,
    updated,
)
from estimation.relative_frame.adjustment import rigid_fit
from estimation.relative_frame.gauge import gauge
from estimation.relative_frame.gauss_helmert import measured
from estimation.relative_frame.iteration import iterate


def exact(east_north: Array, north: float = 0.0) -> PolarLogs:
    bearing, ranges = polar_from_east_north(east_north)
    return PolarLogs.from_sigmas(bearing - north, ranges, 0.5 * DEG, 100.0)


@pytest.mark.parametrize(("pairs", "sigma_deg"), [(2, 1.0), (3, 30.0), (7, 10.0), (20, 3.0)])
def test_it_is_the_minimum_over_all_unknowns(pairs: int, sigma_deg: float) -> None:
    assert adjusted.from_least_squares(11, 0, pairs, sigma_deg) < 1e-5


@pytest.mark.parametrize("pairs", [2, 4, 10])
@pytest.mark.parametrize("sigma_deg", [1, 10, 90])
def test_error_is_at_the_bound_and_the_covariance_honest(pairs: int, sigma_deg: int) -> None:
    m = adjusted.measure(5, 3000, pairs, sigma_deg * DEG)
    # 3000 runs: the RMSE over geometries to 2 or 3 %, NEES/3 to 1.5 %, chi2 to 1.3 % at L = 2
    assert m.location_clear < 1.08
    assert m.turn_clear < 1.08
    assert 0.94 < m.nees < 1.06
    assert 0.95 < m.chi2 < 1.05
    assert m.converged > 0.998


@pytest.mark.slow
@pytest.mark.parametrize("sigma_deg", adjusted.SIGMAS_DEG)
@pytest.mark.parametrize("pairs", adjusted.LENGTHS)
def test_demands_in_full(pairs: int, sigma_deg: int) -> None:
    m = adjusted.measure(6, 30_000 if pairs < 50 else 6000, pairs, sigma_deg * DEG)
    assert m.location_clear < 1.03
    assert m.turn_clear < 1.03
    assert 0.95 < m.nees < 1.05
    assert 0.97 < m.chi2 < 1.03


def test_exact_sensors_find_any_turn_exactly() -> None:
    """Headings wrong by half a circle, no noise: the rigid start finds what the prior misses."""
    targets = np.array([[8e3, 2e3], [-5e3, 9e3], [1e3, -7e3], [-6e3, -2e3]])
    offset, c1, c2 = np.array([12e3, -4e3]), 0.8, -2.2
    prior = RelativeFramePrior.from_sigmas(offset, 1500, 1500, 90 * DEG, 90 * DEG)
    found = adjustment(exact(targets, c1), exact(targets - offset, c2), prior)
    assert found.converged
    assert float(found.own_axes.D_rad) == pytest.approx(float(wrap_pi(c2 - c1)), abs=2e-3)
    np.testing.assert_allclose(found.own_axes.q_m, rotation_clockwise(-c1) @ offset, atol=20)


def test_a_target_at_a_carrier_does_no_harm() -> None:
    """One target 20 m from each carrier, ranges measured negative now and then: still honest."""
    rng = np.random.default_rng(4)
    scene = experiment(rng, (3000,), 4)
    near_own, near_other = np.array([15.0, 10.0]), scene.truth.offset_m + np.array([10.0, -15.0])
    own, other = scene.own, scene.other
    for index, target in ((0, np.broadcast_to(near_own, near_other.shape)), (1, near_other)):
        for logs, seen, north in (
            (own, target, scene.theta[:, 2]),
            (other, target - scene.truth.offset_m, scene.theta[:, 3]),
        ):
            bearing, ranges = polar_from_east_north(seen)
            noise = rng.standard_normal((2, len(bearing)))
            logs.bearing_rad[:, index] = bearing - north + 0.5 * DEG * noise[0]
            logs.range_m[:, index] = ranges + 100 * noise[1]
    found = adjustment(own, other, scene.prior)
    assert found.converged.all()
    honest = nees(errors_own(found.own_axes, scene), found.own_axes.covariance).mean() / 3
    assert 0.93 < honest < 1.07  # 3000 runs: sigma .015
    assert found.fixed.chi2.mean() / 8 == pytest.approx(1, abs=0.04)


def test_small_errors_are_those_of_the_closed_form() -> None:
    targets = np.random.default_rng(2).uniform(-15e3, 15e3, (8, 2))
    offset = np.array([9e3, 3e3])
    prior = RelativeFramePrior.from_sigmas(offset + np.array([3.0, -2.0]), 1500, 1500, DEG, DEG)
    logs = exact(targets, 1e-5), exact(targets - offset, -2e-5)
    exactly, once = adjustment(*logs, prior), in_own_axes(closed_form(*logs, prior), prior)
    np.testing.assert_allclose(exactly.own_axes.q_m, once.q_m, atol=1e-2)
    np.testing.assert_allclose(exactly.own_axes.covariance, once.covariance, rtol=1e-3)


def test_swapping_own_and_other_mirrors_the_frame() -> None:
    """Where I stand on your display is, turned by D, where you stand on mine; any heading."""
    scene = experiment(np.random.default_rng(6), (50,), 5, 30 * DEG)
    there = adjustment(*logs_of(scene)).own_axes
    back = replace(scene.prior, offset_m=-scene.prior.offset_m)
    here = adjustment(scene.other, scene.own, back).own_axes
    turned = (rotation_clockwise(there.D_rad) @ here.q_m[..., None])[..., 0]
    np.testing.assert_allclose(there.q_m, -turned, atol=1e-2)
    np.testing.assert_allclose(wrap_pi(there.D_rad + here.D_rad), 0, atol=1e-6)


def test_batches_are_their_members() -> None:
    scene = experiment(np.random.default_rng(7), (2, 3), 4, 10 * DEG)
    both = adjustment(*logs_of(scene))
    prior = RelativeFramePrior(
        scene.prior.offset_m[1, 2], scene.prior.offset_covariance, 10 * DEG, 10 * DEG
    )

    def one(logs: PolarLogs) -> PolarLogs:
        return PolarLogs(logs.bearing_rad[1, 2], logs.range_m[1, 2], logs.covariance[1, 2])

    alone = adjustment(one(scene.own), one(scene.other), prior)
    np.testing.assert_allclose(both.own_axes.q_m[1, 2], alone.own_axes.q_m, atol=1e-3)
    np.testing.assert_allclose(both.fixed.covariance[1, 2], alone.fixed.covariance, rtol=1e-4)
    assert both.fixed.chi2.shape == both.converged.shape == (2, 3)


def test_no_pairs_give_the_prior_back() -> None:
    scene = experiment(np.random.default_rng(8), (), 3)
    none = slice(0)
    found = adjustment(scene.own.take(none), scene.other.take(none), scene.prior)
    before = prior_in_own_axes(scene.prior)
    assert found.converged
    np.testing.assert_allclose(found.own_axes.q_m, before.q_m, atol=1e-3)
    np.testing.assert_allclose(found.own_axes.covariance, before.covariance, rtol=1e-6, atol=1e-6)


def test_a_known_north_is_left_alone() -> None:
    scene = experiment(np.random.default_rng(9), (), 5)
    prior = RelativeFramePrior.from_sigmas(scene.prior.offset_m, 1500, 0.0, 0.0, DEG)
    found = adjustment(scene.own, scene.other, prior)
    assert found.converged
    assert found.fixed.c1_rad == 0
    assert found.fixed.offset_correction_m[1] == 0


@pytest.mark.parametrize(
    "targets", [[[4e3, 7e3]] * 5, [[0.0, 0.0]] * 3, [[1e3, 1e3], [2e3, 2e3]]], ids=str
)
def test_a_degenerate_geometry_is_a_covariance_not_an_exception(targets: list[list[float]]) -> None:
    points = np.array(targets)
    prior = RelativeFramePrior.from_sigmas([3e3, 3e3], 1500, 1500, DEG, DEG)
    found = adjustment(exact(points), exact(points - [3e3, 3e3]), prior)
    assert found.converged
    assert np.isfinite(found.own_axes.covariance).all()
    variance = prior_in_own_axes(prior).covariance[2, 2]
    assert found.own_axes.covariance[2, 2] <= variance * (1 + 1e-9)


def test_an_update_in_two_parts_is_the_whole() -> None:
    """Streams: prior, then half the pairs, then the rest; and the sum of both informations."""
    scene = experiment(np.random.default_rng(10), (), 20)
    start = prior_in_own_axes(scene.prior)
    first, rest = slice(12), slice(12, None)
    whole = updated(scene.own, scene.other, start)
    half = updated(scene.own.take(first), scene.other.take(first), start)
    both = updated(scene.own.take(rest), scene.other.take(rest), half.frame)
    sigmas = np.sqrt(np.diag(whole.frame.covariance))
    # what differs is the curvature of half the pairs over their own posterior
    np.testing.assert_allclose(both.frame.q_m, whole.frame.q_m, atol=0.02 * sigmas[0])
    np.testing.assert_allclose(both.frame.covariance, whole.frame.covariance, rtol=0.02)

    second = updated(scene.own.take(rest), scene.other.take(rest), start)
    summed = (half.information + second.information).with_prior(start)
    np.testing.assert_allclose(summed.q_m, whole.frame.q_m, atol=0.05 * sigmas[0])
    at_whole = whole.information.with_prior(start)
    np.testing.assert_allclose(at_whole.q_m, whole.frame.q_m, atol=1e-3)
    np.testing.assert_allclose(at_whole.covariance, whole.frame.covariance, rtol=1e-5)


def test_information_about_another_point_is_the_same_quadratic() -> None:
    scene = experiment(np.random.default_rng(11), (), 6)
    there = updated(scene.own, scene.other, prior_in_own_axes(scene.prior)).information
    back = there.about(there.point + np.array([40.0, -30.0, 0.01])).about(there.point)
    np.testing.assert_allclose(back.vector, there.vector, atol=1e-6 * np.abs(there.matrix).max())
    assert float(back.chi2) == pytest.approx(float(there.chi2), rel=1e-9)


def test_a_turn_about_any_point_is_a_straight_motion() -> None:
    """Turn a frame about a pivot by 1 and by 2 rad: the motions are v and 2 v."""
    frame = OwnAxesFrame(np.array([9e3, 2e3]), np.array(0.3), np.eye(3))
    pivot = np.array([-4e3, 7e3])

    def turned(angle: float) -> Array:
        q = pivot + rotation_clockwise(angle) @ (frame.q_m - pivot)
        return motion_to(frame, q, 0.3 + angle).vector

    np.testing.assert_allclose(turned(2.0), 2 * turned(1.0), rtol=1e-12)
    assert turned(1.0)[2] == pytest.approx(1.0)


def test_small_motions_are_plain_errors() -> None:
    scene = experiment(np.random.default_rng(12), (20,), 10)
    frame = adjustment(*logs_of(scene)).own_axes
    error = errors_own(frame, scene)
    motion = motion_to(frame, frame.q_m - error[:, :2], frame.D_rad - error[:, 2])
    np.testing.assert_allclose(nees(*motion), nees(error, frame.covariance), rtol=0.05)
    same = motion_to(frame, frame.q_m, frame.D_rad)
    np.testing.assert_array_equal(same.vector, 0)


def test_what_cannot_be_paired_is_refused() -> None:
    scene = experiment(np.random.default_rng(13), (), 3)
    with pytest.raises(ValueError, match="own 3, other 2"):
        adjustment(scene.own, scene.other.take(slice(2)), scene.prior)


@pytest.mark.parametrize("method", [adjustment, linearised_once])
def test_methods_share_one_signature(method: Method) -> None:
    scene = experiment(np.random.default_rng(14), (30,), 8)
    found = method(*logs_of(scene))
    assert found.converged.shape == (30,)
    assert np.hypot(*errors_own(found.own_axes, scene)[:, :2].T).mean() < 200


def test_of_two_ends_of_one_minimum_the_first_starts_is_taken() -> None:
    """Rounding must not choose: another processor would get another covariance."""
    scene = experiment(np.random.default_rng(17), (200,), 6, 1.0 * DEG)
    own, other, prior = logs_of(scene)
    given, navigation = measured(own, other, (200,)), gauge(prior, (200,))
    starts = [np.zeros((200, 4)), rigid_fit(given, navigation)]
    ends = [iterate(given, navigation, start) for start in starts]
    apart = np.abs(ends[0].criterion - ends[1].criterion)
    same = apart < 1e-10 * (1 + ends[0].criterion)
    assert same.mean() > 0.9
    assert (ends[1].criterion < ends[0].criterion)[same].any()  # by rounding
    covariance = navigation.root @ ends[0].covariance @ navigation.root.swapaxes(-1, -2)
    found = adjustment(own, other, prior).fixed.covariance
    np.testing.assert_array_equal(found[same], covariance[same])
