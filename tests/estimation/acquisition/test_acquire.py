"""Laws of the acquisition: symmetries, constraints, clues, and honesty where nothing is sure."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest

from bench.registration.unknown_pairs import NOBODY, Layout, Scene, scene, square
from estimation.acquisition import (
    Acquisition,
    Clues,
    Constraints,
    Settings,
    Velocities,
    acquire,
    acquire_blind,
    constraints,
    unknown_frame,
)
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import polar_from_east_north, rotation_clockwise, wrap_pi
from estimation.relative_frame import PolarLogs, RelativeFramePrior, adjustment

DEG = np.pi / 180
TWENTY = Layout(20, 14)


def pairs(found: Acquisition) -> set[tuple[int, int]]:
    best = found.modes[0]
    return set(zip(best.own.tolist(), best.other.tolist(), strict=True))


def true_pairs(drawn: Scene) -> set[tuple[int, int]]:
    return {(i, int(j)) for i, j in enumerate(drawn.partner) if j != NOBODY}


def logs(place: Array, bearing_off_rad: float = 0.0) -> PolarLogs:
    bearing, ranges = polar_from_east_north(place)
    return PolarLogs.from_sigmas(bearing - bearing_off_rad, ranges, 0.5 * DEG, 100.0)


def paper_prior(offset: Array) -> RelativeFramePrior:
    return RelativeFramePrior.from_sigmas(offset, 1500, 1500, DEG, DEG)


@pytest.fixture(scope="module")
def drawn() -> Scene:
    return scene(np.random.default_rng(11), TWENTY)


@pytest.fixture(scope="module")
def found(drawn: Scene) -> Acquisition:
    return acquire(drawn.own, drawn.other, drawn.prior)


def test_it_finds_the_pairs_and_the_frame(drawn: Scene, found: Acquisition) -> None:
    assert found.status == "acquired"
    assert len(pairs(found) & true_pairs(drawn)) >= 13
    best = found.modes[0]
    error = np.array([*best.frame.q_m, best.frame.D_rad]) - drawn.t
    assert nees(error, best.frame.covariance) < 16.3  # chi-squared of 3 at .999
    assert best.probability > 0.99
    assert "14 pairs" in found.sentence


def test_its_frame_is_the_exact_adjustment_of_its_pairs(drawn: Scene, found: Acquisition) -> None:
    best = found.modes[0]
    exact = adjustment(drawn.own.take(best.own), drawn.other.take(best.other), drawn.prior)
    sigmas = np.sqrt(np.diag(best.frame.covariance))
    apart = np.array([*best.frame.q_m, best.frame.D_rad]) - [
        *exact.own_axes.q_m,
        exact.own_axes.D_rad,
    ]
    # pairs of probability .99 count a little less than whole ones, places are Gaussian
    np.testing.assert_allclose(apart / sigmas, 0, atol=0.1)
    expected = np.sqrt(np.diag(exact.own_axes.covariance))
    np.testing.assert_allclose(sigmas, expected, rtol=0.05)


def test_the_order_of_the_logs_does_not_matter(drawn: Scene, found: Acquisition) -> None:
    rng = np.random.default_rng(12)
    i, j = rng.permutation(20), rng.permutation(20)
    shuffled = acquire(drawn.own.take(i), drawn.other.take(j), drawn.prior)
    assert {(i[a], j[b]) for a, b in pairs(shuffled)} == pairs(found)
    np.testing.assert_allclose(shuffled.modes[0].frame.q_m, found.modes[0].frame.q_m, rtol=1e-9)


def test_the_same_twice_is_the_same(drawn: Scene, found: Acquisition) -> None:
    again = acquire(drawn.own, drawn.other, drawn.prior)
    np.testing.assert_array_equal(again.modes[0].frame.q_m, found.modes[0].frame.q_m)
    assert again.sentence == found.sentence


def test_swapping_the_carriers_inverts_the_frame(drawn: Scene, found: Acquisition) -> None:
    back = RelativeFramePrior.from_sigmas(-drawn.prior.offset_m, 1500, 1500, DEG, DEG)
    swapped = acquire(drawn.other, drawn.own, back)
    assert {(i, j) for j, i in pairs(swapped)} == pairs(found)
    there, here = swapped.modes[0].frame, found.modes[0].frame
    sigma = np.sqrt(np.trace(here.covariance[:2, :2]))
    q = -(rotation_clockwise(-here.D_rad) @ here.q_m)
    np.testing.assert_allclose(there.q_m, q, atol=0.2 * sigma)
    assert there.D_rad == pytest.approx(-here.D_rad, abs=0.2 * np.sqrt(here.covariance[2, 2]))


def test_turning_the_scene_turns_the_offset_and_nothing_else(
    drawn: Scene, found: Acquisition
) -> None:
    turn = 2.0
    own, other = (
        PolarLogs(side.bearing_rad + turn, side.range_m, side.covariance)
        for side in (drawn.own, drawn.other)
    )
    offset = rotation_clockwise(turn) @ drawn.prior.offset_m
    turned = acquire(own, other, paper_prior(offset))
    assert pairs(turned) == pairs(found)
    q = rotation_clockwise(turn) @ found.modes[0].frame.q_m
    np.testing.assert_allclose(turned.modes[0].frame.q_m, q, atol=1.0)
    assert turned.modes[0].frame.D_rad == pytest.approx(found.modes[0].frame.D_rad, abs=1e-5)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_without_any_heading(seed: int) -> None:
    drawn = scene(np.random.default_rng(seed), Layout(20, 14, any_heading=True))
    found = acquire_blind(drawn.own, drawn.other, unknown_frame(15e3))
    assert found.status == "acquired"
    assert len(pairs(found) & true_pairs(drawn)) >= 12
    frame = found.modes[0].frame
    assert wrap_pi(frame.D_rad - drawn.t[2]) == pytest.approx(0, abs=5 * 0.005)


def test_a_wide_heading_is_searched_as_an_unknown_one() -> None:
    drawn = scene(np.random.default_rng(5), Layout(20, 14, sigma_c_rad=40 * DEG))
    found = acquire(drawn.own, drawn.other, drawn.prior)
    assert found.status == "acquired"
    assert len(pairs(found) & true_pairs(drawn)) >= 12


def test_an_operator_overrules(drawn: Scene, found: Acquisition) -> None:
    i, j = min(pairs(found) & true_pairs(drawn))
    elsewhere = next(k for k in range(20) if k not in {b for _, b in pairs(found)})
    bound = acquire(drawn.own, drawn.other, drawn.prior, known=constraints(bind=[(i, elsewhere)]))
    assert all((i, elsewhere) in zip(m.own, m.other, strict=True) for m in bound.modes)
    free = acquire(drawn.own, drawn.other, drawn.prior, known=constraints(forbid=[(i, j)]))
    assert pairs(free) == pairs(found) - {(i, j)}


def row() -> tuple[PolarLogs, PolarLogs, RelativeFramePrior]:
    """Five in a row, of which the other carrier sees the last three: they fit in three ways."""
    place = np.stack([np.arange(5) * 1000.0 - 2500, np.full(5, 9e3)], axis=1)
    offset = np.array([4e3, 1e3])
    return logs(place), logs(place[2:] - offset), paper_prior(offset - np.array([1000.0, 0.0]))


def test_unique_identities_are_hard() -> None:
    """Pictures that lie upon each other in three ways; one name on each side tells which."""
    own, other, prior = row()
    assert acquire(own, other, prior).status == "ambiguous"
    for k in range(3):
        named = acquire(own, other, prior, known=constraints([None] * k + ["K7"], ["K7"]))
        assert pairs(named) == {(k, 0), (k + 1, 1), (k + 2, 2)}
        assert named.modes[0].probability > 0.99


def test_constraints_say_what_contradicts() -> None:
    with pytest.raises(ValueError, match="bound and forbidden at once"):
        constraints(bind=[(1, 2)], forbid=[(1, 2)])
    with pytest.raises(ValueError, match="bound to one other log only"):
        constraints(bind=[(1, 2), (1, 3)])
    known = constraints(["a", "b", "b", None], ["b", "a"], bind=[(3, 0)])
    assert known == Constraints(frozenset({(3, 0), (0, 1)}), frozenset({(1, 1), (2, 1)}))
    twice = constraints(["b", "b"], ["b"])  # which of the two? Neither is bound
    assert twice == Constraints()


def test_features_settle_what_places_leave_open() -> None:
    own, other, prior = row()
    unsure = acquire(own, other, prior)
    assert unsure.status == "ambiguous"
    same = np.arange(5)[:, None] == np.arange(3)[None, :] + 2
    ratio = np.where(same, 2.0, -2.0)
    by_matrix = acquire(own, other, prior, Clues(log_ratio=ratio))
    assert by_matrix.modes[0].probability > 0.99
    assert pairs(by_matrix) == {(2, 0), (3, 1), (4, 2)}
    by_function = acquire(own, other, prior, Clues(log_ratio=lambda i, j: ratio[i, j]))
    assert by_function.modes[0].probability == by_matrix.modes[0].probability


def test_velocities_turn_with_the_frame_and_settle_it_as_well() -> None:
    own, other, prior = row()
    turn = 2 * DEG
    rates = np.random.default_rng(3).normal(0, 10, (5, 2))
    spread = 0.5 * np.eye(2)
    other = PolarLogs(other.bearing_rad - turn, other.range_m, other.covariance)
    clues = Clues(
        Velocities(rates, np.tile(spread, (5, 1, 1))),
        Velocities(rates[2:] @ rotation_clockwise(-turn).T, np.tile(spread, (3, 1, 1))),
    )
    found = acquire(own, other, prior, clues)
    assert pairs(found) == {(2, 0), (3, 1), (4, 2)}
    assert found.modes[0].probability > 0.99
    rates[2] = np.nan  # not every track has one
    assert acquire(own, other, prior, clues).modes[0].probability > 0.9


def test_two_targets_side_by_side_tell_no_unknown_heading() -> None:
    place = np.array([[5e3, 5e3], [5.1e3, 5e3]])
    found = acquire_blind(logs(place), logs(place), unknown_frame(15e3))
    assert found.status != "acquired"
    assert found.sentence


def test_one_bound_pair_tells_no_unknown_heading() -> None:
    place = np.array([[5e3, 5e3]])
    found = acquire_blind(
        logs(place), logs(place), unknown_frame(15e3), known=constraints(bind=[(0, 0)])
    )
    assert (found.status, found.nothing_probability) == ("undetermined", 0.0)
    assert found.directions[0].status == "undetermined"
    assert found.modes[0].frame.covariance[2, 2] < np.pi**2  # no wider than the circle
    free = acquire_blind(logs(place), logs(place), unknown_frame(15e3))
    assert free.status == "nothing"


def test_with_three_hundred_targets_it_still_answers() -> None:
    drawn = scene(np.random.default_rng(21), Layout(300, 200))
    found = acquire(drawn.own, drawn.other, drawn.prior)
    assert found.status == "acquired"
    assert len(pairs(found) & true_pairs(drawn)) > 150


EMPTY = PolarLogs.from_sigmas([], [], 1.0, 1.0)


@pytest.mark.parametrize("blind", [False, True])
def test_no_logs_at_all(blind: bool) -> None:
    some = logs(np.array([[1e3, 2e3]]))
    for own, other, word in ((EMPTY, EMPTY, "own"), (some, EMPTY, "other"), (EMPTY, some, "own")):
        found = (
            acquire_blind(own, other, unknown_frame(15e3))
            if blind
            else acquire(own, other, paper_prior(np.zeros(2)))
        )
        assert (found.status, found.modes, found.nothing_probability) == ("nothing", (), 1.0)
        assert found.sentence == f"the {word} carrier has no target log"


def test_one_target_cannot_tell_the_orientation() -> None:
    offset = np.array([4e3, 1e3])
    place = np.array([[9e3, 7e3]])
    found = acquire(logs(place), logs(place - offset), paper_prior(offset))
    assert found.status in {"undetermined", "ambiguous"}
    assert found.directions[0].status == "undetermined"
    certain = acquire(
        logs(place), logs(place - offset), paper_prior(offset), known=constraints(bind=[(0, 0)])
    )
    assert certain.status == "undetermined"
    assert "orientation is undetermined" in certain.sentence


def test_one_target_each_far_apart_is_nothing() -> None:
    place = np.array([[9e3, 7e3]])
    found = acquire(logs(place), logs(-place), paper_prior(np.zeros(2)))
    assert found.status == "nothing"
    assert found.modes == ()


def test_a_tight_cluster_does_not_determine_the_orientation() -> None:
    rng = np.random.default_rng(8)
    offset, place = np.array([4e3, 1e3]), rng.normal([9e3, 7e3], 60, (4, 2))
    found = acquire(logs(place), logs(place - offset), paper_prior(offset))
    assert found.status in {"undetermined", "ambiguous"}
    assert (found.modes[0].pair_probability < 0.9).all()  # nobody can say who is who in there


def test_targets_on_one_spot_and_a_prior_without_error() -> None:
    place = np.tile([[3e3, 4e3]], (3, 1))
    sure = RelativeFramePrior.from_sigmas((1e3, 0.0), 0, 0, 0, 0)
    found = acquire(logs(place), logs(place - [1e3, 0.0]), sure)
    assert np.isfinite([m.probability for m in found.modes]).all()
    np.testing.assert_allclose(found.modes[0].frame.q_m, [1e3, 0.0], atol=1.0)


def test_regular_pictures_are_ambiguous_and_say_so() -> None:
    """A grid fits itself in many ways; none may be trusted."""
    x, y = np.meshgrid(np.arange(4) * 1500.0, np.arange(4) * 1500.0)
    place = np.stack([x.ravel() + 2e3, y.ravel() + 3e3], axis=1)
    found = acquire_blind(logs(place), logs(place - [3e3, 5e3], 1.0), unknown_frame(15e3))
    assert found.status in {"ambiguous", "nothing"}
    assert found.modes[0].probability < 0.9
    assert "ways" in found.sentence or "no target" in found.sentence


def test_unrelated_pictures_are_not_trusted() -> None:
    rng = np.random.default_rng(9)
    for _ in range(5):
        own, other = logs(square(rng, 10)), logs(square(rng, 10))
        found = acquire(own, other, paper_prior(square(rng, 1)[0]))
        assert found.status in {"nothing", "ambiguous"}


def test_probabilities_are_a_distribution(found: Acquisition) -> None:
    total = found.nothing_probability + sum(m.probability for m in found.modes)
    assert total == pytest.approx(1.0)
    ordered = [m.probability for m in found.modes]
    assert ordered == sorted(ordered, reverse=True)
    for mode in found.modes:
        assert ((mode.pair_probability >= 0) & (mode.pair_probability <= 1 + 1e-9)).all()


def test_trust_is_a_setting(drawn: Scene) -> None:
    doubting = acquire(drawn.own, drawn.other, drawn.prior, settings=Settings(trust=1.0))
    assert doubting.status == "ambiguous"


@pytest.mark.parametrize("variance", [1e-300, 1e-12, 1.0, 1e12, 1e300])
@pytest.mark.parametrize("spread_m", [1e-6, 1e4, 1e8, 1e150, 1e300])
def test_numbers_beyond_reason_are_refused_or_no_mode(spread_m: float, variance: float) -> None:
    """Evidence that is no number is no evidence, whatever was given."""
    place = np.random.default_rng(5).uniform(-spread_m, spread_m, (6, 2))
    with np.errstate(all="ignore"):
        logs = PolarLogs.from_east_north(place, np.full((6, 2, 2), np.eye(2) * variance))
        for sigma_m, sigma_rad in ((1e-150, 1e-150), (1e3, 0.02), (1e8, 3.0), (1e150, 1e3)):
            prior = RelativeFramePrior(np.zeros(2), np.eye(2) * sigma_m**2, sigma_rad, sigma_rad)
            with suppress(np.linalg.LinAlgError, ValueError):
                found = acquire(logs, logs, prior)
                assert np.isfinite([mode.probability for mode in found.modes]).all()
