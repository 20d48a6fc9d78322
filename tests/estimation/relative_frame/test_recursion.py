"""A drifting frame followed over time: honest with its drift, dishonest without."""

from __future__ import annotations

import numpy as np
import pytest

from bench.registration import over_time
from bench.registration.scenes import DEG
from estimation.arrays import Array
from estimation.frames import rotation_clockwise
from estimation.relative_frame import STEADY, Drift, OwnAxesFrame, Travel, predicted

FRAME = OwnAxesFrame(np.array([9e3, -2e3]), np.array(0.4), np.diag([900.0, 400.0, 1e-4]))


def test_drift_is_honest_and_ignoring_it_is_not() -> None:
    # 100 runs x 30 instants that share a memory of some five: sigma .03
    assert 0.88 < over_time.drift_nees(1, 100, over_time.DRIFT) < 1.12
    assert over_time.drift_nees(1, 20, STEADY) > 10


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_drift_demand_in_full(seed: int) -> None:
    assert 0.9 < over_time.drift_nees(seed, 400, over_time.DRIFT) < 1.1


def test_waiting_adds_the_walk_and_nothing_else() -> None:
    drift = Drift(2.0, 0.001)
    later = predicted(FRAME, 9.0, drift)
    np.testing.assert_array_equal(later.q_m, FRAME.q_m)
    gained = later.covariance - FRAME.covariance
    np.testing.assert_allclose(gained, np.diag([36.0, 36.0, 9e-6]), atol=1e-12)
    twice = predicted(predicted(FRAME, 4.0, drift), 5.0, drift)
    np.testing.assert_allclose(twice.covariance, later.covariance)


def test_travel_moves_q_by_what_each_carrier_reckons() -> None:
    travel = Travel(own_m=[100.0, 50.0], other_m=[0.0, 200.0])
    later = predicted(FRAME, 1.0, STEADY, travel)
    expected = FRAME.q_m + rotation_clockwise(0.4) @ [0.0, 200.0] - [100.0, 50.0]
    np.testing.assert_allclose(later.q_m, expected)


def test_travel_carries_the_covariance_by_its_derivative() -> None:
    travel = Travel(own_m=[0.0, 0.0], other_m=[300.0, 2000.0])

    def moved(x: Array) -> Array:
        later = predicted(OwnAxesFrame(x[:2], x[2], FRAME.covariance), 1.0, STEADY, travel)
        return np.array([*later.q_m, later.D_rad])

    point, step = np.array([9e3, -2e3, 0.4]), np.array([1.0, 1.0, 1e-5])
    columns = [(moved(point + h) - moved(point - h)) / (2 * h.sum()) for h in np.diag(step)]
    forward = np.stack(columns, axis=1)
    later = predicted(FRAME, 1.0, STEADY, travel)
    np.testing.assert_allclose(
        later.covariance, forward @ FRAME.covariance @ forward.T, rtol=1e-6, atol=1e-9
    )


def test_prediction_is_batched() -> None:
    frames = OwnAxesFrame(
        np.stack([FRAME.q_m, FRAME.q_m + 5]),
        np.array([0.4, 10 * DEG]),
        np.stack([FRAME.covariance] * 2),
    )
    later = predicted(frames, 2.0, Drift(1.0, 0.01), Travel([[1.0, 2.0], [3.0, 4.0]], [5.0, 6.0]))
    alone = predicted(FRAME, 2.0, Drift(1.0, 0.01), Travel([1.0, 2.0], [5.0, 6.0]))
    np.testing.assert_allclose(later.q_m[0], alone.q_m)
    np.testing.assert_allclose(later.covariance[0], alone.covariance)
