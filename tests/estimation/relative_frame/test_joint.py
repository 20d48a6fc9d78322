"""Frames of all carriers followed together: honest over time, and better than each by itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.consistency import mean_interval, nees
from estimation.frames import polar_from_east_north, rotation_clockwise, wrap_pi
from estimation.relative_frame import NetworkLogs, OwnAxesFrame, PolarLogs, updated
from estimation.relative_frame.joint import (
    Elapsed,
    JointFrames,
    carried_on,
    improved_by,
    own_alone,
)

DEG = np.pi / 180
SIGMA_B, SIGMA_D = 0.4 * DEG, 40.0
SIGMA_U, SIGMA_BIAS, SIGMA_SCALE = 0.4, 30.0, 3e-3
WANDER = 2e-4  # rad per root second


class World(NamedTuple):
    """Carriers (N) and targets in true axes; north errors c: true bearing = bearing + c."""

    place: Array
    velocity: Array
    drift: Array  # true less believed velocity, true axes
    c: Array
    bias: Array  # these two are added to ranges
    scale: Array

    def frame(self, i: int) -> Array:
        q = rotation_clockwise(-self.c[0]) @ (self.place[i] - self.place[0])
        return np.array([*q, self.c[i] - self.c[0]])


def world(rng: np.random.Generator, carriers: int) -> World:
    return World(
        rng.uniform(-10e3, 10e3, (carriers, 2)),
        rng.normal(0, 6, (carriers, 2)),
        rng.normal(0, SIGMA_U, (carriers, 2)),
        rng.normal(0, DEG, carriers),
        rng.normal(0, SIGMA_BIAS, carriers),
        rng.normal(0, SIGMA_SCALE, carriers),
    )


def moved(rng: np.random.Generator, w: World, dt: float) -> tuple[World, Array]:
    """The world later, and what each carrier reckons to have travelled along its own axes."""
    way = (rotation_clockwise(-w.c) @ (w.velocity - w.drift)[..., None])[..., 0] * dt
    c = w.c + rng.normal(0, WANDER * np.sqrt(dt), len(w.c))
    return w._replace(place=w.place + w.velocity * dt, c=c), way


def elapsed(dt: float, way: Array) -> Elapsed:
    n = len(way)
    return Elapsed(
        dt, way, np.ones(n), np.full(n, SIGMA_U), np.zeros(n), np.full(n, WANDER * np.sqrt(dt))
    )


def logged(rng: np.random.Generator, w: World, targets: Array, seen: float = 0.7) -> NetworkLogs:
    carrier, target = np.nonzero(rng.random((len(w.c), len(targets))) < seen)
    true_b, true_d = polar_from_east_north(targets[target] - w.place[carrier])
    b = wrap_pi(true_b - w.c[carrier] + rng.normal(0, SIGMA_B, len(target)))
    d = (true_d - w.bias[carrier]) / (1 + w.scale[carrier]) + rng.normal(0, SIGMA_D, len(target))
    covariance = np.tile(np.diag([SIGMA_B**2, SIGMA_D**2]), (len(target), 1, 1))
    return NetworkLogs(carrier, target, b, d, covariance)


def start(rng: np.random.Generator, w: World) -> JointFrames:
    """Each frame known by itself beforehand, to 100 m and half a degree."""
    p = np.diag([100.0, 100.0, 0.5 * DEG]) ** 2
    joint = own_alone(SIGMA_U, SIGMA_BIAS, SIGMA_SCALE)
    for i in range(1, len(w.c)):
        x = rng.multivariate_normal(w.frame(i), p)
        frame = OwnAxesFrame(x[:2], x[2], p)
        joint = joint.joined_by(frame, SIGMA_U, SIGMA_BIAS, SIGMA_SCALE)
    return joint


def error(joint: JointFrames, w: World, i: int) -> tuple[Array, Array]:
    frame = joint.frame(i)
    off = np.array([*frame.q_m, float(frame.D_rad)]) - w.frame(i)
    off[2] = wrap_pi(off[2])
    return off, frame.covariance


def runs(count: int, scans: int, carriers: int = 3) -> tuple[Array, Array]:
    """NEES by 3 (count, 3) of the last carrier after 1, half and all scans; location errors."""
    scores, errors = np.empty((count, 3)), np.empty((count, 3))
    for run in range(count):
        rng = np.random.default_rng([7, run])
        w = world(rng, carriers)
        joint, targets = start(rng, w), rng.uniform(-12e3, 12e3, (12, 2))
        marks = {0: 0, scans // 2: 1, scans - 1: 2}
        for scan in range(scans):
            w, way = moved(rng, w, 2.0)
            joint = carried_on(joint, elapsed(2.0, way))
            joint = improved_by(joint, logged(rng, w, targets)).joint
            if scan in marks:
                off, p = error(joint, w, carriers - 1)
                scores[run, marks[scan]] = nees(off, p) / 3
                errors[run, marks[scan]] = np.hypot(*off[:2])
    return scores, errors


def test_frames_that_drift_are_followed_honestly_and_ever_better() -> None:
    """Currents, wandering norths, range biases; 60 runs of 40 scans, NEES of 3 dof at 99.9 %."""
    count = 60
    scores, errors = runs(count, 40)
    low, high = mean_interval(3, count, 0.999)
    assert ((low < scores.mean(axis=0)) & (scores.mean(axis=0) < high)).all()
    rms = np.sqrt(np.square(errors).mean(axis=0))
    assert rms[2] < 0.6 * rms[0]


def test_range_errors_are_found_and_honest() -> None:
    """Bias and scale of each of three carriers after 6 scans; 25 runs, NEES of 2 dof at 99.9 %."""
    runs, scores, surer = 25, [], []
    for run in range(runs):
        rng = np.random.default_rng([8, run])
        w = world(rng, 3)
        joint, targets = start(rng, w), rng.uniform(-12e3, 12e3, (12, 2))
        for _ in range(6):
            joint = improved_by(joint, logged(rng, w, targets)).joint
        for k in range(3):
            ranges = joint.ranges(k)
            off = ranges.mean - [w.bias[k], w.scale[k]]
            scores.append(float(nees(off, ranges.covariance)) / 2)
            surer.append(np.sqrt(np.diag(ranges.covariance)) / [SIGMA_BIAS, SIGMA_SCALE])
    low, high = mean_interval(2, runs, 0.999)  # the three of a run hang together
    assert low < np.mean(scores) < high
    assert (np.mean(surer, axis=0) < [0.8, 0.8]).all()


def test_what_is_known_of_ranges_stays_known_exactly() -> None:
    """Rounding must not make it an unknown, which would be told as an error of a nanometre."""
    rng = np.random.default_rng(6)
    w = world(rng, 3)
    p = np.diag([100.0, 100.0, 0.5 * DEG]) ** 2
    joint = own_alone(SIGMA_U, 0.0)
    for i in (1, 2):
        joint = joint.joined_by(OwnAxesFrame(w.frame(i)[:2], w.frame(i)[2], p), SIGMA_U, 0.0)
    targets = rng.uniform(-12e3, 12e3, (12, 2))
    for _ in range(5):
        w, way = moved(rng, w, 2.0)
        joint = improved_by(carried_on(joint, elapsed(2.0, way)), logged(rng, w, targets)).joint
    for carrier in range(3):
        ranges = joint.ranges(carrier)
        assert not ranges.mean.any()
        assert not ranges.covariance.any()


def test_one_instant_of_two_carriers_is_the_pairwise_update() -> None:
    """Without range errors and drift: to a thousandth of a sigma."""
    rng = np.random.default_rng(3)
    w = world(rng, 2)._replace(bias=np.zeros(2), scale=np.zeros(2))
    p = np.diag([100.0, 100.0, 0.5 * DEG]) ** 2
    x = rng.multivariate_normal(w.frame(1), p)
    frame = OwnAxesFrame(x[:2], np.array(x[2]), p)
    joint = own_alone(0.0, 0.0).joined_by(frame, 0.0, 0.0)
    logs = logged(rng, w, rng.uniform(-12e3, 12e3, (8, 2)), seen=1.1)
    own, other = (
        PolarLogs(
            *(a[logs.carrier == k] for a in (logs.bearing_rad, logs.range_m, logs.covariance))
        )
        for k in (0, 1)
    )
    pairwise, found = updated(own, other, frame), improved_by(joint, logs)
    sigmas = np.sqrt(np.diag(pairwise.frame.covariance))
    one = found.joint.frame(1)
    assert np.all(np.abs(one.q_m - pairwise.frame.q_m) < 1e-3 * sigmas[:2])
    assert abs(one.D_rad - pairwise.frame.D_rad) < 1e-3 * sigmas[2]
    np.testing.assert_allclose(one.covariance, pairwise.frame.covariance, rtol=1e-3, atol=1e-12)
    assert found.chi2 == pytest.approx(float(pairwise.chi2), rel=1e-3)
    said = found.said_of(1, 8).with_prior(frame)
    np.testing.assert_allclose(said.covariance, one.covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(said.q_m, one.q_m, atol=1e-3)


def test_what_is_said_of_one_carrier_with_the_rest_gives_its_posterior() -> None:
    """Three carriers, biases and all: said_of and the expected frame make the joint answer."""
    rng = np.random.default_rng(5)
    w = world(rng, 3)
    joint = start(rng, w)
    found = improved_by(joint, logged(rng, w, rng.uniform(-12e3, 12e3, (15, 2))))
    for i in (1, 2):
        alone = found.said_of(i, 10).with_prior(joint.frame(i))
        np.testing.assert_allclose(alone.q_m, found.joint.frame(i).q_m, atol=0.01)
        np.testing.assert_allclose(
            alone.covariance, found.joint.frame(i).covariance, rtol=1e-4, atol=1e-12
        )


def test_a_wrong_target_is_left_out_and_a_jump_is_not_hidden() -> None:
    rng = np.random.default_rng(6)
    w = world(rng, 2)
    joint = start(rng, w)
    logs = logged(rng, w, rng.uniform(-12e3, 12e3, (10, 2)), seen=1.1)
    clean = improved_by(joint, logs)
    bearing = logs.bearing_rad + np.where((logs.carrier == 1) & (logs.target == 4), 0.3, 0.0)
    wrong = improved_by(
        joint, NetworkLogs(logs.carrier, logs.target, bearing, logs.range_m, logs.covariance)
    )
    assert not wrong.used[4]
    assert wrong.used.sum() == clean.used.sum() - 1
    turned = logs.bearing_rad + np.where(logs.carrier == 1, 0.3, 0.0)
    jumped = improved_by(
        joint, NetworkLogs(logs.carrier, logs.target, turned, logs.range_m, logs.covariance)
    )
    assert jumped.used.all()
    assert jumped.chi2 > 10 * jumped.target_dof.sum()


def test_a_frame_found_in_the_axes_of_another_brings_its_doubt_along() -> None:
    """20 000 draws of both: the scatter of what is composed, and of it with the base, to 5 %."""
    rng = np.random.default_rng(8)
    w = world(rng, 2)
    joint = start(rng, w)
    p = np.diag([30.0, 50.0, 0.1 * DEG]) ** 2
    seen = OwnAxesFrame(np.array([4000.0, -7000.0]), np.array(0.02), p)
    both = joint.joined_through(1, seen, 0.0, 0.0)
    base = joint.frame(1)
    bases = rng.multivariate_normal([*base.q_m, float(base.D_rad)], base.covariance, 20_000)
    seens = rng.multivariate_normal([*seen.q_m, float(seen.D_rad)], p, 20_000)
    away = (rotation_clockwise(bases[:, 2]) @ seens[:, :2, None])[..., 0]
    drawn = np.column_stack([bases[:, :2] + away, bases[:, 2] + seens[:, 2]])
    scatter = np.cov(np.column_stack([bases, drawn]).T)
    which = [7, 8, 9, 14, 15, 16]
    claimed = both.covariance[np.ix_(which, which)]
    scale = np.sqrt(np.diag(claimed))
    np.testing.assert_allclose(
        scatter / np.outer(scale, scale), claimed / np.outer(scale, scale), atol=0.05
    )
    np.testing.assert_allclose(
        both.frame(2).q_m, base.q_m + rotation_clockwise(base.D_rad) @ seen.q_m
    )


def test_carriers_come_and_go() -> None:
    rng = np.random.default_rng(7)
    w = world(rng, 4)
    joint = start(rng, w)
    fewer = joint.without(2)
    assert fewer.carriers == 3
    for before, after in ((1, 1), (3, 2)):
        np.testing.assert_array_equal(fewer.frame(after).q_m, joint.frame(before).q_m)
        np.testing.assert_array_equal(fewer.frame(after).covariance, joint.frame(before).covariance)
    anew = joint.with_frame(1, joint.frame(2))
    np.testing.assert_array_equal(anew.frame(1).covariance, joint.frame(2).covariance)
    assert not anew.covariance[7:10, 14:].any()


def test_the_score_of_a_bias_is_what_a_prior_of_it_would_make_of_the_logs() -> None:
    """Of variance V it is g / (I + 1 / V) and as sure as I + 1 / V; to a hundredth, being bent."""
    rng = np.random.default_rng(11)
    w = world(rng, 3)
    joint, row, sigma_m = start(rng, w), 7 * 1 + 5, 20.0
    silent = joint.covariance.copy()
    silent[row], silent[:, row] = 0.0, 0.0
    open_to_it = silent.copy()
    open_to_it[row, row] = sigma_m**2
    logs = logged(rng, w, rng.uniform(-12e3, 12e3, (30, 2)), seen=1.0)
    sure = 1 - 1e-12
    score, information = improved_by(JointFrames(joint.mean, silent), logs, sure).range_score(1)
    found = improved_by(JointFrames(joint.mean, open_to_it), logs, sure).joint
    whole = information + sigma_m**-2
    assert found.covariance[row, row] == pytest.approx(1 / whole, rel=0.01)
    assert found.mean[1, 5] == pytest.approx(score / whole, rel=0.01)
