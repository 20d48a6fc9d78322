"""Intervals by the likelihood ratio, and motions that have several explanations."""

from __future__ import annotations

import numpy as np
import pytest

from bench.bearings_only.scenes import MOTIONS, benchmark, ensemble
from estimation.bearings_only import (
    CONSTANT_ACCELERATION,
    CONSTANT_VELOCITY,
    FAMILY,
    THREE_LEGS,
    TURN_RATE,
    bearings,
    likely_ranges,
    maximum_likelihood,
    solve_many,
)


@pytest.mark.parametrize(("name", "kind"), [("S", "C"), ("S", "A"), ("M", "B")])
def test_intervals_of_a_known_motion_cover(name: str, kind: str) -> None:
    """1000 runs: 95 % to .7 % (one sigma)."""
    scene = benchmark(np.random.default_rng(1), name, kind, 60, 1000)
    low, high = likely_ranges(maximum_likelihood(scene.given, MOTIONS[kind]))
    assert 0.925 < np.mean((low <= scene.range_m) & (scene.range_m <= high)) < 0.975
    assert 0.01 < np.mean(scene.range_m < low) < 0.045
    assert 0.01 < np.mean(scene.range_m > high) < 0.045


def test_they_are_the_gaussian_ones_where_bearings_are_good() -> None:
    scene = benchmark(np.random.default_rng(2), "M", "A", 10, 50)
    found = maximum_likelihood(scene.given, CONSTANT_VELOCITY)
    low, high = likely_ranges(found)
    value, sigma = found.inverse_range()
    np.testing.assert_allclose(1 / low, value + 1.96 * sigma, rtol=1e-3)
    np.testing.assert_allclose(1 / high, value - 1.96 * sigma, rtol=1e-3)


def test_they_do_not_ask_how_long_a_metre_is() -> None:
    scene = benchmark(np.random.default_rng(3), "S", "C", 60, 20)
    ranges = [
        likely_ranges(
            maximum_likelihood(
                scene.given._replace(observer_m=scene.given.observer_m * scale), MOTIONS["C"]
            )
        ).low_m
        / scale
        for scale in (1.0, 0.3048)
    ]
    np.testing.assert_allclose(*ranges, rtol=1e-3)


def test_without_a_manoeuvre_they_are_open() -> None:
    t = 15.0 * np.arange(41)
    places = np.stack([5 * t, 0 * t], axis=1)
    angle = np.arctan2(1000 - 3 * t, 4000 - 2 * t) + np.random.default_rng(4).normal(0, 2e-3, 41)
    found = likely_ranges(maximum_likelihood(bearings(t, places, angle, 2e-3), CONSTANT_VELOCITY))
    assert not np.isnan(found.low_m).any()
    assert np.isinf(found.high_m).all()


KINDS = {motion.name: motion.kind for motion in (*FAMILY, THREE_LEGS)}


def test_motions_are_named_once_and_the_likeliest_kind_leads() -> None:
    """Several minima of a motion are one candidate, and forms of one kind stand together.

    The first of the mixture is the best of the winner.
    """
    scene = ensemble(np.random.default_rng(5), "finite turn", 40)
    several = 0
    for found in solve_many(scene.given):
        names = [c.motion for c in found.candidates]
        assert len(set(names)) == len(names)
        assert sum(c.weight for c in found.candidates) == pytest.approx(1)
        kinds = [KINDS[name] for name in names]
        firsts = sorted(set(kinds), key=kinds.index)
        assert kinds == sorted(kinds, key=firsts.index)
        of_kind = [
            [c.weight for c in found.candidates if KINDS[c.motion] == kind] for kind in firsts
        ]
        assert of_kind == [sorted(some, reverse=True) for some in of_kind]
        shares = [sum(some) for some in of_kind]
        assert shares == sorted(shares, reverse=True)
        assert found.mixture[0][1].motion.name == names[0]
        assert sum(share for share, _ in found.mixture) == pytest.approx(1)
        mixed = [estimate.motion.name for _, estimate in found.mixture]
        several += len(set(mixed)) < len(mixed)
    assert several


def test_odds_count_as_much_as_bearings() -> None:
    """Ten times the odds against all others are ten times the weight against each."""
    scene = benchmark(np.random.default_rng(7), "S", "C", 60, 3)
    motions = (CONSTANT_VELOCITY, CONSTANT_ACCELERATION, TURN_RATE)
    likelier = (*motions[:2], TURN_RATE._replace(odds=10 * TURN_RATE.odds))
    for one, other in zip(
        solve_many(scene.given, motions=motions),
        solve_many(scene.given, motions=likelier),
        strict=True,
    ):
        before, after = ({c.motion: c.weight for c in s.candidates} for s in (one, other))
        names = [CONSTANT_ACCELERATION.name, TURN_RATE.name]
        ratios = [some[names[1]] / some[names[0]] for some in (before, after)]
        assert ratios[1] == pytest.approx(10 * ratios[0])


@pytest.mark.slow
def test_three_legs_cover() -> None:
    """Of 100; those that chance lets pass for fewer legs are still too sure (one in ten)."""
    scene = ensemble(np.random.default_rng(6), "three legs", 100)
    found = solve_many(scene.given)
    tried = [any(c.motion == "three legs" for c in one.candidates) for one in found]
    covered = [r in one.interval for r, one in zip(scene.range_m.tolist(), found, strict=True)]
    assert np.mean(tried) > 0.85
    assert np.mean(np.array(covered)[tried]) > 0.84
