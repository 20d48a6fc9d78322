"""Tracks of tracks: increments are the plots, an intersection is never too sure, nothing twice."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from bench.joint_fusion import track_logs
from estimation.ledger import EMPTY_LEDGER, counted
from estimation.relative_frame import Increment, TrackLog
from estimation.track_fusion import (
    covariance_intersection,
    information_of,
    predicted,
    with_increments,
)


@pytest.fixture(scope="module")
def recording() -> track_logs.Recording:
    return track_logs.recorded(1, 100)


def test_increments_are_central_fusion(recording: track_logs.Recording) -> None:
    central = track_logs.fused(recording, track_logs.by_plots)
    exact = track_logs.fused(recording, track_logs.by_increments)
    assert track_logs.difference(exact.track, central.track) < 1e-9
    assert 0.9 < exact.nees < 1.1  # 100 targets, 20 scans, correlated: sigma .03


def test_intersection_is_never_too_sure_and_states_as_plots_are(
    recording: track_logs.Recording,
) -> None:
    assert track_logs.fused(recording, track_logs.by_intersection).nees < 1.1
    assert track_logs.fused(recording, track_logs.naively).nees > 2


def covariances(rng, count: int, n: int):
    roots = rng.normal(size=(count, n, n))
    return roots @ np.swapaxes(roots, 1, 2) + 0.05 * np.eye(n)


def test_the_weight_makes_the_determinant_least() -> None:
    rng = np.random.default_rng(2)
    a, b = covariances(rng, 30, 4), covariances(rng, 30, 4)
    found = covariance_intersection(
        TrackLog(np.zeros((30, 4)), a), information_of(TrackLog(np.zeros((30, 4)), b), 4)
    )
    for k in range(30):
        pa, pb = np.linalg.inv(a[k]), np.linalg.inv(b[k])
        best = minimize_scalar(
            lambda w, pa=pa, pb=pb: -np.linalg.slogdet(w * pa + (1 - w) * pb)[1],
            bounds=(0, 1),
            method="bounded",
            options={"xatol": 1e-9},
        )
        assert -np.linalg.slogdet(np.linalg.inv(found.track.covariance[k]))[1] <= best.fun + 1e-9


def test_it_is_consistent_for_every_correlation() -> None:
    rng = np.random.default_rng(3)
    a, b = covariances(rng, 2, 3)
    la, lb = np.linalg.cholesky(a), np.linalg.cholesky(b)
    zero = np.zeros((1, 3))
    found = covariance_intersection(
        TrackLog(zero, a[None]), information_of(TrackLog(zero, b[None]), 3)
    )
    w, p = found.weight[0], found.track.covariance[0]
    gain_a, gain_b = w * p @ np.linalg.inv(a), (1 - w) * p @ np.linalg.inv(b)
    for _ in range(50):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(-1, 1)
        cross = la @ turn @ lb.T  # every |turn| <= 1 is a possible correlation
        true = gain_a @ a @ gain_a.T + gain_b @ b @ gain_b.T
        true += gain_a @ cross @ gain_b.T + gain_b @ cross.T @ gain_a.T
        assert np.linalg.eigvalsh(p - true).min() > -1e-9


def test_a_track_that_meets_itself_learns_nothing() -> None:
    rng = np.random.default_rng(4)
    track = TrackLog(rng.normal(size=(20, 4)), covariances(rng, 20, 4))
    found = covariance_intersection(track, information_of(track, 4)).track
    np.testing.assert_allclose(found.covariance, track.covariance, rtol=1e-9)
    np.testing.assert_allclose(found.state, track.state, rtol=1e-9)


def test_what_says_nothing_changes_nothing_and_a_place_alone_leaves_the_speed() -> None:
    rng = np.random.default_rng(5)
    track = TrackLog(rng.normal(size=(5, 4)), covariances(rng, 5, 4))
    silent = Increment(np.zeros((5, 4)), np.zeros((5, 4, 4)))
    found = covariance_intersection(track, silent)
    np.testing.assert_array_equal(found.weight, 1.0)
    np.testing.assert_allclose(found.track.covariance, track.covariance, rtol=1e-9)
    place = TrackLog(track.state[:, :2], 1e-4 * track.covariance[:, :2, :2])
    sharp = covariance_intersection(track, information_of(place, 4)).track
    assert (sharp.covariance[:, 0, 0] < 0.01 * track.covariance[:, 0, 0]).all()
    assert np.isfinite(sharp.covariance).all()


def test_increments_of_several_sources_meet_their_own_tracks() -> None:
    rng = np.random.default_rng(6)
    track = TrackLog(rng.normal(size=(3, 2)), covariances(rng, 3, 2))
    logs = TrackLog(rng.normal(size=(4, 2)), covariances(rng, 4, 2))
    row = np.array([2, 0, 2, 2])
    together = with_increments(track, information_of(logs, 2), row)
    np.testing.assert_array_equal(together.state[1], track.state[1])
    one = TrackLog(track.state[2:], track.covariance[2:])
    for k in (3, 0, 2):
        log = information_of(TrackLog(logs.state[k : k + 1], logs.covariance[k : k + 1]), 2)
        one = with_increments(one, log, np.array([0]))
    np.testing.assert_allclose(together.state[2], one.state[0], rtol=1e-10)
    np.testing.assert_allclose(together.covariance[2], one.covariance[0], rtol=1e-10)


def test_repeated_reports_leave_the_track_honest(recording: track_logs.Recording) -> None:
    """Every report arrives twice; the ledger lets each in once."""

    def twice(of: track_logs.Recording, scan: int, track: TrackLog) -> TrackLog:
        key, begin = np.array([1, 2, 1, 2]), np.full(4, scan)
        fresh, _ = counted(EMPTY_LEDGER, key, begin, begin + 1)
        return track_logs.by_increments(of, scan, track) if fresh.sum() == 2 else track

    central = track_logs.fused(recording, track_logs.by_plots)
    assert track_logs.difference(track_logs.fused(recording, twice).track, central.track) < 1e-9


def test_prediction() -> None:
    track = TrackLog(np.array([1.0, 2.0, 3.0, 4.0]), np.eye(4))
    moved = predicted(track, track_logs.model())
    np.testing.assert_allclose(moved.state, [4.0, 6.0, 3.0, 4.0])
    assert moved.covariance[0, 0] == pytest.approx(2 + track_logs.Q / 3)
