"""Corrections applied with their covariance: honest, never harmful."""

from __future__ import annotations

import numpy as np
import pytest

from bench.registration import considered
from bench.registration.scenes import DEG
from estimation.arrays import Array
from estimation.frames import east_north_from_polar, rotation_clockwise
from estimation.relative_frame import OwnAxesFrame, PolarLogs, corrected, fused, positions

LOGS = PolarLogs.from_sigmas([0.3, 2.0, -2.5], [8e3, 3e3, 15e3], 0.5 * DEG, 100.0)
FRAME = OwnAxesFrame(np.array([9e3, -2e3]), np.array(0.4), np.diag([900.0, 400.0, 1e-5]))


@pytest.mark.parametrize("pairs", [1, 3, 10])
def test_fusion_is_honest_and_never_worse_than_the_own_sensor(pairs: int) -> None:
    m = considered.measure(2, 4000, pairs)
    # 12 000 targets, three a correction: sigma below .012
    assert 0.965 < m.nees < 1.035
    assert m.gain < 1
    assert m.gain < m.gain_ignored
    if pairs == 1:
        assert m.nees_ignored > 3
        assert m.gain_ignored > 1.2


@pytest.mark.slow
@pytest.mark.parametrize("pairs", considered.LENGTHS)
def test_demand_in_full(pairs: int) -> None:
    assert 0.97 < considered.measure(3, 20_000, pairs).nees < 1.03


def test_places_are_q_and_the_turned_log() -> None:
    seen = corrected(LOGS, FRAME)
    there = east_north_from_polar(LOGS.bearing_rad, LOGS.range_m)
    np.testing.assert_allclose(seen.east_north_m, FRAME.q_m + there @ rotation_clockwise(0.4).T)


def test_by_frame_is_the_derivative() -> None:
    def place(x: Array) -> Array:
        return corrected(LOGS, OwnAxesFrame(x[:2], x[2], FRAME.covariance)).east_north_m

    point, step = np.array([9e3, -2e3, 0.4]), np.array([1.0, 1.0, 1e-5])
    columns = [(place(point + h) - place(point - h)) / (2 * h.sum()) for h in np.diag(step)]
    expected = np.stack(columns, axis=-1)
    np.testing.assert_allclose(corrected(LOGS, FRAME).by_frame, expected, rtol=1e-6, atol=1e-4)


def test_an_unknown_frame_leaves_the_own_sensor_alone() -> None:
    vague = FRAME._replace(covariance=np.diag([1e14, 1e14, 10.0]))
    own = positions(LOGS)
    both = fused(own, corrected(LOGS, vague))
    np.testing.assert_allclose(both.east_north_m, own.east_north_m, atol=0.01)
    np.testing.assert_allclose(both.covariance, own.covariance, rtol=1e-4, atol=0.1)


def test_an_exact_frame_is_a_second_sensor() -> None:
    exact = FRAME._replace(covariance=np.zeros((3, 3)))
    own, other = positions(LOGS), corrected(LOGS, exact)
    both = fused(own, other)
    summed = np.linalg.inv(own.covariance) + np.linalg.inv(other.covariance)
    np.testing.assert_allclose(np.linalg.inv(both.covariance), summed, rtol=1e-9)
