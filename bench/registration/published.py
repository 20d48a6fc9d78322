"""The table of the paper, the bound, what the paper says in words, what its errata cost."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from bench.figures import Figure, at_least, between, near, table, told
from bench.registration.scenes import (
    DEG,
    SIGMA_BEARING_RAD,
    SIGMA_C_RAD,
    SIGMA_RANGE_M,
    Experiment,
    errors_fixed,
    errors_own,
    experiment,
    logs_of,
)
from estimation.arrays import Array
from estimation.consistency import nees, rms
from estimation.relative_frame import (
    PolarLogs,
    RelativeFramePrior,
    closed_form,
    cramer_rao,
    in_own_axes,
    prior_in_own_axes,
)
from estimation.relative_frame.closed_form import conditions, correlate_matrix, theta_columns

# RMS after / before, (estimate, bound), by L, of an independent run of the same experiment: the
# paper itself prints one sentence, see docs/papers/000.md.
QUANTITIES = ("location, fixed axes", "location, own axes", "c2 - c1")
REFERENCE = {
    1: ((0.194, 0.197), (0.216, 0.220), (0.978, 0.977)),
    2: ((0.121, 0.121), (0.118, 0.119), (0.574, 0.576)),
    4: ((0.091, 0.090), (0.067, 0.067), (0.340, 0.336)),
    7: ((0.081, 0.081), (0.047, 0.047), (0.239, 0.239)),
    10: ((0.078, 0.078), (0.038, 0.038), (0.195, 0.197)),
    50: ((0.072, 0.072), (0.017, 0.016), (0.086, 0.085)),
}


class Means(NamedTuple):
    """Means over runs; the first four are mean squares, (3,), one for each of `QUANTITIES`."""

    after: Array
    before: Array
    bound: Array
    prior: Array  # what `before` tends to
    nees_own: float  # by dimension: 1 is honest
    nees_fixed: float
    chi2: float  # by degree of freedom


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """The table, then the page's sentences."""
    yield from table_figures({pairs: measure(seed, runs, pairs) for pairs in REFERENCE})
    yield from page_figures(seed, runs)


@cache
def measure(
    seed: int, runs: int, pairs: int, sigma_c_rad: float = SIGMA_C_RAD, block: int = 2000
) -> Means:
    """The closed form over many runs of the experiment, in equal blocks that fit in memory."""
    blocks = -(-runs // block)
    means = []
    for i in range(blocks):
        rng = np.random.default_rng([seed, pairs, i])
        means.append(_means(experiment(rng, (-(-runs // blocks),), pairs, sigma_c_rad)))
    return Means(*(np.mean(column, axis=0) for column in zip(*means, strict=True)))


def _means(scene: Experiment) -> Means:
    frame = closed_form(*logs_of(scene))
    own_axes = in_own_axes(frame, scene.prior)
    fixed, own = errors_fixed(frame, scene), errors_own(own_axes, scene)
    bound = cramer_rao(scene.true_own, scene.true_other, scene.truth)
    return Means(
        after=_mean_squares(fixed, own),
        before=_mean_squares(scene.theta, errors_own(prior_in_own_axes(scene.prior), scene)),
        bound=_variances(bound.fixed, bound.own_axes),
        prior=_variances(scene.truth.covariance, prior_in_own_axes(scene.truth).covariance),
        nees_own=float(nees(own, own_axes.covariance).mean() / 3),
        nees_fixed=float(nees(fixed, frame.covariance).mean() / 4),
        chi2=float(frame.chi2.mean() / frame.dof),
    )


def _mean_squares(fixed: Array, own: Array) -> Array:
    locations = [np.square(e[:, :2]).sum(axis=1).mean() for e in (fixed, own)]
    return np.array([*locations, np.square(own[:, 2]).mean()])


def _variances(fixed: Array, own: Array) -> Array:
    locations = [np.trace(p[..., :2, :2], axis1=-2, axis2=-1).mean() for p in (fixed, own)]
    return np.array([*locations, own[..., 2, 2].mean()])


def closed_form_as_printed(
    own: PolarLogs, other: PolarLogs, prior: RelativeFramePrior, *, only_xy: bool = False
) -> Array:
    """Corrections (..., 4) by eq. (11) with its diagonals as printed: what the errata cost.

    On the diagonals of M^xx and M^yy every variance stands times its coefficient once, and M^xy
    lacks a_b2^x sigma_c2^2 a_b2^y; `only_xy` commits the second erratum alone.
    """
    c, p0 = conditions(own, other, prior.offset_m), prior.covariance
    c1, c2 = p0[2, 2], p0[3, 3]
    h = theta_columns(c)
    m = correlate_matrix(c, h, p0)
    x, y = np.arange(own.count), np.arange(own.count, 2 * own.count)
    m[..., x, y] -= c.a_b2_x * c2 * c.a_b2_y
    if not only_xy:
        a_d_x = np.sin(own.bearing_rad) - np.sin(other.bearing_rad)  # a_d1^x + a_d2^x
        a_d_y = np.cos(own.bearing_rad) - np.cos(other.bearing_rad)
        b, d = SIGMA_BEARING_RAD**2, SIGMA_RANGE_M**2
        m[..., x, x] = p0[0, 0] + c.a_b1_x * (c1 + b) + c.a_b2_x * (c2 + b) + a_d_x * d
        m[..., y, y] = p0[1, 1] + c.a_b1_y * (c1 + b) + c.a_b2_y * (c2 + b) + a_d_y * d
    w = np.concatenate([c.w_x, c.w_y], axis=-1)
    theta: Array = p0 @ h @ np.linalg.solve(m, -w[..., None])
    return theta[..., 0]


def paper_table(measured: dict[int, Means]) -> str:
    """RMS after / before, estimate (bound), beside the reference; a row an L."""
    headings = ["L", *(text for name in QUANTITIES for text in (name, "reference"))]
    rows = []
    for pairs, m in measured.items():
        ours = zip(np.sqrt(m.after / m.before), np.sqrt(m.bound / m.prior), strict=True)
        both = (cell for each in zip(ours, REFERENCE[pairs], strict=True) for cell in each)
        rows.append([str(pairs), *(f"{estimate:.3f} ({bound:.3f})" for estimate, bound in both)])
    return table(headings, rows)


def table_figures(measured: dict[int, Means]) -> Iterator[Figure]:
    """Every entry of the page's table, to 3 % or .001, and how honest the covariance is."""
    for pairs, m in measured.items():
        estimates, bounds = np.sqrt(m.after / m.before), np.sqrt(m.bound / m.prior)
        for i, name in enumerate(QUANTITIES):
            for kind, value in (("estimate", estimates[i]), ("bound", bounds[i])):
                reference = REFERENCE[pairs][i][kind == "bound"]
                tolerance = max(0.03 * reference, 0.001)
                yield near(f"L = {pairs}: {name}, {kind}", value, reference, tolerance)
        yield between(f"L = {pairs}: NEES/3, own axes", m.nees_own, 0.9, 1.1)
        yield between(f"L = {pairs}: NEES/4, fixed axes", m.nees_fixed, 0.9, 1.1)
        yield between(f"L = {pairs}: chi2/(2L)", m.chi2, 0.97, 1.03)


def page_figures(seed: int, runs: int) -> Iterator[Figure]:
    """What the paper says in words, where one linearisation ends, what the errata cost."""
    floor = measure(seed, max(runs // 40, 10), 1000, block=100)
    name = "L = 1000: location, fixed axes"
    yield near(f"{name}, bound", np.sqrt(floor.bound / floor.prior)[0], 0.071, 0.002)
    yield told(f"{name}, estimate", np.sqrt(floor.after / floor.before)[0])
    for pairs, reference in ((3, 0.17), (5, 0.08)):
        m = measure(seed, runs, pairs)
        ratio = (m.after / m.before)[2]
        yield near(f"L = {pairs}: c2 - c1, variance ratio", ratio, reference, 0.01)
    for pairs in (3, 4, 7):
        low, high = location_spread(seed, min(runs, 10_000), pairs)
        yield told(f"L = {pairs}: location bound, own axes, 1 % of geometries below", low)
        yield told(f"L = {pairs}: location bound, own axes, 1 % of geometries above", high)
    wide = measure(seed, runs, 7, 10 * DEG)
    excess = np.sqrt(wide.after / wide.bound)
    yield told("L = 7, sigma_c 10 deg: location in own axes, RMSE/bound", excess[1])
    yield told("L = 7, sigma_c 10 deg: c2 - c1, RMSE/bound", excess[2])
    yield from errata_figures(seed, min(runs, 20_000))


def location_spread(seed: int, runs: int, pairs: int) -> tuple[float, float]:
    """The 1st and 99th percentile over geometries of the bound / prior of the location."""
    scene = experiment(np.random.default_rng([seed, pairs]), (runs,), pairs)
    bound = cramer_rao(scene.true_own, scene.true_other, scene.truth).own_axes
    prior = prior_in_own_axes(scene.truth).covariance
    after, before = (np.trace(p[:, :2, :2], axis1=1, axis2=2) for p in (bound, prior))
    low, high = np.quantile(np.sqrt(after / before), [0.01, 0.99])
    return float(low), float(high)


def errata_figures(seed: int, runs: int) -> Iterator[Figure]:
    """Orientation at L = 4 with (11) as printed, against no correction and against the right one.

    As printed, M is now and then nearly singular and the RMS has no limit: hence ten sets.
    """
    scene = experiment(np.random.default_rng([seed, 4]), (10, -(-runs // 10)), 4)
    logs = logs_of(scene)
    turn = scene.theta[..., 3] - scene.theta[..., 2]
    right = closed_form(*logs)
    corrected = right.c2_rad - right.c1_rad - turn
    printed = closed_form_as_printed(*logs) @ [0, 0, -1, 1] - turn
    only_xy = closed_form_as_printed(*logs, only_xy=True) @ [0, 0, -1, 1] - turn

    harm = rms(printed, axis=1) / rms(turn, axis=1)
    median = np.median(np.abs(printed)) / np.median(np.abs(corrected))
    name = "(11) as printed, L = 4: c2 - c1"
    yield told(f"{name}, RMS after/before, smallest of ten sets", harm.min())
    yield told(f"{name}, RMS after/before, largest of ten sets", harm.max())
    yield at_least(f"{name}, RMS after/before, middle of ten sets", float(np.median(harm)), 1)
    yield told(f"{name}, median error / corrected", median)
    yield told(
        f"{name}, only M^xy as printed, RMS / corrected", float(rms(only_xy) / rms(corrected))
    )
