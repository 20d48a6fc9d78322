"""The closed form in O(L) against the dense one: the same answer, in how much time and memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator

import numpy as np

from bench.figures import Figure, at_least, at_most, scaled_seconds, time_ratio, told
from bench.registration.scenes import errors_fixed, experiment, logs_of
from estimation.relative_frame import closed_form, closed_form_dense

MANY = 50  # calls after the dense one: it leaves the cache cold, streams find it warm


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Dense against O(L), and a million pairs against the sines and cosines they need."""
    yield at_most("dense = O(L), L <= 1000", dense_difference(seed), 1e-10, "prior sigma")
    rng = np.random.default_rng([seed, 0])
    thousand = logs_of(experiment(rng, (), 1000))
    dense = MANY * time_ratio(
        lambda: closed_form_dense(*thousand), lambda: [closed_form(*thousand) for _ in range(MANY)]
    )
    yield at_least("L = 1000: dense / O(L) time", dense, 500)
    yield told("L = 1000: time, scaled", scaled_seconds(lambda: closed_form(*thousand)) * 1e3, "ms")
    million = logs_of(experiment(rng, (), 1_000_000))
    bearings = np.concatenate([million[0].bearing_rad, million[1].bearing_rad])
    additive = time_ratio(
        lambda: closed_form(*million), lambda: (np.sin(bearings), np.cos(bearings))
    )
    yield at_most("L = 1e6: time / sin + cos of the bearings", additive, 3)
    tracemalloc.start()
    closed_form(*million)
    yield at_most("L = 1e6: extra memory", tracemalloc.get_traced_memory()[1] / 1e6, 10, "MB")
    tracemalloc.stop()


def dense_difference(seed: int) -> float:
    """Largest difference of the two solutions, in prior sigmas, L = 1 to 1000."""
    worst = 0.0
    for pairs, runs in ((1, 100), (2, 100), (10, 100), (100, 10), (1000, 1)):
        scene = experiment(np.random.default_rng([seed, pairs]), (runs,), pairs)
        one = closed_form(*logs_of(scene))
        same = closed_form_dense(*logs_of(scene))
        sigmas = np.sqrt(np.diag(scene.prior.covariance))
        apart = (errors_fixed(one, scene) - errors_fixed(same, scene)) / sigmas
        shared = (one.covariance - same.covariance) / np.outer(sigmas, sigmas)
        worst = max(worst, np.abs(apart).max(), np.abs(shared).max())
    return float(worst)
