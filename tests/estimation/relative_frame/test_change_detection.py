"""The alarm: sees jumps soon, stays quiet without, forgives known travel."""

from __future__ import annotations

import numpy as np
import pytest

from bench.registration import jumps
from bench.registration.over_time import INTERVAL_S, first, moved, pairs
from bench.registration.scenes import DEG
from estimation.arrays import Array
from estimation.relative_frame import (
    STEADY,
    Drift,
    OwnAxesFrame,
    OwnAxesInformation,
    Travel,
    predicted,
    reopened,
    updated,
    watched,
    watching,
)
from estimation.relative_frame.change_detection import WINDOW, disagreement

JUMPS = {"1 deg": (0.0, jumps.JUMP_RAD), "300 m": (jumps.JUMP_M, 0.0)}


@pytest.mark.parametrize("sizes", JUMPS.values(), ids=JUMPS)
def test_a_jump_is_seen_within_fifteen_scans(sizes: tuple[float, float]) -> None:
    raised = jumps.jumped(np.random.default_rng(1), 40, *sizes)
    assert raised[jumps.SETTLE :].any(axis=0).mean() >= 0.95
    assert raised[: jumps.SETTLE].any(axis=0).mean() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("sizes", JUMPS.values(), ids=JUMPS)
def test_demand_in_full(sizes: tuple[float, float]) -> None:
    raised = jumps.jumped(np.random.default_rng(2), 500, *sizes)
    assert raised[jumps.SETTLE :].any(axis=0).mean() >= 0.98


@pytest.mark.slow
def test_false_alarms_in_full() -> None:
    quiet = jumps.jumped(np.random.default_rng(3), 200, 0.0, 0.0, 300)
    assert jumps.false_alarms(quiet) / (200 * 300) * 3000 <= 1


def test_chi2_has_three_degrees_when_all_is_well() -> None:
    rng = np.random.default_rng(4)
    frame, truth = first(rng, 4000)
    frame = updated(*pairs(rng, truth, 20), frame).frame
    said = updated(*pairs(rng, truth, 8), frame).information
    chi2 = disagreement(said, frame)
    assert chi2.mean() == pytest.approx(3, abs=0.2)  # sigma .04, and a little curvature
    assert (chi2 > 16.3).mean() < 0.004


def test_one_pair_is_judged_on_what_it_says() -> None:
    rng = np.random.default_rng(5)
    frame, truth = first(rng, 4000)
    frame = updated(*pairs(rng, truth, 20), frame).frame
    said = updated(*pairs(rng, truth, 1), frame).information
    assert disagreement(said, frame).mean() == pytest.approx(2, abs=0.15)


def test_known_travel_raises_nothing() -> None:
    """Carriers that move 2 km in the window by their own reckoning."""
    rng = np.random.default_rng(6)
    frame, truth = first(rng, 20)
    frame = updated(*pairs(rng, truth, 40), frame).frame
    watch, travel = watching(frame), Travel([120.0, 40.0], [-60.0, 150.0])
    for _ in range(3 * WINDOW):
        truth = moved(truth, travel, np.zeros((20, 3)))
        expected = predicted(frame, INTERVAL_S, STEADY, travel)
        update = updated(*pairs(rng, truth, 8), expected)
        watch, alarm = watched(watch, expected, update.information, INTERVAL_S, STEADY, travel)
        frame = update.frame
        assert alarm.window_chi2.mean() < 6
        assert len(watch.scans) <= WINDOW
    assert not alarm.raised.any()


def test_the_window_is_the_sum_of_its_scans() -> None:
    """Without walk or travel: eight scans that say the same are one scan that says it eightfold."""
    frame = OwnAxesFrame(np.array([1e3, 2e3]), np.array(0.1), np.diag([400.0, 400.0, 1e-6]))
    matrix = np.diag([1e-3, 2e-3, 1e5])

    def said(times: float) -> OwnAxesInformation:
        vector: Array = times * matrix @ [15.0, -10.0, 1e-3]
        return OwnAxesInformation(
            np.array([1e3, 2e3, 0.1]), times * matrix, vector, np.zeros(()), 4
        )

    watch = watching(frame)
    for _ in range(WINDOW):
        watch, alarm = watched(watch, frame, said(1.0), 1.0, Drift(0.0, 0.0))
    assert float(alarm.window_chi2) == pytest.approx(float(disagreement(said(8.0), frame)))


def test_reopening_keeps_the_estimate_and_widens_it() -> None:
    frame = OwnAxesFrame(np.array([1e3, 2e3]), np.array(0.1), np.diag([400.0, 400.0, 1e-6]))
    wide = reopened(frame, 300.0, 1 * DEG)
    np.testing.assert_array_equal(wide.q_m, frame.q_m)
    np.testing.assert_allclose(
        np.diag(wide.covariance), np.diag(frame.covariance) + np.array([9e4, 9e4, DEG**2])
    )
