"""Two carriers and a doubtful north; wrong bearings; no manoeuvre; altitude; the next turn."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.bearings_only.scenes import (
    BENCHMARKS,
    MINUTE,
    Drawn,
    Own,
    benchmark,
    geometry_of,
    heading,
    own_track,
)
from bench.bearings_only.unknown import judged
from bench.figures import Figure, at_least, at_most, between, told
from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_VELOCITY,
    Bearings,
    Elevations,
    FramePrior,
    JointSolution,
    bearings,
    best_turn,
    gross_errors,
    in_space,
    jointly,
    maximum_likelihood,
    solve,
    solve_many,
)
from estimation.consistency import nees, rms

TARGETS = 20
SIGMA = 20 * MINUTE
OUTLIER_SHARE, OUTLIER = 0.05, np.radians(20)


class Pair(NamedTuple):
    """Two carriers that see the same targets; the second's north is off by `yaw_rad`."""

    carriers: tuple[Bearings, Bearings]
    yaw_rad: float
    places_m: Array  # (T, 2) at the last bearing
    ranges_m: Array  # (T,) from the own carrier


def figures(seed: int, runs: int) -> Iterator[Figure]:
    """Demand 7, then what the page says of one carrier that does not turn."""
    yield from _pair_figures(np.random.default_rng([seed, 7]), -(-runs // 5))
    yield from _outlier_figures(np.random.default_rng([seed, 77]), -(-runs // 4))
    yield from _straight_figures(np.random.default_rng([seed, 78]), -(-runs // 5))
    yield from _altitude_figures(np.random.default_rng([seed, 79]), runs)
    yield from _turn_figures(np.random.default_rng([seed, 80]))


def pair(rng: np.random.Generator) -> Pair:
    """Own carrier as in S; another five to eight kilometres off, also turning once."""
    t = 15.0 * np.arange(41)
    away = rng.uniform(5000, 8000) * heading(rng.uniform(0, 360))
    course = rng.uniform(0, 360)
    other = Own(5, (course, course + rng.uniform(60, 120)), (rng.uniform(200, 400),))
    tracks = own_track(BENCHMARKS["S"].own, t), away + own_track(other, t)
    around = (away / 2)[None] + rng.uniform(3000, 9000, TARGETS) * heading(
        rng.uniform(0, 360, TARGETS)
    )
    velocity = rng.uniform(2, 10, TARGETS) * heading(rng.uniform(0, 360, TARGETS))
    places = around[:, None] + velocity[:, None] * t
    yaw = float(np.radians(rng.normal()))
    seen = []
    for track, off in zip(tracks, (0.0, yaw), strict=True):
        d = places - track
        noisy = np.arctan2(d.real, d.imag) - off + rng.normal(0, SIGMA, d.shape)
        seen.append(bearings(t, np.stack([track.real, track.imag], axis=1), noisy, SIGMA))
    last = np.stack([places[:, -1].real, places[:, -1].imag], axis=1)
    return Pair((seen[0], seen[1]), yaw, last, np.abs(places[:, -1] - tracks[0][-1]))


def _pair_figures(rng: np.random.Generator, runs: int) -> Iterator[Figure]:
    pairs = [pair(rng) for _ in range(runs)]
    free = [jointly(p.carriers, [FramePrior(np.radians(1))]) for p in pairs]
    held = [jointly(p.carriers, [FramePrior(1e-9)]) for p in pairs]
    alone = [jointly(p.carriers[:1], []) for p in pairs]
    yaws = np.array([f.yaw_rad[1] - p.yaw_rad for f, p in zip(free, pairs, strict=True)])
    told_sigma = np.array([np.sqrt(f.covariance[0, 0]) for f in free])
    title = "two carriers, 20 targets, 60'"
    yield at_most(
        f"{title}, yaw unknown to 1 deg: median range error", _median(free, pairs), 0.6, "%"
    )
    yield at_most(f"{title}: yaw error, RMS", rms(yaws) / MINUTE, 6, "arcmin")
    yield told(f"{title}: yaw error / its sigma, RMS", rms(yaws / told_sigma))
    yield told(f"{title}: NEES/2 of the places", float(np.mean(_place_nees(free, pairs))))
    yield told(f"{title}: chi2 / dof", float(np.mean([f.chi2 / f.dof for f in free])))
    yield told(f"{title}, yaw ignored: median range error", _median(held, pairs), "%")
    yield told(f"{title}, one carrier alone: median range error", _median(alone, pairs), "%")
    yield told(f"{title}: converged", float(np.mean([f.converged for f in free])))


def _median(found: list[JointSolution], pairs: list[Pair]) -> float:
    errors = []
    for solution, truth in zip(found, pairs, strict=True):
        inverse = solution.targets.state(truth.carriers[0].t_s[-1]).position_m
        ranges = np.linalg.norm(inverse - truth.carriers[0].observer_m[-1], axis=1)
        errors.append(100 * np.abs(ranges / truth.ranges_m - 1))
    return float(np.median(errors))


def _place_nees(found: list[JointSolution], pairs: list[Pair]) -> Array:
    each = []
    for solution, truth in zip(found, pairs, strict=True):
        state = solution.targets.state(truth.carriers[0].t_s[-1])
        each.append(nees(state.position_m - truth.places_m, state.covariance[:, :2, :2]) / 2)
    return np.array(each)


def spoilt(rng: np.random.Generator, scene: Drawn) -> Drawn:
    """A share of the bearings off by 20 deg to either side."""
    shape = scene.given.bearing_rad.shape
    wrong = rng.uniform(size=shape) < OUTLIER_SHARE
    off = np.where(wrong, OUTLIER * rng.choice([-1, 1], shape), 0.0)
    return scene._replace(given=scene.given._replace(bearing_rad=scene.given.bearing_rad + off))


def _outlier_figures(rng: np.random.Generator, runs: int) -> Iterator[Figure]:
    for name in BENCHMARKS:
        scene = spoilt(rng, benchmark(rng, name, "A", 60, runs))
        found = judged(scene, gross_errors())
        title = f"{name} 60', 5 % of bearings off by 20 deg"
        yield at_most(f"{title}: median", found.percentile(50), 6, "%")
        yield at_most(f"{title}: 95th percentile", found.percentile(95), 20, "%")
        share = float(found.covered.mean())
        yield between(f"{title}: 95 % intervals cover", share, 0.92, 0.97)
        for loss, what in ((gross_errors(), "known motion"), (None, "least squares")):
            inverse = maximum_likelihood(scene.given, CONSTANT_VELOCITY, loss).inverse_range()
            error = 100 * np.abs(1 / inverse.value / scene.range_m - 1)
            yield told(f"{title}, {what}: median", float(np.median(error)), "%")


def _straight_figures(rng: np.random.Generator, runs: int) -> Iterator[Figure]:
    """Without a manoeuvre: undetermined, and an interval that holds the range."""
    statuses, covered, silent = [], [], []
    for motion in ("A", "C"):
        scene = benchmark(rng, "S", motion, 60, runs)
        t = scene.given.t_s
        track = own_track(Own(5, (210.0,), ()), t)
        truth = (
            3000j + (5 * heading(225)) * t + (0.01 * heading(315) * t**2 if motion == "C" else 0)
        )
        d = truth - track
        noisy = np.arctan2(d.real, d.imag) + rng.normal(0, SIGMA, (runs, len(t)))
        given = bearings(t, np.stack([track.real, track.imag], axis=1), noisy, SIGMA)
        found = solve_many(given)
        statuses += [s.status != "determined" for s in found]
        silent += [(s.at(float(t[-1])) is None) == (s.status == "undetermined") for s in found]
        if motion == "A":
            yield at_least(
                "no manoeuvre, uniform: undetermined",
                float(np.mean([s.status == "undetermined" for s in found])),
                1,
            )
            covered += [float(np.abs(d[-1])) in s.interval for s in found]
    yield at_least("no manoeuvre: never determined", float(np.mean(statuses)), 1)
    yield at_least("undetermined means no number", float(np.mean(silent)), 1)
    yield told("no manoeuvre: intervals (open) hold the range", float(np.mean(covered)))


def _altitude_figures(rng: np.random.Generator, runs: int) -> Iterator[Figure]:
    """A carrier at 300 m that does not turn, a target at sea level, elevations of 60'."""
    t = 15.0 * np.arange(41)
    track = own_track(Own(5, (210.0,), ()), t)
    d = 3000j + 5 * heading(225) * t - track
    noisy = np.arctan2(d.real, d.imag) + rng.normal(0, SIGMA, (runs, len(t)))
    up = np.arctan2(-300.0, np.abs(d)) + rng.normal(0, SIGMA, (runs, len(t)))
    given = bearings(t, np.stack([track.real, track.imag], axis=1), noisy, SIGMA)
    angles = Elevations(up, np.full(len(t), SIGMA), np.full(len(t), 300.0))
    found = in_space(given, angles, 0.0, 1.0).horizontal.inverse_range()
    error = 100 * (1 / found.value / np.abs(d[-1]) - 1)
    yield told("no manoeuvre, known altitude: RMS range error", rms(error), "%")
    covered = np.abs(found.value - 1 / np.abs(d[-1])) < 1.96 * found.sigma
    yield between("no manoeuvre, known altitude: 95 % intervals cover", covered.mean(), 0.92, 0.97)


def _turn_figures(rng: np.random.Generator) -> Iterator[Figure]:
    """Best and worst next turn of the own carrier half way through S."""
    t = geometry_of("S", 20).t_s
    half = len(t) // 2
    straight = own_track(Own(5, (210.0,), ()), t[:half])
    d = 3000j + 5 * heading(225) * t[:half] - straight
    noisy = np.arctan2(d.real, d.imag) + rng.normal(0, SIGMA, half)
    given = bearings(t[:half], np.stack([straight.real, straight.imag], axis=1), noisy, SIGMA)
    plan = best_turn(given, solve(given), 5.0, 300.0)
    assert plan is not None
    ends = np.sort(plan.relative_sigma)
    yield told("next turn: bound of the range with the best", 100 * ends[0], "%")
    yield told("next turn: bound of the range with the worst but one", 100 * ends[-2], "%")
