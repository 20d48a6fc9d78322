"""Solutions of unknown motion: status, interval, runner-up, alarm, what is left without range."""

from __future__ import annotations

import numpy as np
import pytest

from bench.bearings_only.scenes import Own, benchmark, geometry_of, heading, own_track
from bench.bearings_only.turns import turning, unmodelled
from bench.bearings_only.unknown import judged
from estimation.arrays import Array
from estimation.bearings_only import (
    CONSTANT_VELOCITY,
    FINITE_TURN,
    THREE_LEGS,
    Bearings,
    MotionPrior,
    Solution,
    bearings,
    best_turn,
    solve,
    solve_many,
)
from estimation.bearings_only.solution import mixture_interval, status_of

NAMES = {
    "A": "constant velocity",
    "B": "straight accelerated",
    "C": "constant acceleration",
    "D": "two legs",
}


def first(given: Bearings, count: int | None = None) -> Bearings:
    """The first target of a batch, its first bearings."""
    cut = slice(count)
    return Bearings(
        given.t_s[cut], given.observer_m[cut], given.bearing_rad[0, cut], given.sigma_rad[cut]
    )


def straight(sigma: float = 0.002, seed: int = 1) -> tuple[Bearings, Array]:
    """Bearings from a carrier that does not turn, and the true range at each."""
    t = 15.0 * np.arange(41)
    own = own_track(Own(5, (210.0,), ()), t)
    d = 3000j + 5 * heading(225) * t - own
    noise = np.random.default_rng(seed).normal(0, sigma, 41)
    places = np.stack([own.real, own.imag], axis=1)
    return bearings(t, places, np.arctan2(d.real, d.imag) + noise, sigma), np.abs(d)


@pytest.mark.parametrize("kind", "ABCD")
def test_the_motion_is_recognised(kind: str) -> None:
    scene = benchmark(np.random.default_rng(1), "M", kind, 10, 12)
    found = solve_many(scene.given)
    winners = [s.winner.motion for s in found if s.winner]
    assert winners.count(NAMES[kind]) >= 9
    for solution, true_m in zip(found, scene.range_m, strict=True):
        assert solution.status == "determined"
        state = solution.at(600.0)
        assert state is not None
        seen = np.linalg.norm(state.position_m - scene.given.observer_m[-1])
        assert seen == pytest.approx(true_m, rel=0.1)


@pytest.mark.parametrize("kind", "AC")
def test_medians_and_intervals(kind: str) -> None:
    """The smoke size of the demands on unknown motion."""
    found = judged(benchmark(np.random.default_rng(2), "S", kind, 60, 25))
    assert found.percentile(50) < 1.4 * found.median_bound * 1.5  # 25 runs: a median to 25 %
    assert found.covered.mean() >= 0.85


def test_weights_fall_and_add_up() -> None:
    found = solve(first(benchmark(np.random.default_rng(3), "S", "C", 60, 1).given))
    weights = [c.weight for c in found.candidates]
    assert weights == sorted(weights, reverse=True)
    assert sum(weights) == pytest.approx(1)
    assert found.winner is not None
    assert found.runner_up is not None
    assert found.runner_up.weight == weights[1]
    assert sum(weight for weight, _ in found.mixture) == pytest.approx(1)


def test_one_is_as_many() -> None:
    scene = benchmark(np.random.default_rng(4), "S", "B", 10, 3)
    together = solve_many(scene.given)
    for i, found in enumerate(together):
        alone = solve(scene.given._replace(bearing_rad=scene.given.bearing_rad[i]))
        assert alone.status == found.status
        assert alone.interval.low_m == pytest.approx(found.interval.low_m, rel=1e-4)
        assert alone.candidates[0].motion == found.candidates[0].motion


def test_without_a_manoeuvre_there_is_a_family_and_no_number() -> None:
    given, true_m = straight()
    found = solve(given)
    assert found.status == "undetermined"
    assert found.at(600.0) is None
    assert found.interval.high_m == np.inf
    assert float(true_m[-1]) in found.interval
    assert found.line is not None
    assert found.velocities is not None
    # the right range gives the right velocity
    velocity = found.velocities.velocity_mps(true_m[-1])
    spread = true_m[-1] * np.sqrt(np.diag(found.velocities.covariance))
    target = 5 * np.array([np.sin(np.radians(225)), np.cos(np.radians(225))])
    assert (np.abs(velocity - target) < 4 * spread + 0.2).all()
    closing = (true_m[-1] - true_m[-2]) / 15 / true_m[-1]
    sigma = np.sqrt(found.line.covariance[2, 2])
    assert abs(found.line.range_rate_over_range - closing) < 4 * sigma + 1e-5


def test_status_rises_as_bearings_come() -> None:
    given = benchmark(np.random.default_rng(5), "S", "A", 10, 1).given
    order = ["undetermined", "weak", "determined"]
    ranks = [order.index(solve(first(given, count)).status) for count in (2, 8, 14, 41)]
    assert ranks[:2] == [0, 0]
    assert ranks[-1] == 2


def test_status_is_not_the_prior() -> None:
    """A prior as sharp as one likes does not make a range determined."""
    given, _ = straight()
    sharp = MotionPrior(range_m=3000.0, sigma_log_range=0.01, sigma_speed_mps=5.0)
    assert solve(given, sharp, (CONSTANT_VELOCITY,)).status == "undetermined"


@pytest.mark.parametrize(
    ("sigma", "status"),
    [
        (0.05, "determined"),
        (0.3, "weak"),
        (0.7, "undetermined"),
        (np.inf, "undetermined"),
        (np.nan, "undetermined"),
    ],
)
def test_thresholds(sigma: float, status: str) -> None:
    assert status_of(sigma) == status


def test_mixture_intervals() -> None:
    one = mixture_interval(np.ones(1), np.array([1e-3]), np.array([1e-5]))
    assert one.low_m == pytest.approx(1 / (1e-3 + 1.96e-5), rel=1e-4)
    assert one.high_m == pytest.approx(1 / (1e-3 - 1.96e-5), rel=1e-4)
    open_ = mixture_interval(np.ones(1), np.array([1e-4]), np.array([1e-4]))
    assert open_.high_m == np.inf
    assert 1e9 in open_
    assert 100.0 not in open_
    two = mixture_interval(np.array([0.5, 0.5]), np.array([1e-3, 2e-3]), np.array([1e-6, 1e-6]))
    assert two.high_m == pytest.approx(1000, rel=0.01)
    assert two.low_m == pytest.approx(500, rel=0.01)


def test_one_finite_turn() -> None:
    found = judged(turning(np.random.default_rng(6), "S", FINITE_TURN, 24))
    assert found.percentile(90) < 25


def test_two_turns_are_found_on_alarm() -> None:
    scene = turning(np.random.default_rng(7), "M", THREE_LEGS, 12)
    found = solve_many(scene.given)
    assert sum(s.winner is not None and s.winner.motion == "three legs" for s in found) >= 8
    assert np.median(np.abs(judged(scene).error)) < 10


@pytest.mark.parametrize("kind", ["weave", "zigzag of five legs"])
def test_unmodelled_motion_alarms(kind: str) -> None:
    found = judged(unmodelled(np.random.default_rng(8), "S", kind, 8))
    assert found.alarms >= 0.85


def test_modelled_motion_does_not_alarm() -> None:
    scene = benchmark(np.random.default_rng(9), "S", "A", 60, 30)
    assert judged(scene).alarms <= 0.1


def test_state_is_honest_where_motions_compete() -> None:
    """The covariance of a mixture holds the runner-up."""
    scene = benchmark(np.random.default_rng(10), "S", "C", 60, 20)
    for found in solve_many(scene.given):
        state = found.at(600.0)
        if state is None:
            continue
        winner = found.mixture[0][1].state(600.0)
        assert np.linalg.eigvalsh(state.covariance)[0] > -1e-6
        alone = found.mixture[0][0] * winner.covariance[0][0, 0]
        assert state.covariance[0, 0] >= 0.99 * alone


def test_the_best_turn_is_one() -> None:
    given, true_m = straight()
    found = solve(given)
    plan = best_turn(given, found, 5.0, 300.0)
    assert plan is not None
    assert plan.relative_sigma.min() < 0.1 * plan.relative_sigma[14]  # straight on: 210 deg
    known = best_turn(given, found, 5.0, 300.0, float(true_m[-1]))
    assert known is not None
    assert known.relative_sigma.min() < 0.05


def test_the_best_turn_delivers() -> None:
    """The bound it promises is the bound of the track that follows."""
    given, true_m = straight()
    plan = best_turn(given, solve(given), 5.0, 300.0, float(true_m[-1]))
    assert plan is not None
    later = 15.0 * np.arange(1, 21)
    way = 5 * later * heading(float(np.degrees(plan.course_rad)))
    own = given.observer_m[-1] @ [1, 1j] + way
    target = 3000j + 5 * heading(225) * (600 + later)
    rng = np.random.default_rng(11)
    errors = []
    for _ in range(30):
        noise = rng.normal(0, 0.002, 20)
        more = bearings(
            np.concatenate([given.t_s, 600 + later]),
            np.concatenate([given.observer_m, np.stack([own.real, own.imag], axis=1)]),
            np.concatenate(
                [
                    straight(seed=int(rng.integers(1 << 30)))[0].bearing_rad,
                    _angle(target - own) + noise,
                ]
            ),
            0.002,
        )
        found = solve(more, motions=(CONSTANT_VELOCITY,))
        errors.append(_range(found) / np.abs(target[-1] - own[-1]) - 1)
    assert np.std(errors) == pytest.approx(
        plan.relative_sigma.min(), rel=0.4
    )  # 30 runs: 13 %, and linear


def _angle(d: np.ndarray) -> Array:
    return np.asarray(np.arctan2(d.real, d.imag))


def _range(found: Solution) -> float:
    return float(1 / found.mixture[0][1].inverse_range().value[0])


def test_geometry_of_a_benchmark_is_the_page_s() -> None:
    given = geometry_of("S", 20.0)
    assert given.t_s[-1] == 600
    np.testing.assert_allclose(np.linalg.norm(np.diff(given.observer_m, axis=0)[0]), 75)
