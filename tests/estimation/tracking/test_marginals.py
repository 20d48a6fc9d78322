"""Marginals against the enumeration of every way in which plots can be of tracks."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.tracking.marginals import Candidates, Marginals, by_assignment, by_belief


def enumerated(given: Candidates) -> tuple[Marginals, Array]:
    """Exact marginals, and the likeliest set of pairs as 0 or 1."""
    total, pair, best, most = 0.0, np.zeros(len(given.weight)), np.zeros(len(given.weight)), 0.0
    for chosen in product((False, True), repeat=len(given.weight)):
        mask = np.array(chosen)
        if len(set(given.track[mask])) < mask.sum() or len(set(given.plot[mask])) < mask.sum():
            continue
        worth = float(np.prod(given.weight[mask]))
        total += worth
        pair += worth * mask
        if worth > most:
            most, best = worth, mask.astype(float)
    pair = pair / total
    alone = [
        1 - np.bincount(label, pair, minlength=size)
        for label, size in ((given.track, given.tracks), (given.plot, given.plots))
    ]
    return Marginals(pair, *alone), best


def some(rng: np.random.Generator, tracks: int, plots: int, share: float) -> Candidates:
    track, plot = np.nonzero(rng.random((tracks, plots)) < share)
    return Candidates(track, plot, np.exp(rng.normal(0, 2, len(track))), tracks, plots)


@pytest.mark.parametrize("seed", range(40))
def test_belief_is_near_the_enumeration(seed: int) -> None:
    """Loops cost accuracy: 0.06 at most in 400 draws of this kind, hence 0.1; none is typical."""
    given = some(np.random.default_rng(seed), 4, 4, 0.5)
    exact, _ = enumerated(given)
    found = by_belief(given)
    for one, other in zip(found, exact, strict=True):
        np.testing.assert_allclose(one, other, atol=0.1)


@pytest.mark.parametrize("seed", range(20))
def test_belief_is_exact_without_loops(seed: int) -> None:
    """A chain track 0 - plot 0 - track 1 - plot 1 - ...: a tree, exact to the tolerance."""
    rng = np.random.default_rng(seed)
    track, plot = np.array([0, 1, 1, 2, 2, 3]), np.array([0, 0, 1, 1, 2, 2])
    given = Candidates(track, plot, np.exp(rng.normal(0, 3, 6)), 4, 3)
    exact, _ = enumerated(given)
    for one, other in zip(by_belief(given), exact, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3)


@pytest.mark.parametrize("seed", range(40))
def test_assignment_is_the_best_of_all_sets(seed: int) -> None:
    given = some(np.random.default_rng(seed), 4, 4, 0.6)
    _, best = enumerated(given)
    np.testing.assert_array_equal(by_assignment(given).pair, best)


@pytest.mark.parametrize("way", [by_belief, by_assignment])
def test_a_group_of_candidates_does_not_feel_another(way: type[Marginals]) -> None:
    rng = np.random.default_rng(1)
    one, other = some(rng, 5, 5, 0.4), some(rng, 4, 6, 0.4)
    both = Candidates(
        np.concatenate([one.track, other.track + 5]),
        np.concatenate([one.plot, other.plot + 5]),
        np.concatenate([one.weight, other.weight]),
        9,
        11,
    )
    whole = way(both)
    apart = [way(given) for given in (one, other)]
    np.testing.assert_allclose(whole.pair, np.concatenate([each.pair for each in apart]), atol=1e-3)


def test_nobody_and_nothing() -> None:
    none = np.empty(0, dtype=np.intp)
    for way in (by_belief, by_assignment):
        found = way(Candidates(none, none, np.empty(0), 2, 3))
        np.testing.assert_array_equal(found.track_alone, np.ones(2))
        np.testing.assert_array_equal(found.plot_alone, np.ones(3))


def test_a_knot_of_a_hundred_settles() -> None:
    """Dense and near to a tie, the slowest case: probabilities, and no track twice."""
    rng = np.random.default_rng(2)
    track, plot = (axis.ravel() for axis in np.mgrid[:100, :100])
    found = by_belief(Candidates(track, plot, rng.uniform(5, 6, 10_000), 100, 100))
    taken = np.bincount(track, found.pair)
    np.testing.assert_allclose(taken + found.track_alone, 1.0, atol=1e-6)
    assert (np.bincount(plot, found.pair) < 1.01).all()


def plainly(given: Candidates, passes: int) -> Array:
    """Belief propagation as eqs 21-26 have it, every pair in every pass; marginals of the pairs."""
    message = np.ones(len(given.weight))
    for _ in range(passes):
        claim = given.weight * message
        on_track = np.bincount(given.track, claim, minlength=given.tracks)[given.track]
        bid = given.weight / (1 + on_track - claim)
        on_plot = np.bincount(given.plot, bid, minlength=given.plots)[given.plot]
        message = 1 / (1 + on_plot - bid)
    claim = given.weight * message
    on_track = np.bincount(given.track, claim, minlength=given.tracks)[given.track]
    return np.asarray(claim / (1 + on_track))


@pytest.mark.parametrize("spread", [1.0, 4.0])
def test_letting_settled_pairs_rest_changes_nothing_that_matters(spread: float) -> None:
    """Two thousand tracks that all hang together, with faint pairs among them. Messages are good
    to 1e-3 and faint pairs have weights up to that, a few on each track; hence 1e-2.
    """
    rng = np.random.default_rng(8)
    track, plot = np.unique(rng.integers(0, 2000, (2, 8000)), axis=1)
    weight = np.exp(rng.normal(0, spread, len(track)))
    given = Candidates(track, plot, weight, 2000, 2000)
    assert (weight < 1e-3).any() == (spread > 1)
    found, want = by_belief(given).pair, plainly(given, 400)
    np.testing.assert_allclose(found, want, atol=1e-2)
    assert np.abs(found - want).mean() < 1e-4
