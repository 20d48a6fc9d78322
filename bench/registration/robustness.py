"""Wrong pairs among the right: what they cost the truncated loss, and what plain least squares."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.figures import Figure, at_most, scaled_seconds, told
from bench.registration.scenes import Experiment, errors_own, experiment, logs_of
from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.frames import east_north_from_polar, polar_from_east_north
from estimation.relative_frame import PolarLogs, adjustment, robust_adjustment

WRONG = 0.3
KINDS: tuple[tuple[str, float | None], ...] = (("anywhere", None), ("2 km away", 2000.0))


class Means(NamedTuple):
    """Of many runs; RMS errors of the location [m], own axes."""

    clean: float  # the right pairs alone
    robust: float
    plain: float  # least squares of all pairs
    nees: float  # of the robust one, / 3
    wrong_kept: float  # share of the wrong pairs
    right_lost: float  # share of the right pairs


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The demand on wrong pairs, at L = 10, 20 and 50, far and near."""
    for kind, spread_m in KINDS:
        for pairs in (10, 20, 50):
            m = measure(seed, max(runs // (20 if pairs < 50 else 80), 20), pairs, spread_m)
            name = f"30 % wrong pairs, {kind}, L = {pairs}"
            yield at_most(f"{name}: location RMSE / right pairs alone", m.robust / m.clean, 1.1)
            yield told(f"{name}: the same by least squares", m.plain / m.clean)
            yield told(f"{name}: NEES/3", m.nees)
            yield told(f"{name}: wrong pairs kept", m.wrong_kept)
            yield told(f"{name}: right pairs lost", m.right_lost)
    scene, _ = spoilt(np.random.default_rng([seed, 5]), (), 20, None)
    once = scaled_seconds(lambda: robust_adjustment(*logs_of(scene)))
    yield told("30 % wrong pairs, L = 20: time, scaled", once * 1e3, "ms")


def measure(seed: int, runs: int, pairs: int, spread_m: float | None) -> Means:
    """The paper's experiment with wrong pairs."""
    scene, wrong = spoilt(np.random.default_rng([seed, pairs, 30]), (runs,), pairs, spread_m)
    robust = robust_adjustment(*logs_of(scene))
    plain = adjustment(*logs_of(scene))
    right = np.flatnonzero(~wrong)
    clean = adjustment(scene.own.take(right), scene.other.take(right), scene.prior)
    of_clean, of_robust, of_plain = (
        errors_own(found.own_axes, scene) for found in (clean, robust.found, plain)
    )
    return Means(
        clean=_location(of_clean),
        robust=_location(of_robust),
        plain=_location(of_plain),
        nees=float(nees(of_robust, robust.found.own_axes.covariance).mean() / 3),
        wrong_kept=float(robust.kept[:, wrong].mean()),
        right_lost=float(1 - robust.kept[:, ~wrong].mean()),
    )


def _location(errors: Array) -> float:
    return float(rms(np.hypot(errors[:, 0], errors[:, 1])))


def spoilt(
    rng: np.random.Generator, shape: tuple[int, ...], pairs: int, spread_m: float | None
) -> tuple[Experiment, NDArray[np.bool_]]:
    """The experiment in which the other saw something else in 30 % of the pairs.

    At any place (None), or about the right one with a sigma in east and in north.
    """
    scene = experiment(rng, shape, pairs)
    wrong = np.arange(pairs) < round(WRONG * pairs)
    bearing, ranges = scene.other.bearing_rad, scene.other.range_m
    if spread_m is None:
        elsewhere = experiment(rng, shape, pairs).other
        bearing, ranges = elsewhere.bearing_rad, elsewhere.range_m
    else:
        seen = east_north_from_polar(bearing, ranges)
        bearing, ranges = polar_from_east_north(seen + rng.normal(0, spread_m, seen.shape))
    other = PolarLogs(
        np.where(wrong, bearing, scene.other.bearing_rad),
        np.where(wrong, ranges, scene.other.range_m),
        scene.other.covariance,
    )
    return scene._replace(other=other), wrong
