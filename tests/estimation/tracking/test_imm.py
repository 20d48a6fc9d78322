"""The bank of filters and its innovations, against the textbook one track at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm

from estimation.arrays import Array
from estimation.tracking import imm
from estimation.tracking.imm import Bank, Motion
from estimation.tracking.innovations import (
    Common,
    Foretold,
    Innovations,
    corrected,
    corrections,
    foretold,
    innovations,
)
from estimation.tracking.measurements import Measurement
from tests.estimation.tracking.states import KINDS, SITE, plots_of, some_bank

MOTION = Motion()
FOUR = Motion((1e-3, 0.05, 2.0, 20.0), (3000.0, 60.0, 100.0), (600.0, 20.0, 10.0))
FORKED = FOUR._replace(out_of=(0, 0, 1))
TURNING = FOUR._replace(turning=(0.0, 0.0, 0.005, 0.02), hastening=(0.0, 0.0, 0.001, 0.004))


class Innovated(NamedTuple):
    """Pairs, and what was foretold of their tracks."""

    told: Foretold
    pairs: Innovations


def dense(parts: Array, track: int) -> list[Array]:
    """Of one track, under each model."""
    return [parts[..., model, track] for model in range(parts.shape[-2])]


@pytest.mark.parametrize(
    "motion", [MOTION, FOUR, FORKED, TURNING], ids=["two", "four", "forked", "turning"]
)
def test_prediction_is_the_textbooks_one_track_at_a_time(motion: Motion) -> None:
    bank, dt = some_bank(np.random.default_rng(1), 5, models=motion.models), 1.7
    after = imm.predicted(bank, dt, motion)
    f = np.eye(4) + dt * np.eye(4, k=2)
    block = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    rate = np.zeros((motion.models, motion.models))
    for way, out_of in enumerate(motion.out_of or range(motion.models - 1), start=1):
        rate[out_of, way] = 1 / motion.louder_s[way - 1]
        rate[way, out_of] = 1 / motion.quieter_s[way - 1]
    change = expm(dt * (rate - np.diag(rate.sum(axis=1))))
    for i in range(5):
        x, p, mu = dense(bank.mean, i), dense(bank.covariance, i), bank.model[:, i]
        for j, q in enumerate(motion.noise):
            share = change[:, j] * mu
            np.testing.assert_allclose(after.model[j, i], share.sum(), rtol=1e-12)
            share = share / share.sum()
            x0 = np.einsum("i,ij", share, np.array(x))
            p0 = sum(
                s * (c + np.outer(m - x0, m - x0)) for s, m, c in zip(share, x, p, strict=True)
            )
            np.testing.assert_allclose(after.mean[:, j, i], f @ x0, rtol=1e-9)
            noise = q * np.eye(2) + by_velocity(motion, j, p0[2:, 2:] + np.outer(x0[2:], x0[2:]))
            want = f @ p0 @ f.T + np.kron(block, noise)
            np.testing.assert_allclose(after.covariance[:, :, j, i], want, rtol=1e-9, atol=1e-7)


def by_velocity(motion: Motion, model: int, squared: Array) -> Array:
    """What turns and changes of speed add to the noise of a model, with E[v v'] (2, 2)."""
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    turning = motion.turning[model] if motion.turning else 0.0
    hastening = motion.hastening[model] if motion.hastening else 0.0
    return np.asarray(turning * quarter @ squared @ quarter.T + hastening * squared)


def test_a_turn_pushes_a_target_aside_and_the_more_the_faster_it_is() -> None:
    """To the east at 10 and at 200 m/s, velocities known: noise across the course alone."""
    bank = imm.bare(np.zeros((4, 1, 2)), np.zeros((4, 4, 1, 2)), np.ones((1, 2)))
    bank.mean[2, 0] = 10.0, 200.0
    after = imm.predicted(bank, 1.0, Motion((0.0,), (), (), turning=(0.005,)))
    np.testing.assert_allclose(after.covariance[2, 2, 0], 0.0)
    np.testing.assert_allclose(after.covariance[3, 3, 0], [0.5, 200.0])
    after = imm.predicted(bank, 1.0, Motion((0.0,), (), (), hastening=(0.001,)))
    np.testing.assert_allclose(after.covariance[2, 2, 0], [0.1, 40.0])
    np.testing.assert_allclose(after.covariance[3, 3, 0], 0.0)


@pytest.mark.parametrize("motion", [MOTION, FOUR, FORKED], ids=["two", "four", "forked"])
def test_ways_of_moving_keep_their_shares_in_the_long_run(motion: Motion) -> None:
    """Those of targets just found stay, and whatever a track is thought to do, it comes to them."""
    np.testing.assert_allclose(motion.steady() @ motion.change(7.0), motion.steady(), rtol=1e-12)
    np.testing.assert_allclose(motion.change(1e6), np.tile(motion.steady(), (motion.models, 1)))
    np.testing.assert_allclose(motion.change(2.0) @ motion.change(3.0), motion.change(5.0))


def test_two_short_steps_without_change_of_model_are_one_long() -> None:
    """Models that hardly ever change: then prediction is a semigroup, to that rarity."""
    steady = MOTION._replace(louder_s=(1e12,), quieter_s=(1e12,))
    bank = some_bank(np.random.default_rng(2), 4)
    once = imm.predicted(bank, 2.0, steady)
    twice = imm.predicted(imm.predicted(bank, 0.7, steady), 1.3, steady)
    np.testing.assert_allclose(once.mean, twice.mean, rtol=1e-8, atol=1e-6)
    np.testing.assert_allclose(once.covariance, twice.covariance, rtol=1e-8, atol=1e-6)


def test_a_bank_is_its_tracks_one_by_one() -> None:
    bank = some_bank(np.random.default_rng(3), 6)
    whole = imm.predicted(bank, 0.9, MOTION)
    for i in range(6):
        alone = imm.predicted(bank.take(np.array([i])), 0.9, MOTION)
        for part, of_whole in zip(alone, whole.take(np.array([i])), strict=True):
            np.testing.assert_array_equal(part, of_whole)


def test_combined_has_the_moments_of_the_mixture() -> None:
    rng = np.random.default_rng(4)
    bank = some_bank(rng, 1)
    draws = np.concatenate(
        [
            rng.multivariate_normal(m, c, round(400_000 * share))
            for m, c, share in zip(
                dense(bank.mean, 0), dense(bank.covariance, 0), bank.model[:, 0], strict=True
            )
        ]
    )
    mean, covariance = imm.combined(bank)
    sigma = np.sqrt(np.diag(covariance[..., 0]))
    assert (np.abs(draws.mean(axis=0) - mean[:, 0]) < 5 * sigma / np.sqrt(len(draws))).all()
    np.testing.assert_allclose(
        np.cov(draws.T) / np.outer(sigma, sigma),
        covariance[..., 0] / np.outer(sigma, sigma),
        atol=0.01,
    )  # 4 sigmas


def test_places_are_the_first_half_of_what_is_combined() -> None:
    bank = some_bank(np.random.default_rng(6), 9)
    mean, covariance = imm.combined(bank)
    place, spread = imm.places(bank)
    np.testing.assert_array_equal(place, mean[:2])
    np.testing.assert_array_equal(spread, covariance[:2, :2])


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_those_of_the_expected_values(kind: str) -> None:
    rng = np.random.default_rng(5)
    bank = some_bank(rng, 6)
    plots = plots_of(kind, rng, bank.mean[:2, 0].T)
    gradient = plots.expected(bank.mean, plots.offset_s).gradient
    for axis, small in enumerate((0.5, 0.5, 0.01, 0.01)):
        up, down = bank.mean.copy(), bank.mean.copy()
        up[axis] += small
        down[axis] -= small
        ends = [plots.expected(mean, plots.offset_s).value for mean in (up, down)]
        slope = (ends[0] - ends[1]) / (2 * small)
        for row, want in zip(gradient, slope, strict=True):
            np.testing.assert_allclose(row[axis], want, atol=1e-6 * np.abs(row).max(), rtol=1e-5)


def pairs_of(plots: Measurement, bank: Bank, common: Common | None = None) -> Innovated:
    """Each plot with the track of its number."""
    every = np.arange(plots.size)
    expected = plots.expected(bank.mean, plots.offset_s)
    told = foretold(expected, bank, common)
    return Innovated(told, innovations(plots.readings(), told, every, every))


def joint(kind: str, common: Common | None) -> tuple[Innovated, list[tuple[Array, Array, float]]]:
    """Our innovations, and mean, covariance and log density of the update in one piece."""
    rng = np.random.default_rng(6)
    bank = some_bank(rng, 4)
    plots = plots_of(kind, rng, bank.mean[:2, 0].T)
    readings, expected = plots.readings(), plots.expected(bank.mean, plots.offset_s)
    want = []
    for i in range(4):
        for j in (0, 1):
            h = expected.gradient[:, :, j, i]
            nu = readings.value[:, i] - expected.value[:, j, i]
            noise = readings.covariance[:, :, i]
            if common is not None:
                east, north = bank.mean[:2, j, i] - common.pivot_m
                g = h[:, :2] @ np.array([[1.0, 0.0, north], [0.0, 1.0, -east]])
                noise = noise + g @ common.covariance @ g.T
            p = bank.covariance[:, :, j, i]
            s = h @ p @ h.T + noise
            gain = p @ h.T @ np.linalg.inv(s)
            density = stats.multivariate_normal(cov=s, allow_singular=False).logpdf(nu)
            reference = sum(readings.log_reference)
            want.append((gain @ nu, gain @ h @ p, float(density) + reference))
    return pairs_of(plots, bank, common), want


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("with_common", [False, True])
def test_scalar_by_scalar_is_the_update_in_one_piece(kind: str, with_common: bool) -> None:
    root = np.array([[30.0, 0.0, 0.0], [5.0, 25.0, 0.0], [1e-3, -5e-4, 2e-3]])
    common = Common(root @ root.T, SITE) if with_common else None
    found, want = joint(kind, common)
    shift, less = corrections(*found)
    for k, (mean, covariance, density) in enumerate(want):
        i, j = divmod(k, 2)
        np.testing.assert_allclose(shift[:, j, i], mean, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(less[:, :, j, i], covariance, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(found.pairs.log_density[j, i], density, atol=1e-6)


def test_an_absent_range_rate_changes_nothing() -> None:
    rng = np.random.default_rng(7)
    bank = some_bank(rng, 3)
    plots = plots_of("range rate", rng, bank.mean[:2, 0].T)
    assert plots.range_rate is not None  # type: ignore[attr-defined]
    absent = plots.range_rate._replace(value_mps=np.full(3, np.nan))  # type: ignore[attr-defined]
    one, other = (
        pairs_of(plots._replace(range_rate=rate), bank)  # type: ignore[attr-defined]
        for rate in (absent, None)
    )
    np.testing.assert_allclose(one.pairs.log_density, other.pairs.log_density, atol=1e-12)
    for mine, want in zip(corrections(*one), corrections(*other), strict=True):
        np.testing.assert_allclose(mine, want, atol=1e-12)


def test_correcting_never_widens_and_favours_the_model_that_foretold_the_plot() -> None:
    bank = some_bank(np.random.default_rng(8), 5)
    plots = plots_of("polar", np.random.default_rng(9), bank.mean[:2, 0].T)
    found = pairs_of(plots, bank)
    after = corrected(bank, *found)
    less = np.moveaxis(bank.covariance - after.covariance, (0, 1), (-2, -1))
    assert np.linalg.eigvalsh(less).min() > -1e-6
    density = found.pairs.log_density
    assert np.array_equal(after.model[0] > bank.model[0], density[0] > density[1])


def test_a_track_is_born_where_and_when_its_plot_is() -> None:
    """A plot 2 s after the scan: carried forward by 2 s the track must have the plot's place."""
    plots = plots_of("place", np.random.default_rng(10), np.array([[100.0, 200.0]]))
    found = plots.found()
    assert found is not None
    still = MOTION._replace(noise=(0.0, 0.0))
    bank = imm.born(found.place_m, found.covariance_m2, np.array([2.0]), still)
    mean, covariance = imm.combined(imm.predicted(bank, 2.0, still))
    np.testing.assert_allclose(mean[:2], found.place_m)
    np.testing.assert_allclose(covariance[:2, :2], found.covariance_m2, rtol=1e-9)
