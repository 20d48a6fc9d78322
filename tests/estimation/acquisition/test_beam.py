"""The search: its scores are exact likelihoods, and it finds what enumeration finds."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bench.registration.unknown_pairs import Layout, Scene, scene
from estimation.acquisition.acquire import UNBOUND
from estimation.acquisition.beam import NOBODY, search
from estimation.acquisition.innovation import Frames, linearised, with_covariance_along_own
from estimation.acquisition.problem import Clues, Constraints, Problem, problem
from estimation.arrays import Array
from estimation.relative_frame import prior_in_own_axes

WORTH = float(np.log(1e8))


def arrays(drawn: Scene, known: Constraints = UNBOUND) -> tuple[Problem, Frames]:
    prior = prior_in_own_axes(drawn.prior)
    frame = Frames(np.array([[*prior.q_m, prior.D_rad]]), prior.covariance[None])
    return problem(drawn.own, drawn.other, Clues(), known, 9e8), frame


def dense_score(given: Problem, prior: Frames, partner: Array) -> float:
    """Log likelihood of all pairs at once, their misclosures correlated by the common frame."""
    own = np.flatnonzero(partner != NOBODY)
    if not own.size:
        return 0.0
    turned = with_covariance_along_own(given.other, float(prior.t[0, 2]))
    one, two = given.own.take(own), turned.take(partner[own])
    w, h = linearised(prior.t[0], one, two)
    v = h.reshape(-1, 3) @ prior.covariance[0] @ h.reshape(-1, 3).T
    for k in range(own.size):
        v[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += one.covariance[k] + two.covariance[k]
    return own.size * WORTH + float(multivariate_normal(cov=v).logpdf(w.ravel()))


def test_scores_are_the_joint_likelihood_of_their_pairs() -> None:
    given, prior = arrays(scene(np.random.default_rng(1), Layout(6, 4, sigma_c_rad=1e-3)))
    found = search(given, prior, WORTH, 20.0, 50)
    for partner, score in zip(found.partner, found.score, strict=True):
        # a nearly known heading: then the search's relinearising changes next to nothing
        assert score == pytest.approx(dense_score(given, prior, partner), abs=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_it_finds_the_best_of_all_assignments(seed: int) -> None:
    given, prior = arrays(scene(np.random.default_rng(seed), Layout(4, 3)))
    every = [
        np.array(partner)
        for partner in itertools.product(range(-1, 4), repeat=4)
        if len({j for j in partner if j >= 0}) == sum(j >= 0 for j in partner)
    ]
    best = max(every, key=lambda partner: dense_score(given, prior, partner))
    found = search(given, prior, WORTH, 30.0, 100)
    np.testing.assert_array_equal(found.partner[0], best)


def test_no_log_is_used_twice_and_the_best_comes_first() -> None:
    given, prior = arrays(scene(np.random.default_rng(5), Layout(20, 14)))
    found = search(given, prior, WORTH, 20.0, 60)
    assert len(found.score) == 60
    assert (np.diff(found.score) <= 0).all()
    for partner, used in zip(found.partner, found.used, strict=True):
        taken = partner[partner != NOBODY]
        assert sorted(taken) == list(np.flatnonzero(used))
    assert len(np.unique(found.partner, axis=0)) == 60


def test_bound_pairs_are_in_every_hypothesis_and_forbidden_ones_in_none() -> None:
    drawn = scene(np.random.default_rng(6), Layout(8, 6))
    i = int(np.flatnonzero(drawn.partner != NOBODY)[0])
    right = int(drawn.partner[i])
    wrong = (right + 1) % 8
    bound, prior = arrays(drawn, Constraints(bound=frozenset({(i, wrong)})))
    assert (search(bound, prior, WORTH, 20.0, 40).partner[:, i] == wrong).all()
    free, prior = arrays(drawn, Constraints(forbidden=frozenset({(i, right)})))
    assert (search(free, prior, WORTH, 20.0, 40).partner[:, i] != right).all()
