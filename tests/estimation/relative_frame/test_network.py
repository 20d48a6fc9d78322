"""Many carriers jointly: two are the pairwise adjustment, more are honest and better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.registration import networks
from bench.registration.scenes import experiment, logs_of
from estimation.relative_frame import (
    NetworkLogs,
    NetworkPrior,
    adjustment,
    network_adjustment,
)
from estimation.relative_frame.gauge import root_of


def test_two_carriers_are_the_pairwise_adjustment() -> None:
    scene = experiment(np.random.default_rng(1), (), 6)
    pair = adjustment(*logs_of(scene))
    logs = NetworkLogs(
        np.repeat([0, 1], 6),
        np.tile(np.arange(6), 2),
        np.concatenate([scene.own.bearing_rad, scene.other.bearing_rad]),
        np.concatenate([scene.own.range_m, scene.other.range_m]),
        np.concatenate([scene.own.covariance, scene.other.covariance]),
    )
    sigmas = np.array([scene.prior.sigma_c1_rad, scene.prior.sigma_c2_rad])
    prior = NetworkPrior(
        np.stack([np.zeros(2), scene.prior.offset_m]),
        np.stack([np.zeros((2, 2)), scene.prior.offset_covariance]),
        sigmas,
    )
    joint = network_adjustment(logs, prior)
    assert joint.converged
    np.testing.assert_allclose(joint.q_m[1], pair.own_axes.q_m, atol=1e-2)
    assert joint.D_rad[1] == pytest.approx(float(pair.own_axes.D_rad), abs=1e-6)
    np.testing.assert_allclose(
        joint.frame(1).covariance, pair.own_axes.covariance, rtol=1e-4, atol=1e-6
    )
    assert joint.chi2 == pytest.approx(float(pair.fixed.chi2), rel=1e-5)
    assert joint.dof == pair.fixed.dof


def test_joint_is_honest_and_better_than_the_star() -> None:
    m = networks.measure(1, 25, 8, 40, 0.3)
    assert m.nees == pytest.approx(1, abs=0.2)  # 25 runs of 21 degrees: sigma .06
    assert m.chi2 == pytest.approx(1, abs=0.15)
    assert m.star_by_joint > 1.5
    assert m.converged == 1


def test_bearing_only_carriers_may_be_mixed_in() -> None:
    m = networks.measure(2, 25, 8, 40, 0.3, bearing_only=3)
    assert m.nees == pytest.approx(1, abs=0.25)
    assert m.converged > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_demands_in_full(seed: int) -> None:
    m = networks.measure(seed, 500, 8, 40, 0.3)
    assert 0.95 < m.nees < 1.05
    assert m.star_by_joint >= 1.5


def test_a_triangle_of_single_shared_targets_is_solved() -> None:
    """No pair shares two targets, so no pair could tell a turn; the three together can."""
    honest, turn, rank = networks.triangle_nees(1, 60)
    assert honest == pytest.approx(1, abs=0.3)  # 60 runs of 6 degrees: sigma .075
    assert turn < 0.7
    assert rank == 6


def test_renumbering_carriers_and_targets_changes_nothing() -> None:
    scene = networks.drawn(np.random.default_rng(6), 5, 20, 0.5)
    found = network_adjustment(scene.logs, scene.prior)
    order = np.array([0, 3, 1, 4, 2])  # the own carrier keeps the gauge
    place = np.argsort(order)
    again = network_adjustment(
        replace(
            scene.logs,
            carrier=place[scene.logs.carrier],
            target=np.random.default_rng(1).permutation(20)[scene.logs.target],
        ),
        NetworkPrior(*(part[order] for part in scene.prior)),
    )
    np.testing.assert_allclose(again.q_m, found.q_m[order], atol=1e-3)
    np.testing.assert_allclose(again.D_rad, found.D_rad[order], atol=1e-8)


def test_who_shares_nothing_keeps_the_prior() -> None:
    rng = np.random.default_rng(7)
    seen = np.zeros((3, 10), dtype=bool)
    seen[:2, :5], seen[2, 5:] = True, True
    places = rng.uniform(-15e3, 15e3, (10, 2))
    stations = np.array([[0.0, 0.0], [9e3, 2e3], [-7e3, 8e3]])
    scene = networks.observed(rng, places, stations, seen)
    found = network_adjustment(scene.logs, scene.prior)
    assert found.converged
    np.testing.assert_allclose(found.information[6:, 6:], 0, atol=1e-9)
    sigmas = np.sqrt(np.diag(found.covariance)[6:8])
    assert (sigmas > 1400).all()


def test_two_bearing_only_carriers_at_one_instant_say_nothing() -> None:
    rng = np.random.default_rng(8)
    places = rng.uniform(-15e3, 15e3, (12, 2))
    stations = np.array([[0.0, 0.0], [9e3, 2e3]])
    scene = networks.observed(rng, places, stations, np.ones((2, 12), dtype=bool), bearing_only=2)
    found = network_adjustment(scene.logs, scene.prior)
    np.testing.assert_allclose(found.information, 0, atol=1e-12)
    assert found.dof == 0


def test_a_bearing_only_carrier_needs_three_targets() -> None:
    rng = np.random.default_rng(9)
    stations = np.array([[0.0, 0.0], [9e3, 2e3]])
    for count in (2, 3):
        places = rng.uniform(-15e3, 15e3, (count, 2))
        seen = np.ones((2, count), dtype=bool)
        scene = networks.observed(rng, places, stations, seen, bearing_only=1)
        found = network_adjustment(scene.logs, scene.prior)
        root = root_of(found.prior_covariance[3:, 3:])
        gained = np.linalg.eigvalsh(root.T @ found.information[3:, 3:] @ root)
        assert (gained > 1e-6).sum() == count


def test_no_logs_and_unknown_carriers() -> None:
    scene = networks.drawn(np.random.default_rng(10), 3, 4, 1.0)
    none = np.arange(0)
    empty = NetworkLogs(none, none, np.zeros(0), np.zeros(0), np.zeros((0, 2, 2)))
    found = network_adjustment(empty, scene.prior)
    assert found.converged
    assert found.chi2 == 0
    with pytest.raises(ValueError, match="carrier 2, the prior knows 2"):
        network_adjustment(scene.logs, NetworkPrior(*(part[:2] for part in scene.prior)))
