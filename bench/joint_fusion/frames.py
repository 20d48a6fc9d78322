"""Frames without identities, found with features and without: few targets, and not all in common.

Seven targets each, four of them in common, in a square of 6 km; places good to 100 m, lengths to
3 m of 10 to 350; the other carrier is 900 m off where it says it is, and turned by half a degree.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_least, at_most, told
from estimation.arrays import Array
from estimation.frames import rotation_clockwise
from estimation.relative_frame import RelativeFramePrior
from estimation.tracking.features import Features, Layout
from fusion_center.relative_frames.search import searched
from fusion_center.relative_frames.views import View
from fusion_center.settings import RegistrationSettings
from fusion_center.sources.telling import Telling, packed
from fusion_center.state import Orders

TELLS = Telling(Layout(1, ()), np.array([400.0]))
SIGMA_M, STATED_M = 100.0, 3.0
EACH, COMMON, HALF_M = 7, 4, 3000.0
OFFSET_M, TURN_RAD = np.array([900.0, -400.0]), 0.008
PRIOR = RelativeFramePrior(np.zeros(2), 1500.0**2 * np.eye(2), 0.01, 0.01)
RUNS_EACH = 20
"""Of the pairs of this bench, to one search."""
WAYS = {"without": None, "features": 3.0, "features that err five times as much": 15.0}


class Crowd(NamedTuple):
    """What two carriers see, and which rows are of one target."""

    own: View
    other: View
    right: set[tuple[int, int]]


def lengths(values: Sequence[float] | Array) -> Array:
    """Rows of tracks whose lengths are known as well as is stated; nan = of which nothing is."""
    mean = np.asarray(values, dtype=float)[None]
    unsaid = np.isnan(mean).astype(float)
    known = np.where(np.isnan(mean), 0.0, mean)
    nothing = np.zeros((0, mean.shape[1]))
    return packed(Features(unsaid, known, np.full_like(mean, STATED_M**2), nothing))


def view(places_m: Array, rows: Array, name: str, sigma_m: float = 40.0) -> View:
    """Tracks at places, their velocities not known."""
    n = len(places_m)
    spread = np.tile(sigma_m**2 * np.eye(2), (n, 1, 1))
    return View(
        log=tuple(f"{name}/1/radar/1/{i}" for i in range(n)),
        source=("radar",) * n,
        fresh=(True,) * n,
        identity=("",) * n,
        track=tuple(f"{name}/radar/t{i}" for i in range(n)),
        east_north_m=places_m,
        covariance=spread,
        altitude_m=np.zeros(n),
        features=rows,
        velocity_mps=np.zeros((n, 2)),
        velocity_covariance=np.tile(1e4 * np.eye(2), (n, 1, 1)),
        plot_m=places_m,
        plot_covariance=spread,
        ready=np.ones(n, dtype=bool),
    )


def crowd(rng: np.random.Generator, actual_m: float | None) -> Crowd:
    """A draw; lengths err by `actual_m` whatever is stated, None = there are none."""
    count = 2 * EACH - COMMON
    places, values = rng.uniform(-HALF_M, HALF_M, (count, 2)), rng.uniform(10, 350, count)
    mine, theirs = np.arange(EACH), rng.permutation(np.arange(EACH - COMMON, count))
    seen = (places[theirs] - OFFSET_M) @ rotation_clockwise(-TURN_RAD).T
    noise = rng.normal(0, SIGMA_M, (2, EACH, 2))
    errors = rng.normal(0, 1, (2, EACH)) * (np.nan if actual_m is None else actual_m)
    own = view(places[mine] + noise[0], lengths(values[mine] + errors[0]), "a", SIGMA_M)
    other = view(seen + noise[1], lengths(values[theirs] + errors[1]), "b", SIGMA_M)
    right = {(i, j) for i in range(EACH) for j in range(EACH) if mine[i] == theirs[j]}
    return Crowd(own, other, right)


def found(given: Crowd) -> tuple[float, int, int]:
    """Probability of the best mode, how many of its pairs are right, and how many it has."""
    got = searched(given.own, given.other, PRIOR, Orders(), RegistrationSettings(), TELLS)
    pairs = {(pair.own, pair.other) for pair in got.pairs}
    return got.probability, len(pairs & given.right), len(pairs)


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Shares of the draws that are trusted, and of those that are trusted and wrong."""
    draws = range(max(runs // RUNS_EACH, 5))
    trusted = {}
    for name, actual_m in WAYS.items():
        every = [found(crowd(np.random.default_rng([seed, k]), actual_m)) for k in draws]
        sure = [one for one in every if one[0] > 0.99]
        wrong = [one for one in sure if one[1] < one[2] / 2]
        trusted[name] = len(sure) / len(every)
        yield told(f"frames of 4 common targets of 7, {name}: trusted", trusted[name])
        yield at_most(
            f"frames of 4 common targets of 7, {name}: trusted and wrong",
            len(wrong) / len(every),
            0.02,
        )
    more = trusted["features"] - trusted["without"]
    yield at_least("frames of 4 common targets of 7: more are trusted with features", more, 0.0)
