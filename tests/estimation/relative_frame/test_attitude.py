"""Frames in space: honest, exact without noise, the plane as its special case."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.registration import in_space
from bench.registration.scenes import DEG
from estimation.arrays import Array, transposed
from estimation.consistency import nees
from estimation.relative_frame import (
    PolarLogs,
    RelativeFramePrior,
    SphericalLogs,
    adjustment,
    spatial_adjustment,
)
from estimation.relative_frame.attitude import AttitudePrior, rotation, rotation_vector

vectors = st.tuples(*[st.floats(-1.7, 1.7)] * 3).map(np.array)


@pytest.mark.parametrize("pairs", in_space.LENGTHS[:3])
def test_the_covariance_is_honest(pairs: int) -> None:
    scene = in_space.drawn(np.random.default_rng(pairs), 1500, pairs)
    found = spatial_adjustment(scene.own, scene.other, scene.prior)
    assert found.converged.all()
    honest = nees(in_space.error(found, scene), found.covariance).mean() / 6
    assert honest == pytest.approx(1, abs=0.07)  # 1500 runs of 6 degrees: sigma .015
    assert found.chi2.mean() / (3 * pairs) == pytest.approx(1, abs=0.06)


@given(vectors)
def test_rotation_vectors_come_back(vector: Array) -> None:
    turn = rotation(vector)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation_vector(turn), vector, atol=1e-7)


def test_a_turn_about_up_is_minus_a_yaw() -> None:
    """A bearing grows clockwise, a rotation about up counter-clockwise."""
    north = np.array([0.0, 1.0, 0.0])
    east, ahead, _ = rotation(np.array([0.0, 0.0, -0.1])) @ north
    assert np.arctan2(east, ahead) == pytest.approx(0.1)


def test_the_plane_is_a_special_case() -> None:
    """Targets and carriers at one height, level attitudes: the adjustment in the plane."""
    rng = np.random.default_rng(5)
    targets = rng.uniform(-15e3, 15e3, (6, 2))
    offset = np.array([9e3, -4e3])
    logs = []
    for seen in (targets, targets - offset):
        noise = rng.standard_normal((2, 6))
        bearing = np.arctan2(*seen.T) + 0.5 * DEG * noise[0]
        logs.append((bearing, np.hypot(*seen.T) + 100 * noise[1]))
    flat = [PolarLogs.from_sigmas(*each, 0.5 * DEG, 100.0) for each in logs]
    prior = RelativeFramePrior.from_sigmas(offset + 500.0, 1500, 1500, DEG, DEG)
    plane = adjustment(*flat, prior)

    covariance = np.broadcast_to(np.diag([(0.5 * DEG) ** 2, 1e4, DEG**2]), (6, 3, 3))
    spatial = [SphericalLogs(np.stack([*each, np.zeros(6)], axis=-1), covariance) for each in logs]
    level = 1e-9  # of what the plane does not have
    sigmas = np.array([1500, 1500, level, level, level, DEG, level, level, DEG])
    found = spatial_adjustment(
        *spatial, AttitudePrior(np.append(offset + 500.0, 0.0), np.diag(sigmas**2))
    )
    np.testing.assert_allclose(found.q_m[:2], plane.own_axes.q_m, atol=0.05)
    yaw = -rotation_vector(found.own_from_other)[2]
    assert yaw == pytest.approx(float(plane.own_axes.D_rad), abs=1e-6)
    assert float(found.chi2) == pytest.approx(float(plane.fixed.chi2), rel=1e-4)


def test_exact_sensors_find_the_attitude_exactly() -> None:
    rng = np.random.default_rng(6)
    scene = in_space.drawn(rng, 3, 8)
    exact = in_space.Scene(*scene)
    turned = transposed(exact.own_from_other)[:, None]
    points = rng.uniform(-1e4, 1e4, (3, 8, 3)) + np.array([0, 0, 12e3])
    apart = (turned @ (points - exact.q_m[:, None])[..., None])[..., 0]

    def logs(place: Array) -> SphericalLogs:
        level = np.hypot(place[..., 0], place[..., 1])
        measured = [
            np.arctan2(place[..., 0], place[..., 1]),
            np.linalg.norm(place, axis=-1),
            np.arctan2(place[..., 2], level),
        ]
        return SphericalLogs(
            np.stack(measured, axis=-1),
            np.broadcast_to(np.diag([1e-12, 1e-4, 1e-12]), (3, 8, 3, 3)),
        )

    found = spatial_adjustment(logs(points), logs(apart), scene.prior)
    assert found.converged.all()
    np.testing.assert_allclose(found.q_m, exact.q_m, atol=0.1)
    np.testing.assert_allclose(found.own_from_other, exact.own_from_other, atol=1e-5)


def test_targets_on_one_line_leave_a_turn_about_it() -> None:
    """Rank 5: what the data do not say keeps its prior, and nothing is raised."""
    line = np.array([1e3, 8e3, 2e3]) + np.linspace(0, 1, 5)[:, None] * [9e3, 1e3, 3e3]
    level = np.hypot(line[:, 0], line[:, 1])
    measured = np.stack(
        [
            np.arctan2(line[:, 0], line[:, 1]),
            np.linalg.norm(line, axis=1),
            np.arctan2(line[:, 2], level),
        ],
        axis=-1,
    )
    logs = SphericalLogs(measured, np.broadcast_to(np.diag([1e-10, 1e-2, 1e-10]), (5, 3, 3)))
    prior = AttitudePrior(np.zeros(3), np.diag(in_space.SIGMAS**2))
    found = spatial_adjustment(logs, logs, prior)
    assert found.converged
    widest = np.sqrt(np.linalg.eigvalsh(found.covariance[3:, 3:])[-1])
    assert widest > 0.1 * DEG  # the others are of 1e-5 rad


def test_what_cannot_be_paired_is_refused() -> None:
    scene = in_space.drawn(np.random.default_rng(7), 1, 4)
    fewer = SphericalLogs(scene.other.measured[:, :3], scene.other.covariance[:, :3])
    with pytest.raises(ValueError, match="own 4, other 3"):
        spatial_adjustment(scene.own, fewer, scene.prior)
