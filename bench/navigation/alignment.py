"""System alignment on benchmark G: against the bound, the paper, late ranges, no prior, the clock.

The bound is the posterior one: prior and ranges linearised at the truth, the variances averaged.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from bench.figures import Figure, at_least, at_most, between, near, scaled_seconds, told
from bench.navigation.circling import (
    Flight,
    Score,
    aligned,
    flight,
    papers,
    score,
    with_late_ranges,
)
from estimation.system_alignment import (
    PLAIN,
    Alignment,
    align,
    closed_form_start,
    filtered,
    prior,
)

# epochs, differences, offsets: limits of xy, z [m], W [m/s], d [m]
_MAP = {
    "ranges": (200, False, False, {"xy": 6.9, "z": 18.5, "W": 0.021}),
    "ranges, d": (200, False, True, {"xy": 8.3, "z": 32.0, "d": 8.2}),
    "differences": (400, True, False, {"xy": 8.6, "z": 25.8, "W": 0.024}),
    "differences, d": (400, True, True, {"xy": 10.5, "z": 28.5, "d": 9.3}),
}
_SHARP = 5  # times the flights: 1000 tell a ratio of 1.1 from 1 by four standard errors
_UNITS = {"xy": "m", "z": "m", "W": "m/s", "d": "m"}


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """All of paper 003 but what diagnosis and adviser say."""
    for number, name in enumerate(_MAP):
        yield from _against_the_bound(seed + 1000 * number, _SHARP * runs, name)
    yield from _paper(seed, runs)
    yield from _late(seed, runs)
    yield from _no_prior(seed, runs)
    yield from _scale(seed, max(runs // 2, 5))
    yield from _first_ranges(seed, runs)
    yield from _times(seed)


def flights(seed: int, runs: int, name: str) -> list[Flight]:
    """Runs of one variant R."""
    epochs, differences, offsets, _ = _MAP[name]
    rng = np.random.default_rng([seed, 3])
    return [flight(rng, epochs, differences=differences, offsets=offsets) for _ in range(runs)]


def _against_the_bound(seed: int, runs: int, name: str) -> Iterator[Figure]:
    result = score(flights(seed, runs, name), aligned)
    for what, limit in _MAP[name][3].items():
        yield at_most(f"MAP, {name}: RMSE {what}", result.rmse(what), limit, _UNITS[what])
        ratio = result.rmse(what) / result.bound(what)
        yield at_most(f"MAP, {name}: RMSE / bound, {what}", ratio, 1.10)
        error = ratio * result.relative_error(what)
        yield told(f"MAP, {name}: RMSE / bound, {what}, standard error", error)
    yield between(f"MAP, {name}: NEES by dimension", result.nees.mean(), 0.9, 1.15)
    yield at_most(f"MAP, {name}: failures", float((~result.solved).sum()), 0)
    yield at_most(f"MAP, {name}: mirrors", result.mirrored(), 0)


def _paper(seed: int, runs: int) -> Iterator[Figure]:
    """The baseline, variant F; a run has diverged when its steps do not settle."""
    ranging = {n: baseline(seed, runs, n) for n in (60, 80, 100, 200)}
    differing = {n: baseline(seed, runs, n, differences=True) for n in (150, 200, 250, 400)}
    lost = {n: 100 * float((~s.solved).mean()) for n, s in ranging.items()}
    yield near("LS, ranges n=60: diverged", lost[60], 49, 8, "%")
    yield told("LS, ranges n=80: diverged", lost[80], "%")
    for n in (100, 200):
        yield told(f"LS, ranges n={n}: diverged", lost[n], "%")
        for what in ("W", "xy", "z"):
            yield told(f"LS, ranges n={n}: RMSE {what}", ranging[n].rmse(what), _UNITS[what])
    lost = {n: 100 * float((~s.solved).mean()) for n, s in differing.items()}
    yield at_least("LS, differences n=150: diverged", lost[150], 90, "%")
    yield told("LS, differences n=200: diverged", lost[200], "%")
    yield at_most("LS, differences n=250: diverged", lost[250], 3, "%")
    yield told("LS, differences n=400: mirrored", 100 * differing[400].mirrored() / runs, "%")
    for n, differences in ((200, False), (400, True)):
        result = baseline(seed, runs, n, differences=differences, offsets=True)
        name = "differences" if differences else "ranges"
        yield told(f"LS with d, {name} n={n}: diverged", 100 * float((~result.solved).mean()), "%")


def baseline(
    seed: int, runs: int, epochs: int, *, differences: bool = False, offsets: bool = False
) -> Score:
    """The paper's method on the paper's variant."""
    rng = np.random.default_rng([seed, 4, epochs])
    flown = [
        flight(rng, epochs, differences=differences, offsets=offsets, fixed=True)
        for _ in range(runs)
    ]
    return score(flown, papers)


def _late(seed: int, runs: int) -> Iterator[Figure]:
    clean = flights(seed + 5, runs, "ranges")
    rng = np.random.default_rng([seed, 5])
    result = score([with_late_ranges(rng, flown, 0.2) for flown in clean], aligned)
    yield at_most("20 % late ranges: RMSE xy", result.rmse("xy"), 7.5, "m")
    yield at_most("20 % late ranges: RMSE z", result.rmse("z"), 19, "m")
    yield told("20 % late ranges: NEES by dimension", result.nees.mean())
    robust, plain = (score(clean, method) for method in (aligned, _plainly))
    cost = robust.rmse("xy") / plain.rmse("xy") - 1
    yield at_most("no late ranges: what robustness costs in xy", 100 * cost, 5, "%")


def _plainly(flown: Flight) -> Alignment:
    return align(flown.path, flown.logs, flown.prior, losses=PLAIN)


def _no_prior(seed: int, runs: int) -> Iterator[Figure]:
    rng = np.random.default_rng([seed, 6])
    wide = [flight(rng, 200, sigma_beacon_m=1e5, sigma_wind_mps=100.0) for _ in range(runs)]
    result = score(wide, from_nothing)
    near_enough = np.abs(result.errors).max(axis=1) < 150
    share = 100 * float((result.solved & near_enough).mean())
    yield at_least("no prior, ranges n=200: converged", share, 99, "%")
    yield told("no prior: RMSE xy", result.rmse("xy"), "m")


def from_nothing(flown: Flight) -> Alignment:
    """Without a prior: started in closed form."""
    start = closed_form_start(flown.path, flown.logs, flown.prior)
    return align(flown.path, flown.logs, flown.prior, start=start)


def _scale(seed: int, runs: int, scale: float = 0.065) -> Iterator[Figure]:
    """Ranges that read 6.5 % long, the scale not known to 10 %."""
    flown = []
    for one in flights(seed + 7, runs, "ranges"):
        read = one.logs.value_m * (1 + scale)  # the noise too: .2 m of 3.5
        known = prior(
            one.prior.mean[7:13].reshape(2, 3), 50.0, sigma_wind_mps=1.0, sigma_range_scale=0.1
        )
        flown.append(one._replace(logs=one.logs._replace(value_m=read), prior=known))
    found = [aligned(one) for one in flown]
    errors = np.array([a.theta[4] - scale for a in found])
    sigmas = np.array([np.sqrt(a.covariance[4, 4]) for a in found])
    yield told(
        "range scale 6.5 %: RMSE of the scale", 100 * float(np.sqrt(np.mean(errors**2))), "%"
    )
    yield between(
        "range scale 6.5 %: squared error by its variance",
        float(np.mean((errors / sigmas) ** 2)),
        *_chi_square_band(runs),
    )


def _chi_square_band(runs: int) -> tuple[float, float]:
    """Three sigmas of the mean of so many squared normal errors, and never narrower than .7-1.3."""
    width = max(3 * np.sqrt(2 / runs), 0.3)
    return 1 - width, 1 + width


def _first_ranges(seed: int, runs: int) -> Iterator[Figure]:
    """It works from the first range: honest at n = 1, 5 and 20."""
    rng = np.random.default_rng([seed, 8])
    for epochs in (1, 5, 20):
        result = score([flight(rng, epochs) for _ in range(runs)], aligned)
        yield between(f"MAP, ranges n={epochs}: NEES by dimension", result.nees.mean(), 0.9, 1.15)
        yield at_most(f"MAP, ranges n={epochs}: failures", float((~result.solved).sum()), 0)


def _times(seed: int) -> Iterator[Figure]:
    rng = np.random.default_rng([seed, 9])
    short, long = flight(rng, 400), flight(rng, 10_000)
    quick, slow = (scaled_seconds(partial(aligned, f), r) for f, r in ((short, 20), (long, 3)))
    yield at_most("solve, n = 400", 1e3 * quick, 15, "ms, scaled")
    yield at_most("solve, n = 10 000", slow, 0.3, "s, scaled")
    step = scaled_seconds(lambda: list(filtered(short.path, short.logs, short.prior)), 5) / 400
    yield at_most("online step", 1e3 * step, 0.2, "ms, scaled")
