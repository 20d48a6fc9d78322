"""Mutual navigation: benchmark S, the paper's two figures, its equations, and time for fifty."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.figures import Figure, at_least, at_most, scaled_seconds, told
from bench.navigation import hierarchy
from estimation.arrays import Array
from estimation.mutual_navigation import (
    Gaussian,
    Pair,
    Scalar,
    Wander,
    joint_start,
    joint_step,
    links,
    modified_update,
    network,
    predicted,
    seen,
    updated,
)

_LIMITS_M = {"centralised": 56.0, "exact one-way": 106.0, "split intersection": 145.0}
_ROUNDING = 1e-9
_FORGETS = 0.1  # gain of a filter with a memory of ten ranges


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """All of paper 004."""
    yield at_most("eqs 8, 9 against the matrix filter", equations_differ(seed), 1e-10)
    found = hierarchy.methods()
    for name, run in found.items():
        figure = f"benchmark S, {name}: 2 sigma_r at 600 s"
        if name in _LIMITS_M:
            yield at_most(figure, run.true_m[-1], _LIMITS_M[name], "m")
        else:
            yield told(figure, run.true_m[-1], "m")
    for name in ("uncorrelated", "r = cos"):
        yield told(f"benchmark S, {name}: NEES/2 at 600 s", found[name].nees[-1])
    excess = float(found["split intersection"].excess.max())
    yield at_most("split intersection: true by believed, largest ever", excess, 1 + _ROUNDING)
    order = [found[n].true_m[-1] for n in ("ideal", "exact one-way", "uncorrelated")]
    yield at_least(
        "figure 3: ideal < correlated < uncorrelated", float(np.all(np.diff(order) > 0)), 1
    )
    correlations = figure_two(seed, 10 * runs)
    yield told("figure 2: median sample correlation at 25 deg", float(np.median(correlations)))
    share = float(np.mean(correlations > 0.954))
    yield told("figure 2: share of draws above the paper's .954", share)
    yield at_most("50 carriers: prediction and update", 1e3 * fifty(seed), 100, "ms, scaled")


def equations_differ(seed: int, draws: int = 1000) -> float:
    """Largest relative difference of (8), (9) from `updated`."""
    rng = np.random.default_rng([seed, 30])
    worst = 0.0
    for _ in range(draws):
        x, h = rng.standard_normal((2, 2))
        d, variance, r = rng.uniform(0.1, 10, 2), rng.uniform(0.1, 10), rng.uniform(-0.99, 0.99)
        known = Scalar(float(rng.standard_normal()), variance)
        ours = modified_update(known, Pair(tuple(x), tuple(h), tuple(d), r))
        off = r * np.sqrt(d[0] * d[1])
        prior = Gaussian(np.array([known.mean]), np.array([[variance]]))
        noise = np.array([[d[0], off], [off, d[1]]])
        matrix = updated(prior, x - h * known.mean, h[:, None], noise)
        pairs = (ours.mean, matrix.mean[0]), (ours.variance, matrix.covariance[0, 0])
        worst = max(worst, *(abs(a - b) / max(abs(b), 1e-3) for a, b in pairs))
    return float(worst)


def figure_two(seed: int, draws: int) -> Array:
    """(draws,) sample correlations over 600 s of the errors of `two_users`."""
    errors = two_users(seed, draws)
    centred = errors - errors.mean(axis=0)
    size = np.sqrt(np.einsum("tnj,tnj->nj", centred, centred).prod(axis=1))
    correlations: Array = np.einsum("tn,tn->n", centred[..., 0], centred[..., 1]) / size
    return correlations


def two_users(seed: int, draws: int) -> Array:
    """(steps, draws, 2) errors of two users along their lines of sight to one controller.

    The users range the controller at 25 deg from each other; its error of 30 m with a memory of
    600 s is in both, with noise of their own: 5 m a range, averaged by filters of 20 s memory.
    """
    rng = np.random.default_rng([seed, 31])
    sigma, memory = hierarchy.CONTROLLER_ERROR
    steps = round(hierarchy.DURATION_S / hierarchy.INTERVAL_S)
    kept = np.exp(-hierarchy.INTERVAL_S / memory)
    angle = 25 * hierarchy.DEG
    units = np.array([[1.0, 0.0], [np.cos(angle), np.sin(angle)]])
    error, noise = sigma * rng.standard_normal((draws, 2)), np.zeros((draws, 2))
    errors = np.empty((steps, draws, 2))
    for step in range(steps):
        error = kept * error + sigma * np.sqrt(1 - kept**2) * rng.standard_normal((draws, 2))
        noise += _FORGETS * (hierarchy.SIGMA_M * rng.standard_normal((draws, 2)) - noise)
        errors[step] = error @ units.T + noise
    return errors


def fifty(seed: int, users: int = 50, heard: int = 4) -> float:
    """Seconds, scaled, of a centralised step: each user hears four others, some a ground point."""
    rng = np.random.default_rng([seed, 32])
    net = network(users, 0, 3)
    places = np.vstack([rng.uniform(-50e3, 50e3, (users + 3, 2)).T, np.full(users + 3, 5e3)]).T
    pairs = [
        (user, int(other))
        for user in range(users)
        for other in rng.choice(np.delete(np.arange(users + 3), user), heard, replace=False)
    ]
    rows_of = links(pairs, hierarchy.SIGMA_M)
    state = Gaussian(np.zeros(net.size), joint_start([Wander()] * users, []))
    transition, noise = joint_step([Wander()] * users, 1.0, [])

    def step() -> Gaussian:
        ahead = predicted(state, transition, noise)
        rows = seen(net, places, ahead.mean, rows_of)
        return updated(ahead, rows.innovation, rows.by_state, rows.noise)

    return scaled_seconds(step)
