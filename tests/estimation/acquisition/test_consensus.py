"""The vote: the frame of two equal pictures leads it, whatever turns and shifts them."""

from __future__ import annotations

import numpy as np
import pytest

from bench.registration.unknown_pairs import Layout, scene
from estimation.acquisition import Clues, Constraints, constraints
from estimation.acquisition.acquire import UNBOUND
from estimation.acquisition.consensus import consensus
from estimation.acquisition.innovation import Frames
from estimation.acquisition.problem import problem
from estimation.frames import wrap_pi

ANYWHERE = Frames(np.zeros((1, 3)), np.diag([15e3**2, 15e3**2, 1e6])[None])


def leaders(seed: int, layout: Layout, known: Constraints = UNBOUND) -> tuple[Frames, np.ndarray]:
    drawn = scene(np.random.default_rng(seed), layout)
    given = problem(drawn.own, drawn.other, Clues(), known, None)
    return consensus(given, ANYWHERE, 12, 25.0), drawn.t


@pytest.mark.parametrize("seed", range(6))
def test_the_true_frame_leads(seed: int) -> None:
    voted, truth = leaders(seed, Layout(15, 11, any_heading=True))
    off = voted.t[0] - truth
    off[2] = wrap_pi(off[2])
    assert off @ np.linalg.solve(voted.covariance[0], off) < 11.3  # chi-squared of 3 at .99


def test_leaders_stand_apart_and_are_few() -> None:
    voted, _ = leaders(1, Layout(15, 11, any_heading=True))
    assert len(voted.t) == 12
    apart = voted.t[:, None] - voted.t[None]
    apart[..., 2] = 2e4 * wrap_pi(apart[..., 2])
    distance = np.linalg.norm(apart, axis=-1)[np.triu_indices(12, 1)]
    assert distance.min() > 500.0


def test_what_may_not_be_paired_does_not_vote() -> None:
    everything = constraints(forbid=[(i, j) for i in range(6) for j in range(6)])
    voted, _ = leaders(2, Layout(6, 6), everything)
    assert voted.t.shape == (0, 3)
    assert voted.covariance.shape == (0, 3, 3)


def test_one_target_has_no_distance() -> None:
    voted, _ = leaders(3, Layout(1, 1))
    assert voted.t.shape == (0, 3)
