"""The most probable alignment: honest, independent of axes, equal to a general-purpose solver."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares

from bench.navigation import alignment
from bench.navigation.circling import (
    BEACONS_M,
    Flight,
    Score,
    aligned,
    flight,
    papers,
    score,
    truth_of,
    with_late_ranges,
)
from estimation.bordered import factor, inverse, normal_equations
from estimation.frames import rotation_clockwise
from estimation.system_alignment import (
    PLAIN,
    Prior,
    align,
    closed_form_start,
    dead_reckoning,
    places_of,
    prior,
    ranges,
)
from estimation.system_alignment.model import Model

RUNS = 40


@cache
def flown(epochs: int = 200, *, differences: bool = False, offsets: bool = False) -> list[Flight]:
    rng = np.random.default_rng(7)
    return [flight(rng, epochs, differences=differences, offsets=offsets) for _ in range(RUNS)]


@cache
def scored(*, differences: bool = False) -> Score:
    return score(flown(400 if differences else 200, differences=differences), aligned)


@pytest.mark.parametrize("differences", [False, True])
def test_honest_and_near_the_bound(differences: bool) -> None:
    result = scored(differences=differences)
    assert result.solved.all()
    assert result.mirrored() == 0
    # 40 runs of 8 constants: NEES sigma .08, RMSE sigma some 8 %; three sigmas
    assert 0.76 < result.nees.mean() < 1.24
    for what in ("xy", "z", "W"):
        assert result.rmse(what) < 1.25 * result.bound(what)


def test_works_from_the_first_range() -> None:
    rng = np.random.default_rng(1)
    result = score([flight(rng, 1) for _ in range(60)], aligned)
    assert result.solved.all()
    assert 0.8 < result.nees.mean() < 1.2  # mostly the prior's own: sigma .065
    assert result.rmse("xy") < 50


def test_late_ranges_hardly_matter() -> None:
    rng = np.random.default_rng(2)
    late = score([with_late_ranges(rng, f, 0.2) for f in flown()], aligned)
    clean = scored()
    # a fifth of the ranges lost costs a tenth at most; believed, they cost a hundred metres
    assert late.rmse("xy") < 1.25 * clean.rmse("xy")
    assert 0.76 < late.nees.mean() < 1.24


def test_late_ranges_are_named_by_their_weight() -> None:
    one = flown()[0]
    value = one.logs.value_m.copy()
    value[[10, 200]] += 100
    found = align(one.path, one.logs._replace(value_m=value), one.prior)
    assert set(np.flatnonzero(found.weights == 0)) == {10, 200}


def test_robustness_is_free_on_clean_data() -> None:
    plain = [align(f.path, f.logs, f.prior, losses=PLAIN).theta for f in flown()[:10]]
    robust = [aligned(f).theta for f in flown()[:10]]
    np.testing.assert_allclose(robust, plain, atol=1e-2)


def test_equal_to_a_general_solver() -> None:
    rng = np.random.default_rng(3)
    one = flight(rng, 30, offsets=True)
    found = align(one.path, one.logs, one.prior, losses=PLAIN)
    model = Model(one.path, one.logs, one.prior)

    def rows(unknown: np.ndarray) -> np.ndarray:
        at = model(unknown[:60].reshape(30, 2), unknown[60:])
        return np.concatenate([at.chain.residual.ravel(), at.observed.residual, at.known_residual])

    start = np.concatenate([found.path_m.ravel(), one.prior.mean[one.prior.free]])
    reference = least_squares(rows, start, xtol=1e-14, ftol=1e-14, gtol=1e-12)
    sigma = np.sqrt(np.diag(found.covariance)[one.prior.free])
    difference = (found.theta[one.prior.free] - reference.x[60:]) / sigma
    assert np.abs(difference).max() < 2e-3  # the last step promised less than 1e-6 of chi2


def _turned(one: Flight, angle_rad: float, shift_m: np.ndarray) -> Flight:
    """The same flight seen from axes turned and moved."""
    rotation = rotation_clockwise(angle_rad)
    path = one.path._replace(
        travel_m=one.path.travel_m @ rotation.T,
        covariance=rotation @ one.path.covariance @ rotation.T,
        start_m=one.path.start_m @ rotation.T + shift_m,
    )
    return one._replace(path=path, prior=_turned_prior(one.prior, rotation, shift_m))


def _turned_prior(known: Prior, rotation: np.ndarray, shift_m: np.ndarray) -> Prior:
    whole = np.eye(len(known.mean))
    mean = known.mean.copy()
    pairs = [np.array([0, 1]), *places_of(mean)[:, :2]]
    for pair in pairs:
        whole[np.ix_(pair, pair)] = rotation
    mean = whole @ mean
    for pair in pairs[1:]:
        mean[pair] += shift_m
    return Prior(mean, whole @ known.covariance @ whole.T)


@pytest.mark.parametrize("differences", [False, True])
def test_turning_and_moving_the_scene_changes_nothing_else(differences: bool) -> None:
    one = flown(400 if differences else 200, differences=differences)[1]
    shift, angle = np.array([5e3, -3e3]), 2.1
    here, there = aligned(one), aligned(_turned(one, angle, shift))
    back = rotation_clockwise(-angle)
    np.testing.assert_allclose(
        (there.beacons_m[:, :2] - shift) @ back.T, here.beacons_m[:, :2], atol=1e-2
    )
    np.testing.assert_allclose(there.beacons_m[:, 2], here.beacons_m[:, 2], atol=2e-2)
    np.testing.assert_allclose(there.theta[:2] @ back.T, here.theta[:2], atol=1e-4)
    assert there.cost == pytest.approx(here.cost, rel=1e-5)


def test_one_more_range_never_makes_anything_less_certain() -> None:
    one = flown()[2]
    found = align(one.path, one.logs, one.prior, losses=PLAIN)
    model = Model(one.path, one.logs, one.prior)
    x, free = found.solution.x, found.solution.theta
    sigmas = []
    for count in (100, 101, 150, 399, 400):
        part = Model(one.path, one.logs.of(np.arange(count)), one.prior)
        sigmas.append(np.diag(inverse(factor(normal_equations(part(x, free))).information)))
    assert model.logs.value_m.size == 400
    assert np.all(np.diff(sigmas, axis=0) <= 1e-9 * np.array(sigmas[:-1]))


def test_path_covariance_is_honest() -> None:
    errors = []
    for one in flown()[:15]:
        found = aligned(one)
        error = found.path_m - one.truth.path_m
        normalised = np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.path_covariances), error)
        errors.append(normalised[::20].mean() / 2)
        np.testing.assert_allclose(
            found.end_covariance, found.path_covariances[-1], rtol=1e-6, atol=1e-9
        )
    assert 0.6 < np.mean(errors) < 1.5  # 15 runs, each some three independent places


def test_paper_baseline_runs_away_on_few_ranges_and_settles_on_many() -> None:
    few, many = (alignment.baseline(1, RUNS, n) for n in (60, 200))
    assert 0.3 < 1 - few.solved.mean() < 0.7
    assert many.solved.all()
    assert 6 < many.rmse("xy") < 13
    assert many.nees.mean() > 20  # it takes dead reckoning for exact
    assert 1 - alignment.baseline(1, 20, 150, differences=True).solved.mean() > 0.8


def test_baseline_loses_to_the_most_probable() -> None:
    both = [score(flown()[:20], method) for method in (papers, aligned)]
    assert both[1].rmse("xy") < both[0].rmse("xy")


def test_no_prior_is_needed_for_ranges() -> None:
    rng = np.random.default_rng(4)
    wide = [flight(rng, 200, sigma_beacon_m=1e5, sigma_wind_mps=100.0) for _ in range(20)]
    found = [alignment.from_nothing(f) for f in wide]
    assert all(a.status == "solved" for a in found)
    assert all(a.mirrored_in_doubt for a in found)  # a level path cannot tell above from below
    errors = np.array([a.theta - truth_of(f) for a, f in zip(found, wide, strict=True)])
    assert np.abs(errors).max() < 100


def test_a_prior_that_knows_the_side_leaves_no_doubt() -> None:
    assert not aligned(flown()[0]).mirrored_in_doubt


def test_a_beacon_of_doubtful_side_is_as_uncertain_as_both() -> None:
    """Low beacons, a prior that hardly knows above from below: the covariance covers both sides."""
    rng = np.random.default_rng(9)
    normalised = []
    for one in [flight(rng, 200) for _ in range(20)]:
        mean, truth = one.prior.mean.copy(), truth_of(one)
        heights = places_of(mean)[:, 2]
        mean[heights] = 100 * rng.standard_normal(2)
        wide = one.prior.covariance.copy()
        wide[heights, heights] = 500.0**2
        found = align(one.path, one.logs, Prior(mean, wide))
        assert found.mirrored_in_doubt
        error = (found.theta - truth)[heights]
        normalised.append(error**2 / found.covariance[heights, heights])
    assert np.mean(normalised) < 2.5  # believed at their modes alone they would be thousands


def test_started_below_it_ends_above() -> None:
    one = flown()[0]
    start = one.prior.mean.copy()
    start[places_of(start)[:, 2]] *= -1
    found = align(one.path, one.logs, one.prior, start=start)
    np.testing.assert_allclose(found.theta, aligned(one).theta, atol=0.1)


@pytest.mark.parametrize(("moved", "contradicts"), [(0.0, False), (400.0, True)])
def test_a_wrong_prior_is_told(moved: float, contradicts: bool) -> None:
    # 400 m, eight sigmas: far, but within reach of the iteration
    one = flown()[5]
    mean = one.prior.mean.copy()
    mean[places_of(mean)[0, 1]] += moved
    found = align(one.path, one.logs, Prior(mean, one.prior.covariance))
    assert (found.prior_test.probability < 1e-3) == contradicts
    assert (np.abs(found.prior_test.sigmas).max() > 5) == contradicts


def _with(known: Prior, **more: float) -> Prior:
    return prior(known.mean[places_of(known.mean)], 50.0, sigma_wind_mps=1.0, **more)


def test_range_scale_is_found() -> None:
    normalised = []
    for one in flown()[:20]:
        logs = one.logs._replace(value_m=1.065 * one.logs.value_m)
        found = align(one.path, logs, _with(one.prior, sigma_range_scale=0.1))
        normalised.append((found.theta[4] - 0.065) / np.sqrt(found.covariance[4, 4]))
        assert found.theta[4] == pytest.approx(0.065, abs=0.02)
    assert 0.3 < np.mean(np.square(normalised)) < 2.2  # 20 runs: sigma .32


@pytest.mark.parametrize(
    ("index", "change", "sigma"),
    [(2, 0.03, {"sigma_speed_scale": 0.05}), (3, 0.05, {"sigma_heading_bias_rad": 0.1})],
)
def test_speed_scale_and_heading_bias(index: int, change: float, sigma: dict[str, float]) -> None:
    """What is observable is honest: a heading bias no better than the beacons tell north."""
    normalised = []
    for one in flown()[:15]:
        stretch, turn = (1 + change, 0.0) if index == 2 else (1.0, -change)
        travel = one.path.travel_m @ rotation_clockwise(turn).T / stretch
        path = one.path._replace(travel_m=travel)
        found = align(path, one.logs, _with(one.prior, **sigma))
        normalised.append((found.theta[index] - change) / np.sqrt(found.covariance[index, index]))
    assert np.mean(np.square(normalised)) < 2.5  # 15 runs: sigma .37


def test_clock_offset_and_drift() -> None:
    one = flown()[3]
    late = 40.0 + 0.1 * one.path.time_s[one.logs.epoch]
    logs = one.logs._replace(value_m=one.logs.value_m + late)
    found = align(
        one.path, logs, _with(one.prior, sigma_clock_offset_m=100.0, sigma_clock_drift_mps=0.5)
    )
    sigma = np.sqrt(np.diag(found.covariance))
    assert abs(found.theta[5] - 40) < 4 * sigma[5]
    assert abs(found.theta[6] - 0.1) < 4 * sigma[6]
    assert sigma[6] < 0.1


def test_no_ranges_is_a_status() -> None:
    one = flown()[0]
    found = align(one.path, one.logs.of(slice(0, 0)), one.prior)
    assert found.status == "no ranges"
    np.testing.assert_allclose(found.theta, one.prior.mean, atol=1e-9)
    assert found.prior_test.dof == 0


def test_wrong_indices_are_refused() -> None:
    path = dead_reckoning(np.ones(3), 1.0, 0.0, 0.1, 0.1)
    known = prior(BEACONS_M, 50.0)
    with pytest.raises(ValueError, match="epochs 0 to 2"):
        align(path, ranges(3, 0, 10.0, 1.0), known)
    with pytest.raises(ValueError, match="beacons 0 to 1"):
        align(path, ranges(0, 2, 10.0, 1.0), known)


def test_a_beacon_never_heard_stays_where_the_prior_has_it() -> None:
    one = flight(np.random.default_rng(8), 200)
    alone = one.logs.of(one.logs.beacon == 0)
    start = closed_form_start(one.path, alone, one.prior)
    unheard, heard = places_of(start)[::-1]
    np.testing.assert_array_equal(start[unheard], one.prior.mean[unheard])
    assert np.all(start[heard] != one.prior.mean[heard])
    found = align(one.path, alone, one.prior, start=start)
    np.testing.assert_allclose(found.theta[unheard], one.prior.mean[unheard], atol=1e-6)
