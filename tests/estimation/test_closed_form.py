"""Laws of the closed form (paper 000): symmetries, equivalence of the solutions, information."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.arrays import Array, transposed
from estimation.frames import rotation_clockwise, wrap_pi
from estimation.relative_frame import (
    PolarLogs,
    RelativeFrame,
    RelativeFramePrior,
    closed_form,
    closed_form_dense,
    in_own_axes,
    information,
    solve,
)

DEG = np.pi / 180
# Two exact solutions of one well-scaled linear system differ by rounding: 1e-16 times a condition
# of up to 1e6 (L = 1000 pairs of 150 m against a prior of 1500 m).
ROUNDING = 1e-10


class Scene(NamedTuple):
    own: PolarLogs
    other: PolarLogs
    prior: RelativeFramePrior


@st.composite
def scenes(draw: st.DrawFn, least: int = 0) -> Scene:
    """Any geometry, other sigmas in every log, correlated prior, errors of a few sigmas."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pairs = draw(st.integers(least, 12))
    scale = draw(st.sampled_from([0.3, 1.0, 5.0]))
    targets, offset = rng.uniform(-2e4, 2e4, (pairs, 2)), rng.uniform(-2e4, 2e4, 2)
    root = rng.normal(0, 1000, (2, 2))
    prior = RelativeFramePrior(
        offset + rng.normal(0, 1000, 2),
        root @ root.T + 100**2 * np.eye(2),
        *rng.uniform(0.1 * DEG, 3 * DEG, 2),
    )

    def logs(east_north: Array) -> PolarLogs:
        sigmas = rng.uniform([0.1 * DEG, 20], [1 * DEG, 200], (pairs, 2))
        correlation = np.where(np.eye(2), 1.0, rng.uniform(-0.9, 0.9))
        bearing, ranges = np.arctan2(*east_north.T), np.hypot(*east_north.T)
        return PolarLogs(
            bearing + rng.normal(0, scale * DEG) + rng.normal(0, 0.01, pairs),
            ranges + rng.normal(0, 100, pairs),
            correlation * sigmas[:, :, None] * sigmas[:, None, :],
        )

    return Scene(logs(targets), logs(targets - offset), prior)


def theta(frame: RelativeFrame) -> Array:
    return np.concatenate([frame.offset_correction_m, [frame.c1_rad, frame.c2_rad]])


def assert_same(one: RelativeFrame, same: RelativeFrame, prior: RelativeFramePrior) -> None:
    """Equal to rounding, in sigmas of the prior."""
    sigmas = np.sqrt(np.diag(prior.covariance))
    # corrections of many prior sigmas are rounded in proportion
    size = max(1.0, float(np.abs(theta(one) / sigmas).max()))
    np.testing.assert_allclose(theta(one) / sigmas, theta(same) / sigmas, atol=ROUNDING * size)
    per_sigmas = np.outer(sigmas, sigmas)
    np.testing.assert_allclose(
        one.covariance / per_sigmas, same.covariance / per_sigmas, atol=ROUNDING
    )
    assert one.chi2 == pytest.approx(same.chi2, rel=1e-8, abs=1e-8)
    assert (one.dof, one.pairs) == (same.dof, same.pairs)


@given(scenes())
def test_dense_and_additive_solutions_are_one(scene: Scene) -> None:
    assert_same(closed_form(*scene), closed_form_dense(*scene), scene.prior)


@given(scenes(least=1))
def test_it_minimises_criterion_5_under_the_linearised_conditions(scene: Scene) -> None:
    """An independent reference: all 4 L + 4 corrections at once, derivatives by differences."""
    own, other, prior = scene
    pairs = own.count

    def condition(values: Array) -> Array:  # eq. 2, printed in the paper, of measurements + v
        b1, d1, b2, d2 = values[: 4 * pairs].reshape(4, pairs)
        x, y, c1, c2 = values[4 * pairs :]
        east = d1 * np.sin(b1 + c1) - x - d2 * np.sin(b2 + c2)
        north = d1 * np.cos(b1 + c1) - y - d2 * np.cos(b2 + c2)
        return np.concatenate([east, north])

    point = np.concatenate(
        [own.bearing_rad, own.range_m, other.bearing_rad, other.range_m, prior.offset_m, [0, 0]]
    )
    step = np.full(len(point), 1e-6)  # rad: the third derivative leaves 1e-12 of a lever arm
    step[pairs : 2 * pairs] = step[3 * pairs : 4 * pairs] = 1.0  # m: (2) is linear in these
    step[-4:-2] = 1.0
    columns = [(condition(point + h) - condition(point - h)) / (2 * h.sum()) for h in np.diag(step)]
    weights = np.zeros((len(point), len(point)))
    for start, logs in ((0, own), (2 * pairs, other)):
        b, d = start + np.arange(pairs), start + pairs + np.arange(pairs)
        weights[b, b], weights[d, d] = logs.covariance[:, 0, 0], logs.covariance[:, 1, 1]
        weights[b, d] = weights[d, b] = logs.covariance[:, 0, 1]
    weights[-4:, -4:] = prior.covariance
    jacobian = np.stack(columns, axis=1)
    misclosure = condition(point)
    gain = weights @ jacobian.T @ np.linalg.inv(jacobian @ weights @ jacobian.T)
    expected = -(gain @ misclosure)[-4:]

    sigmas = np.sqrt(np.diag(prior.covariance))
    found = theta(closed_form(*scene)) / sigmas
    size = max(1.0, float(np.abs(found).max()))
    # differences over 1e-6 rad of positions of 3e4 m rounded at 4e-12 m: 1e-6 of a lever arm
    np.testing.assert_allclose(found, expected / sigmas, atol=1e-5 * size)


@given(scenes())
def test_swapping_own_and_other_negates_the_offset(scene: Scene) -> None:
    own, other, prior = scene
    back = RelativeFramePrior(
        -prior.offset_m, prior.offset_covariance, prior.sigma_c2_rad, prior.sigma_c1_rad
    )
    there, here = closed_form(own, other, prior), closed_form(other, own, back)
    sign = np.array([-1.0, -1.0, 1.0, 1.0])
    order = [0, 1, 3, 2]
    mirrored = RelativeFrame(
        -here.offset_correction_m,
        here.c2_rad,
        here.c1_rad,
        (sign[:, None] * here.covariance * sign)[np.ix_(order, order)],
        here.chi2,
        here.dof,
        here.pairs,
    )
    assert_same(there, mirrored, prior)

    # In own axes too: where I stand on your display is, turned by D, where you stand on mine.
    mine, yours = in_own_axes(there, prior), in_own_axes(here, back)
    np.testing.assert_allclose(mine.q_m, -rotation_clockwise(mine.D_rad) @ yours.q_m, atol=1e-5)
    assert mine.D_rad == pytest.approx(-yours.D_rad, abs=1e-10)


@given(scenes(), st.floats(-np.pi, np.pi))
def test_turning_the_scene_turns_the_offset_and_nothing_else(scene: Scene, angle: float) -> None:
    own, other, prior = scene
    turn = rotation_clockwise(angle)
    turned_prior = replace(
        prior,
        offset_m=turn @ prior.offset_m,
        offset_covariance=turn @ prior.offset_covariance @ turn.T,
    )
    turned = closed_form(
        replace(own, bearing_rad=own.bearing_rad + angle),
        replace(other, bearing_rad=other.bearing_rad + angle),
        turned_prior,
    )
    straight = closed_form(own, other, prior)
    whole = np.eye(4)
    whole[:2, :2] = turn
    expected = straight._replace(
        offset_correction_m=turn @ straight.offset_correction_m,
        covariance=whole @ straight.covariance @ whole.T,
    )
    assert_same(turned, expected, turned_prior)


@given(scenes(least=1), st.integers(0, 1000))
def test_order_of_the_pairs_does_not_matter(scene: Scene, seed: int) -> None:
    own, other, prior = scene
    order = np.random.default_rng(seed).permutation(own.count)
    assert_same(closed_form(own.take(order), other.take(order), prior), closed_form(*scene), prior)


@given(scenes(least=1), st.integers(0, 12))
def test_information_adds_up_over_streams(scene: Scene, cut: int) -> None:
    own, other, prior = scene
    first = information(own.take(slice(cut)), other.take(slice(cut)), prior)
    rest = information(own.take(slice(cut, None)), other.take(slice(cut, None)), prior)
    assert_same(solve(first + rest, prior), closed_form(*scene), prior)


@given(scenes(least=1))
def test_more_pairs_never_grow_the_covariance(scene: Scene) -> None:
    own, other, prior = scene
    fewer = closed_form(own.take(slice(1, None)), other.take(slice(1, None)), prior)
    sigmas = np.sqrt(np.diag(prior.covariance))
    gained = (fewer.covariance - closed_form(*scene).covariance) / np.outer(sigmas, sigmas)
    assert np.linalg.eigvalsh(gained).min() > -ROUNDING


@given(scenes())
def test_no_pairs_give_the_prior_back(scene: Scene) -> None:
    own, other, prior = scene
    none = slice(0)
    for method in (closed_form, closed_form_dense):
        frame = method(own.take(none), other.take(none), prior)
        np.testing.assert_array_equal(theta(frame), 0)
        np.testing.assert_allclose(frame.covariance, prior.covariance, rtol=1e-12, atol=1e-9)
        assert (float(frame.chi2), frame.dof, frame.pairs) == (0, 0, 0)


@given(scenes(least=1))
def test_batches_are_their_members(scene: Scene) -> None:
    own, other, prior = scene

    def twice(logs: PolarLogs) -> PolarLogs:
        return PolarLogs(
            np.stack([logs.bearing_rad, logs.bearing_rad + 0.01]),
            np.stack([logs.range_m] * 2),
            np.stack([logs.covariance] * 2),
        )

    batch_prior = replace(prior, offset_m=np.stack([prior.offset_m, prior.offset_m + 100.0]))
    for method in (closed_form, closed_form_dense):
        batch = method(twice(own), twice(other), batch_prior)
        second = batch._replace(
            offset_correction_m=batch.offset_correction_m[1],
            c1_rad=batch.c1_rad[1],
            c2_rad=batch.c2_rad[1],
            covariance=batch.covariance[1],
            chi2=batch.chi2[1],
        )
        alone = method(
            replace(own, bearing_rad=own.bearing_rad + 0.01),
            replace(other, bearing_rad=other.bearing_rad + 0.01),
            replace(prior, offset_m=prior.offset_m + 100.0),
        )
        assert_same(second, alone, prior)
        seen, seen_alone = in_own_axes(batch, batch_prior), in_own_axes(alone, batch_prior)
        np.testing.assert_allclose(seen.q_m[1], seen_alone.q_m[1], atol=1e-6)


def test_chunks_of_a_long_batch_are_the_whole() -> None:
    rng = np.random.default_rng(5)
    pairs = 10_000  # three chunks
    bearing, ranges = rng.uniform(-3, 3, (2, pairs)), rng.uniform(5e3, 2e4, (2, pairs))
    own, other = (PolarLogs.from_sigmas(bearing[i], ranges[i], 0.5 * DEG, 100.0) for i in range(2))
    prior = RelativeFramePrior.from_sigmas([1e4, 0.0], 1500, 1500, DEG, DEG)
    parts = [
        information(own.take(slice(i, i + 1000)), other.take(slice(i, i + 1000)), prior)
        for i in range(0, pairs, 1000)
    ]
    total = parts[0]
    for part in parts[1:]:
        total += part
    assert_same(solve(total, prior), closed_form(own, other, prior), prior)


def test_exact_sensors_find_small_errors_exactly() -> None:
    """Errors so small that one linearisation is exact; sensors so good that the prior is mute."""
    targets = np.array([[8e3, 2e3], [-5e3, 9e3], [1e3, -7e3]])
    offset, c1, c2 = np.array([12e3, -4e3]), 2e-6, -3e-6

    def logs(east_north: Array, c: float) -> PolarLogs:
        bearing = np.arctan2(*east_north.T) - c
        return PolarLogs.from_sigmas(bearing, np.hypot(*east_north.T), 1e-9, 1e-5)

    prior = RelativeFramePrior.from_sigmas(offset - [0.3, -0.2], 1500, 1500, DEG, DEG)
    frame = closed_form(logs(targets, c1), logs(targets - offset, c2), prior)
    seen = in_own_axes(frame, prior)
    assert seen.D_rad == pytest.approx(c2 - c1, abs=1e-9)
    np.testing.assert_allclose(seen.q_m, rotation_clockwise(-c1) @ offset, atol=1e-4)


def test_a_known_own_north_is_left_alone() -> None:
    """A zero sigma is a constraint, not a division by zero."""
    rng = np.random.default_rng(6)
    bearing, ranges = rng.uniform(-3, 3, (2, 5)), rng.uniform(5e3, 2e4, (2, 5))
    own, other = (PolarLogs.from_sigmas(bearing[i], ranges[i], 0.01, 100.0) for i in range(2))
    prior = RelativeFramePrior.from_sigmas([1e4, 0.0], 1500, 0.0, 0.0, DEG)
    frame = closed_form(own, other, prior)
    assert frame.c1_rad == 0
    assert frame.offset_correction_m[1] == 0
    np.testing.assert_allclose(frame.covariance[[1, 2]], 0)
    assert_same(
        frame,
        closed_form_dense(own, other, prior),
        replace(prior, sigma_c1_rad=DEG, offset_covariance=1500.0**2 * np.eye(2)),
    )


@given(scenes(least=1))
def test_cartesian_logs_are_the_polar_ones(scene: Scene) -> None:
    own = scene.own
    sin, cos = np.sin(own.bearing_rad), np.cos(own.bearing_rad)
    columns = np.stack([own.range_m * cos, sin, -own.range_m * sin, cos], axis=-1)
    by_polar = columns.reshape(-1, 2, 2)
    same = PolarLogs.from_east_north(
        np.stack([own.range_m * sin, own.range_m * cos], axis=-1),
        by_polar @ own.covariance @ transposed(by_polar),
    )
    np.testing.assert_allclose(wrap_pi(same.bearing_rad - own.bearing_rad), 0, atol=1e-12)
    scale = np.sqrt(np.einsum("lii->li", own.covariance))
    unit = scale[:, :, None] * scale[:, None, :]
    np.testing.assert_allclose(same.covariance / unit, own.covariance / unit, atol=1e-6)
    assert_same(closed_form(same, scene.other, scene.prior), closed_form(*scene), scene.prior)


def test_what_cannot_be_paired_is_refused() -> None:
    logs = PolarLogs.from_sigmas([0.1, 0.2, 0.3], [1e3, 2e3, 3e3], 0.01, 100.0)
    prior = RelativeFramePrior.from_sigmas([1e4, 0.0], 1500, 1500, DEG, DEG)
    for method in (closed_form, closed_form_dense):
        with pytest.raises(ValueError, match="own 3, other 2"):
            method(logs, logs.take(slice(2)), prior)
    with pytest.raises(ValueError, match=r"bearings \(1,\), ranges \(2,\)"):
        PolarLogs.from_sigmas([0.1], [1e3, 2e3], 0.01, 100.0)
    with pytest.raises(ValueError, match="above zero"):
        PolarLogs.from_sigmas([0.1], [1e3], 0.0, 100.0)
    with pytest.raises(ValueError, match="no bearing"):
        PolarLogs.from_east_north([[0.0, 0.0]], [np.eye(2)])
    with pytest.raises(ValueError, match="negative"):
        RelativeFramePrior.from_sigmas([1e4, 0.0], 1500, -1.0, DEG, DEG)
