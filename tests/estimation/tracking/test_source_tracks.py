"""Whose plot it is, and whether there is a target: by chance as often as claimed."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.tracking import (
    SUREST,
    Bank,
    Innovations,
    Sensing,
    assigned,
    begun,
    carried,
    improved,
    innovations_of,
    log_ratio,
    missed,
    seen,
)

AREA_M2 = 10_000.0**2
R = 30.0**2 * np.eye(2)


def sensing(detection: float = 0.9, clutter: float = 20.0) -> Sensing:
    return Sensing(0.5, 16.0, detection, clutter / AREA_M2)


@pytest.mark.parametrize("seed", range(5))
def test_the_assignment_is_the_likeliest_of_all(seed: int) -> None:
    """Against every permutation of five tracks and plots that are all within the gate."""
    rng = np.random.default_rng(seed)
    found = Innovations(rng.uniform(0, 10, (5, 5)), rng.uniform(10, 12, (5, 5)))
    track, plot = assigned(found, 16.0)
    cost = found.distance2 + found.log_determinant
    assert len(track) == 5
    best = min(sum(cost[i, p[i]] for i in range(5)) for p in permutations(range(5)))
    assert cost[track, plot].sum() == pytest.approx(best)


def test_nothing_beyond_the_gate_is_paired_and_nan_is_beyond() -> None:
    distance2 = np.array([[1.0, 17.0], [np.nan, 40.0]])
    track, plot = assigned(Innovations(distance2, np.zeros((2, 2))), 16.0)
    assert (track.tolist(), plot.tolist()) == ([0], [0])


def test_plots_find_their_tracks_at_their_own_times() -> None:
    """Targets that cross: a rotating radar sees each at another time."""
    state = np.array([[0.0, 0.0, 50.0, 0.0], [100.0, 0.0, -50.0, 0.0]])
    bank = Bank(state, np.tile(np.diag([25.0, 25.0, 1.0, 1.0]), (2, 1, 1)))
    elapsed_s, plots = np.array([2.0, 1.8]), np.array([[100.0, 0.0], [10.0, 0.0]])
    found = innovations_of(bank, elapsed_s, sensing().process_noise, plots, np.array([R, R]))
    track, plot = assigned(found, sensing().gate)
    assert dict(zip(track, plot, strict=True)) == {0: 0, 1: 1}


def followed(rng: np.random.Generator, runs: int, *, there: bool, looks: int = 4) -> Array:
    """Existence of tracks that begin with a plot and are then looked at: a target or clutter.

    Only plots within a kilometre are made; others could not matter.
    """
    now, existence = sensing(), np.empty(runs)
    near_m = 1000.0
    for run in range(runs):
        truth = np.array([0.0, 0.0, *rng.normal(0, 8, 2)])
        bank = begun(rng.multivariate_normal(truth[:2], R, 1), R[None], 15.0)
        r = np.array([0.5])
        for _ in range(looks):
            truth[:2] += truth[2:]
            clutter = rng.poisson(now.clutter_density * 4 * near_m**2)
            plots = rng.uniform(-near_m, near_m, (clutter, 2))
            if there and rng.random() < now.detection:
                plots = np.vstack([plots, rng.multivariate_normal(truth[:2], R, 1)])
            spread = np.tile(R, (len(plots), 1, 1))
            found = innovations_of(bank, np.ones((1, len(plots))), now.process_noise, plots, spread)
            track, plot = assigned(found, now.gate)
            bank = carried(bank, 1.0, now.process_noise)
            if track.size:
                r = seen(r, log_ratio(found, now)[track, plot], now.detection)
                bank = improved(bank, plots[plot], spread[plot])
            else:
                r = missed(r, now.detection)
        existence[run] = r[0]
    return existence


def test_targets_are_confirmed_and_clutter_is_not() -> None:
    """Of 300 targets at Pd .9 hardly one is doubted after four looks; of 300 clutter plots with
    20 false alarms a look on 100 km2 hardly one is believed in."""
    rng = np.random.default_rng(5)
    assert (followed(rng, 300, there=True) > 0.95).mean() > 0.97
    assert (followed(rng, 300, there=False) > 0.95).mean() < 0.02


def test_existence_follows_bayes() -> None:
    """Two plots of a target in the same look would be as likely: the formula against counting."""
    r, detection, ratio = 0.3, 0.8, 5.0
    with_plot = r * (1 - detection + ratio)
    assert seen(np.array([r]), np.log([ratio]), detection)[0] == pytest.approx(
        with_plot / (with_plot + 1 - r)
    )
    without = r * (1 - detection)
    assert missed(np.array([r]), detection)[0] == pytest.approx(without / (without + 1 - r))


def test_a_target_that_is_gone_is_given_up_in_a_few_looks() -> None:
    r, looks = np.array([SUREST]), 0
    while r[0] > 0.05:
        r, looks = missed(r, 0.9), looks + 1
    assert looks <= 5
    assert seen(np.array([SUREST]), np.array([1e6]), 0.9)[0] == SUREST
