"""Optional states, and what each geometry hides: by numbers and in words."""

from __future__ import annotations

import numpy as np
import pytest

from bench.registration import sensors
from bench.registration.over_time import first, seen
from bench.registration.scenes import DEG
from estimation.arrays import Array
from estimation.frames import polar_from_east_north
from estimation.relative_frame import (
    NetworkLogs,
    NetworkPrior,
    PolarLogs,
    RelativeFramePrior,
    adjustment,
    diagnose,
    network_adjustment,
    situation,
)
from estimation.relative_frame.sensor_errors import (
    NAMES,
    SensorErrorPrior,
    SensorRegistration,
    adjustment_with_sensor_errors,
)

OFFSET = np.array([9e3, -4e3])
PRIOR = RelativeFramePrior.from_sigmas(OFFSET, 1500, 1500, DEG, DEG)


def exact(places: Array) -> PolarLogs:
    return PolarLogs.from_sigmas(*polar_from_east_north(places), 0.5 * DEG, 100.0)


def scattered(count: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).uniform(-15e3, 15e3, (count, 2))


def registered(
    places: Array, prior: SensorErrorPrior, velocity: Array | None = None
) -> SensorRegistration:
    return adjustment_with_sensor_errors(
        exact(places), exact(places - OFFSET), PRIOR, prior, velocity
    )


def test_without_sensor_errors_it_is_the_adjustment() -> None:
    rng = np.random.default_rng(2)
    _, truth = first(rng, 20)
    own, other = seen(rng, rng.uniform(-15e3, 15e3, (20, 6, 2)), truth)
    prior = RelativeFramePrior(truth.q_m + 700.0, PRIOR.offset_covariance, DEG, DEG)
    plain = adjustment(own, other, prior)
    same = adjustment_with_sensor_errors(own, other, prior, SensorErrorPrior())
    np.testing.assert_allclose(same.own_axes.q_m, plain.own_axes.q_m, atol=0.05)
    np.testing.assert_allclose(
        same.own_axes.covariance, plain.own_axes.covariance, rtol=1e-3, atol=1e-6
    )
    assert not same.errors.any()


def test_all_sensor_errors_are_found_and_honest() -> None:
    m = sensors.measure(3, 1000, 12)
    assert m.converged == 1
    assert m.nees == pytest.approx(1, abs=0.06)  # 1000 runs of 7 degrees: sigma .017
    assert m.chi2 == pytest.approx(1, abs=0.04)
    assert (m.learnt < [0.6, 0.6, 0.97, 0.2]).all()


def test_both_biases_need_three_targets() -> None:
    """Two targets: four conditions for five unknowns; three: six."""
    biases = SensorErrorPrior(200.0, 200.0)
    ranks = []
    for count in (2, 3):
        found = registered(scattered(count, 4), biases)
        ranks.append(diagnose(found.information, found.prior_covariance, NAMES).rank)
    assert ranks == [4, 5]


def test_a_common_range_scale_is_never_observable() -> None:
    """Stretch everything that both measure: a longer baseline fits as well as the right one."""
    places = scattered(30, 5)
    stretched = 1.01
    wide = RelativeFramePrior.from_sigmas(OFFSET * stretched, 1500, 1500, DEG, DEG)
    found = adjustment(exact(places * stretched), exact((places - OFFSET) * stretched), wide)
    assert float(found.fixed.chi2) < 1e-6


def test_a_convoy_hides_the_clock_offset() -> None:
    places, clock = scattered(8, 6), SensorErrorPrior(clock_s=20.0)
    convoy = np.tile([8.0, 3.0], (8, 1))
    mixed = np.random.default_rng(7).normal(0, 100.0, (8, 2))
    hidden = registered(places, clock, convoy)
    told = registered(places, clock, mixed)
    found = diagnose(hidden.information, hidden.prior_covariance, NAMES)
    assert found.rank == 3
    assert "clock offset" in found.weakest
    assert "not told by the targets at all" in found.sentence
    assert diagnose(told.information, told.prior_covariance, NAMES).rank == 4
    assert situation.clock_reasons(convoy) == [situation.CONVOY]
    assert situation.clock_reasons(None) == [situation.NO_VELOCITY]
    assert situation.clock_reasons(mixed) == []
    without = registered(places, clock)
    assert np.sqrt(without.covariance[6, 6]) == pytest.approx(20.0)


@pytest.mark.parametrize(("count", "rank"), [(0, 0), (1, 2), (2, 3), (6, 3)])
def test_rank_of_range_and_bearing(count: int, rank: int) -> None:
    places = scattered(count, 8)
    found = registered(places, SensorErrorPrior())
    diagnosis = diagnose(found.information, found.prior_covariance, NAMES)
    assert diagnosis.rank == rank
    assert diagnosis.singular_values.shape == (3,)
    assert (np.diff(diagnosis.singular_values) <= 0).all()
    expected = {0: [situation.NO_TARGET], 1: [situation.ONE_TARGET]}.get(count, [])
    assert situation.reasons(exact(places), exact(places - OFFSET)) == expected
    if count == 1:
        assert "orientation" in diagnosis.weakest


def test_a_cluster_hides_the_heading() -> None:
    places = np.array([10e3, 3e3]) + np.random.default_rng(9).normal(0, 40, (6, 2))
    found = registered(places, SensorErrorPrior())
    diagnosis = diagnose(found.information, found.prior_covariance, NAMES)
    assert diagnosis.beaten == 2
    assert "orientation" in diagnosis.weakest
    (sentence,) = situation.reasons(exact(places), exact(places - OFFSET))
    assert "cluster" in sentence
    assert "hide the heading" in sentence


def bearing_only(places: Array, carrier: Array, ranged: bool) -> Array:
    """Information (3, 3) of exact logs, the other measuring bearings only; and the prior."""
    count = len(places)
    both = [polar_from_east_north(p) for p in (places, places - carrier)]
    ranges = both[0][1] if ranged else np.full(count, np.nan)
    logs = NetworkLogs(
        np.repeat([0, 1], count),
        np.tile(np.arange(count), 2),
        np.concatenate([both[0][0], both[1][0]]),
        np.concatenate([ranges, np.full(count, np.nan)]),
        np.broadcast_to(np.diag([(0.5 * DEG) ** 2, 1e4]), (2 * count, 2, 2)),
    )
    spread = np.broadcast_to(np.diag([1500.0**2] * 2), (2, 2, 2))
    prior = NetworkPrior(np.stack([np.zeros(2), carrier]), spread, np.full(2, DEG))
    return np.stack(
        [
            (found := network_adjustment(logs, prior)).information[3:, 3:],
            found.prior_covariance[3:, 3:],
        ]
    )


def test_two_bearing_only_carriers_say_nothing() -> None:
    diagnosis = diagnose(*bearing_only(scattered(10, 10), OFFSET, ranged=False))
    assert diagnosis.rank == 0
    assert situation.bearing_only_reasons(scattered(10), OFFSET, both=True) == [
        situation.TWO_BEARING_ONLY
    ]


def test_the_danger_circle_hides_a_bearing_only_carrier() -> None:
    angles = np.array([0.3, 1.4, 2.9, 4.0])
    carrier = np.array([12e3, 0.0])
    circle = 6e3 * np.stack([np.sin(angles), np.cos(angles)], axis=1) + [6e3, 0.0]
    assert diagnose(*bearing_only(circle, carrier, ranged=True)).rank == 2
    (sentence,) = situation.bearing_only_reasons(circle, carrier, both=False)
    assert "danger circle" in sentence
    off = np.vstack([circle, [[-9e3, 9e3]]])
    assert diagnose(*bearing_only(off, carrier, ranged=True)).rank == 3
    assert situation.bearing_only_reasons(off, carrier, both=False) == []
    assert situation.bearing_only_reasons(off[:2], carrier, both=False) == [
        situation.TOO_FEW_BEARINGS
    ]


def test_diagnosis_refuses_what_it_cannot_name() -> None:
    with pytest.raises(ValueError, match="3 for 2"):
        diagnose(np.eye(2), np.eye(2))
    with pytest.raises(ValueError, match="nothing to determine"):
        diagnose(np.eye(3), np.zeros((3, 3)))


def test_singular_values_are_prior_over_data_sigmas() -> None:
    found = diagnose(np.diag([1 / 10.0**2, 1 / 50.0**2, 0.0]), np.diag([1e4, 1e4, 1.0]))
    np.testing.assert_allclose(found.singular_values, [10, 2, 0])
    assert (found.rank, found.beaten, found.weakest) == (2, 2, "orientation")
