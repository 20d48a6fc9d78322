"""Association and registration together: what it finds, how often it is wrong, how sure it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_least, at_most, scaled_seconds, told
from bench.registration.scenes import DEG
from bench.registration.unknown_pairs import (
    NOBODY,
    Layout,
    Scene,
    any_share,
    cluster,
    fit_of,
    gnn_ignoring,
    gnn_iterated,
    lane,
    scene,
)
from estimation.acquisition import Acquisition, acquire, acquire_blind, unknown_frame
from estimation.acquisition.matching import Pairs
from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.frames import wrap_pi
from estimation.relative_frame import adjustment

TRUST = 0.99
_GROSS = 25.0  # chi-squared of 3 (p = 1.5e-5): the frame is not where its covariance says
_BINS = 10
_LEAST_IN_BIN = 300


class Outcome(NamedTuple):
    """Of one run."""

    recall: float  # of the shared targets
    precision: float  # of the pairs
    gross: bool
    error: Array  # (3,) of (q, D)
    known_error: Array  # of the exact adjustment of the right pairs
    nees: float
    probability: float  # of the mode, 0 without one


class Means(NamedTuple):
    """Over runs."""

    recall: float
    precision: float
    gross: float
    location: float  # RMSE / that of known association
    turn: float
    nees: float  # / 3, over the runs that are not gross
    acted: float  # share of runs with a probability above `TRUST`
    gross_acted: float  # share of those


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Demands 3 and 4 of paper 000, and what lies about them."""
    yield from demanded(seed, runs)
    yield from blind_figures(seed, runs)
    yield from geometry_figures(seed, runs)
    yield from baseline_figures(seed, runs)
    yield from calibration_figures(seed, runs)
    yield from speed_figures(seed)


def demanded(seed: int, runs: int) -> Iterator[Figure]:
    """Recall, precision, gross failures and error with a prior, as the page demands them."""
    m = measure(seed, max(runs // 40, 3), Layout(20, 14))
    yield at_least("acquisition, N = 20, 30 % unshared: recall", m.recall, 0.99)
    yield at_least("acquisition, N = 20, 30 % unshared: precision", m.precision, 0.985)
    yield at_most("acquisition, N = 20, 30 % unshared: gross", m.gross, 0.005)
    yield at_most("acquisition, N = 20: location error / known association", m.location, 1.03)
    yield at_most("acquisition, N = 20: c2 - c1 error / known association", m.turn, 1.03)
    yield told("acquisition, N = 20: NEES/3", m.nees)
    yield told("acquisition, N = 20: acted upon", m.acted)
    yield at_most("acquisition, N = 20: gross when acted upon", m.gross_acted, 0.005)
    few = max(runs // 1000, 1)
    for shared, recall in ((70, 0.97), (50, 0.965)):
        m = measure(seed, few, Layout(100, shared))
        name = f"acquisition, N = 100, {100 - shared} % unshared"
        yield at_least(f"{name}: recall", m.recall, recall)
        yield told(f"{name}: precision", m.precision)
        yield told(f"{name}: location error / known association", m.location)
        yield told(f"{name}: gross", m.gross)
    m = measure(seed, few, Layout(50, 35, 0, 5000.0, 3 * DEG))
    yield at_least("acquisition, 5 km / 3 deg, N = 50: recall", m.recall, 0.98)
    yield at_most("acquisition, 5 km / 3 deg, N = 50: gross", m.gross, 0)


def blind_figures(seed: int, runs: int) -> Iterator[Figure]:
    """Any heading, 15 km."""
    for count in (20, 50, 100):
        layout = Layout(count, round(0.7 * count), any_heading=True)
        m = measure(seed, max(runs // 2000, 1), layout)
        yield at_least(f"acquisition, no prior, N = {count}: recall", m.recall, 0.97)
        yield at_most(f"acquisition, no prior, N = {count}: gross", m.gross, 0)
        yield told(f"acquisition, no prior, N = {count}: precision", m.precision)


def geometry_figures(seed: int, runs: int) -> Iterator[Figure]:
    """Other places, clutter and sensors than the demands name."""
    others = {
        "30 % clutter": Layout(20, 14, 6),
        "a lane": Layout(20, 14, place=lane),
        "a cluster of 1.5 km": Layout(12, 9, place=cluster),
        "other's sensor three times worse": Layout(20, 14, other_sigmas=3.0),
    }
    for name, layout in others.items():
        m = measure(seed, max(runs // 200, 2), layout)
        yield told(f"acquisition, {name}: recall", m.recall)
        yield told(f"acquisition, {name}: precision", m.precision)
        yield told(f"acquisition, {name}: gross", m.gross)
        yield told(f"acquisition, {name}: acted upon", m.acted)
        yield told(f"acquisition, {name}: gross when acted upon", m.gross_acted)
        yield told(f"acquisition, {name}: location error / known association", m.location)


def baseline_figures(seed: int, runs: int) -> Iterator[Figure]:
    """The two methods it beats, on the first demand's scenes."""
    drawn = list(scenes(seed, max(runs // 100, 3), Layout(20, 14)))
    for name, method in (("ignoring the error", gnn_ignoring), ("iterated", gnn_iterated)):
        m = means([by_pairs(each, method(each)) for each in drawn])
        yield told(f"GNN {name}, N = 20, 30 % unshared: recall", m.recall)
        yield told(f"GNN {name}, N = 20, 30 % unshared: gross", m.gross)


def calibration_figures(seed: int, runs: int) -> Iterator[Figure]:
    """Few targets, any number of them shared: is a mode right as often as it says?"""
    every: list[Outcome] = []
    for k, (sigma_m, c_deg) in enumerate(((1500.0, 1.0), (5000.0, 3.0))):
        rng = np.random.default_rng([seed, 4, k])
        for _ in range(max(runs // 10, 5)):
            drawn = scene(rng, any_share(rng, 8, sigma_m, c_deg))
            every += outcomes(drawn, acquire(drawn.own, drawn.other, drawn.prior))
    chance, right = np.array([(o.probability, not o.gross) for o in every]).reshape(-1, 2).T
    bins = np.minimum((chance * _BINS).astype(int), _BINS - 1)
    worst = 0.0
    for k in range(_BINS):
        inside = bins == k
        if not inside.any():
            continue
        stated, found = chance[inside].mean(), right[inside].mean()
        if inside.sum() >= _LEAST_IN_BIN:
            worst = max(worst, abs(stated - found))
        name = f"modes of probability {k / _BINS:.1f} to {(k + 1) / _BINS:.1f}"
        yield told(f"{name} ({inside.sum()}, mean {stated:.3f}): right", found)
    yield at_most(f"calibration error, bins of {_LEAST_IN_BIN} and more", worst, 0.1)
    acted = chance > TRUST
    yield told("few targets, any share: modes acted upon", acted.sum())
    wrong = 1 - right[acted].mean() if acted.any() else 0.0
    yield at_most("few targets, any share: gross when acted upon", wrong, 0.005)


def speed_figures(seed: int) -> Iterator[Figure]:
    """Times on the machine of the demands."""
    for layout, limit_ms in ((Layout(20, 14), 20), (Layout(100, 70), 100)):
        drawn = next(iter(scenes(seed, 1, layout)))
        once = scaled_seconds(lambda s=drawn: acquire(s.own, s.other, s.prior))  # type: ignore[misc]
        yield at_most(
            f"acquisition, N = {layout.targets}: time, scaled", once * 1e3, limit_ms, "ms"
        )
    drawn = next(iter(scenes(seed, 1, Layout(100, 70, any_heading=True))))
    once = scaled_seconds(lambda: run(drawn, blind=True), repeats=2)
    yield told("acquisition, no prior, N = 100: time, scaled", once * 1e3, "ms")


def scenes(seed: int, runs: int, layout: Layout) -> Iterator[Scene]:
    """Draws of one layout."""
    rng = np.random.default_rng([seed, layout.targets, layout.shared, layout.clutter])
    for _ in range(runs):
        yield scene(rng, layout)


def measure(seed: int, runs: int, layout: Layout) -> Means:
    """Means of the best mode over draws of a layout."""
    drawn = scenes(seed, runs, layout)
    return means([best_of(each, run(each, layout.any_heading)) for each in drawn])


def run(given: Scene, blind: bool) -> Acquisition:
    """With the scene's prior, or with none."""
    if blind:
        return acquire_blind(given.own, given.other, unknown_frame(15e3))
    return acquire(given.own, given.other, given.prior)


def best_of(given: Scene, found: Acquisition) -> Outcome:
    """Of the first mode; no mode finds nothing, and is no gross failure: nothing is said."""
    every = outcomes(given, found)
    return every[0] if every else by_pairs(given, Pairs(*np.zeros((2, 0), dtype=np.intp)))


def outcomes(given: Scene, found: Acquisition) -> list[Outcome]:
    """Of every mode."""
    return [
        _outcome(
            given,
            Pairs(mode.own, mode.other),
            np.array([*mode.frame.q_m, mode.frame.D_rad]),
            mode.frame.covariance,
            mode.probability,
        )
        for mode in found.modes
    ]


def by_pairs(given: Scene, pairs: Pairs) -> Outcome:
    """Of pairs whose frame is their fit."""
    frame = fit_of(given, pairs)
    return _outcome(given, pairs, frame.t[0], frame.covariance[0], 0.0)


def _outcome(
    given: Scene, pairs: Pairs, t: Array, covariance: Array, probability: float
) -> Outcome:
    """Gross: the frame is beyond what its covariance allows, or most pairs are wrong."""
    right = given.partner[pairs.own] == pairs.other
    shared = int((given.partner != NOBODY).sum())
    error = _error(t, given.t)
    d2 = float(nees(error, covariance))
    return Outcome(
        recall=right.sum() / shared if shared else 1.0,
        precision=right.mean() if right.size else 1.0,
        gross=d2 > _GROSS or 2 * int(right.sum()) < right.size,
        error=error,
        known_error=_error(_known(given), given.t),
        nees=d2,
        probability=probability,
    )


def _known(given: Scene) -> Array:
    """(q, D) by the exact adjustment of the right pairs."""
    own = np.flatnonzero(given.partner != NOBODY)
    logs = given.own.take(own), given.other.take(given.partner[own])
    frame = adjustment(*logs, given.prior).own_axes
    return np.array([*frame.q_m, frame.D_rad])


def _error(t: Array, truth: Array) -> Array:
    error = t - truth
    error[2] = wrap_pi(error[2])
    return error


def means(outcomes: Iterable[Outcome]) -> Means:
    """Over runs."""
    every = list(outcomes)
    errors, known = (np.array([o[k] for o in every]) for k in (3, 4))
    gross = np.array([o.gross for o in every])
    acted = np.array([o.probability > TRUST for o in every])
    return Means(
        recall=float(np.mean([o.recall for o in every])),
        precision=float(np.mean([o.precision for o in every])),
        gross=float(gross.mean()),
        location=float(rms(errors[:, :2]) / rms(known[:, :2])),
        turn=float(rms(errors[:, 2]) / rms(known[:, 2])),
        nees=float(np.mean([o.nees for o in every if not o.gross] or [np.nan]) / 3),
        acted=float(acted.mean()),
        gross_acted=float(gross[acted].mean()) if acted.any() else 0.0,
    )
