"""Target logs that are tracks: increments are the plots, reuse is caught, thinning helps."""

from __future__ import annotations

import numpy as np
import pytest

from bench.registration import track_logs
from bench.registration.track_logs import INTERVAL_S, SCANS, filtered, model
from estimation.frames import east_north_from_polar
from estimation.relative_frame import (
    Increment,
    MotionModel,
    TrackLog,
    as_plots,
    equivalent_measurement,
    memory_s,
    reuse,
    thinned,
)


@pytest.fixture(scope="module")
def recording() -> track_logs.Recording:
    return track_logs.recorded(np.random.default_rng(1), 60)


def test_equivalent_measurements_are_the_plots(recording: track_logs.Recording) -> None:
    assert track_logs.plot_differences(recording) < 1e-3
    (before, _), (now, _) = recording.scans[7:9]
    found = track_logs.equivalents(before, now)
    np.testing.assert_allclose(found.covariance[..., 1, 1], 100.0**2, rtol=1e-6)


def test_registration_by_increments_is_honest_and_by_states_is_not(
    recording: track_logs.Recording,
) -> None:
    every = range(1, SCANS)
    by_plots = track_logs.registered(recording, track_logs.plots, every)
    by_tracks = track_logs.registered(recording, track_logs.equivalents, every)
    assert by_tracks == pytest.approx(by_plots, rel=1e-4)
    assert 0.65 < by_tracks < 1.35  # 60 runs: sigma .1
    assert track_logs.registered(recording, track_logs.states, every) > 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_demand_in_full(seed: int) -> None:
    recording = track_logs.recorded(np.random.default_rng(seed), 700)
    nees = track_logs.registered(recording, track_logs.equivalents, range(1, SCANS))
    assert 0.9 < nees < 1.1


def test_thinned_tracks_are_nearly_honest(recording: track_logs.Recording) -> None:
    memory = track_logs.memory_of(recording)
    chosen = thinned(np.arange(SCANS) * INTERVAL_S, memory)
    gaps = np.diff(chosen) * INTERVAL_S
    assert (gaps >= 3 * memory).all()
    assert track_logs.registered(recording, track_logs.states, chosen[1:].tolist()) < 1.6


def test_naive_reuse_is_warned_of_and_plots_are_not() -> None:
    caught = reuse(4.0, 54.0)
    assert "times too small" in caught.warning
    assert caught.inflation == pytest.approx(2 * 54 / 4, rel=0.01)  # for long memories
    assert reuse(4.0, 0.0).warning == ""
    assert reuse(200.0, 54.0).warning == ""
    assert "use it once" in reuse(1.0, float("inf")).warning


def test_memory_is_that_of_an_error_of_the_filter() -> None:
    """Shift one state and filter on: the two runs grow together at the rate that is stated."""
    scans = track_logs.recorded(np.random.default_rng(3), 1).scans
    states = [pair[0].tracks for pair in scans]
    late = states[20]
    shifted = TrackLog(late.state + np.array([50.0, 0.0, 0.5, 0.0]), late.covariance)
    apart = []
    for pair in scans[21:]:
        shifted = filtered(shifted, pair[0].plots, model())
        apart.append(np.abs(shifted.state - pair[0].tracks.state)[0, 0, :2].max())
    stated = float(memory_s(states[-2], states[-1], model(), INTERVAL_S)[0, 0])
    # it rings, so compare with the envelope: gone to a tenth within four memories
    assert apart[min(len(apart) - 1, round(4 * stated / INTERVAL_S))] < 0.15 * 50


def test_a_track_that_never_forgets() -> None:
    still = MotionModel(np.eye(2), np.zeros((2, 2)))
    before = TrackLog(np.zeros(2), np.eye(2) * 100.0)
    assert np.isinf(memory_s(before, before, still, 5.0))


def test_two_plots_between_reports_lose_only_the_velocity() -> None:
    """What several plots say of the place alone: as much as the last of them or more."""
    scans = [pair[0] for pair in track_logs.recorded(np.random.default_rng(4), 2).scans]
    two = MotionModel(
        model().transition @ model().transition,
        model().transition @ model().noise @ model().transition.T + model().noise,
    )
    gained = equivalent_measurement(scans[10].tracks, scans[12].tracks, two)
    place, covariance = as_plots(gained)
    last = scans[12].plots
    plot = east_north_from_polar(last.bearing_rad, last.range_m)
    assert (np.linalg.norm(place - plot, axis=-1) < 600).all()
    single = as_plots(equivalent_measurement(scans[11].tracks, scans[12].tracks, model()))[1]
    assert (np.linalg.det(covariance) <= np.linalg.det(single) * 1.001).all()


def test_positions_alone_need_no_velocity() -> None:
    y = np.array([[4.0, 1.0], [1.0, 3.0]])
    place, covariance = as_plots(Increment(y @ [10.0, 20.0], y))
    np.testing.assert_allclose(place, [10.0, 20.0])
    np.testing.assert_allclose(covariance, np.linalg.inv(y))
