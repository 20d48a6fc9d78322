"""Laws of the online joint state: it is the solution over all that was said, epoch by epoch."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from bench.navigation.online import online, solved, truth_of
from bench.navigation.together import scene
from estimation.arrays import Array
from estimation.consistency import nees
from estimation.frames import rotation_clockwise
from estimation.joint_navigation.members import (
    CarrierStart,
    Sighting,
    founded,
    with_beacon,
    with_carrier,
    with_source,
    with_target,
)
from estimation.joint_navigation.online import (
    CLOCK,
    CLOCK_DRIFT,
    CURRENT,
    GAUGE,
    HEADING,
    LOG_TIME,
    NORTH,
    RATE,
    STAMP,
    STAMP_DRIFT,
    TIME,
    Improved,
    Joint,
    Step,
    carried,
    improved,
    part,
    velocity_mps,
    without,
)
from estimation.joint_navigation.online_rows import (
    Range,
    Surroundings,
    fix_rows,
    log_rows,
    range_rows,
)
from estimation.joint_navigation.waiting import Believed, believed, waiting_for

ONE, TWO, RADAR, MARK = "carrier/one", "carrier/two", "source/two/radar", "beacon/mark"
TARGET = "target/t"
PLACES = {ONE: np.array([3000.0, -1000.0]), TWO: np.array([-2000.0, 4000.0])}
SPEEDS = {ONE: np.array([20.0, 5.0]), TWO: np.array([-10.0, 12.0])}
THERE = Surroundings(dict.fromkeys(PLACES, 0.0), SPEEDS, {MARK: np.zeros(3)})
SIGMA = np.diag([200.0, 200.0, 0.02]) ** 2


def start(place_m: Array, covariance: Array = SIGMA) -> CarrierStart:
    return CarrierStart(
        place_m, covariance, current_mps=0.5, clock_m=100.0, clock_drift_mps=0.1, stamp_s=0.5
    )


def two_carriers() -> Joint:
    joint = with_carrier(founded(ONE, start(PLACES[ONE])), TWO, start(PLACES[TWO]))
    return with_source(joint, RADAR, np.array([20.0, 1e-3, 1e-3, 0.1, 0.0]))


def sighting(carrier: str = TWO, seen_m: tuple[float, float] = (9000.0, 2000.0)) -> Sighting:
    covariance = np.array([[900.0, 100.0], [100.0, 4e3]])
    return Sighting(TARGET, carrier, RADAR, np.array(seen_m), covariance, -0.5, SPEEDS[carrier])


def ranges_of() -> list[Range]:
    far = float(np.linalg.norm(PLACES[ONE] - PLACES[TWO]))
    return [
        Range(ONE, TWO, "two_way", far + 3, 5.0),
        Range(TWO, MARK, "pseudorange", float(np.linalg.norm(PLACES[TWO])) - 4, 5.0),
        Range(ONE, TWO, "difference", far - float(np.linalg.norm(PLACES[ONE])), 7.0, MARK),
        Range(TWO, ONE, "pseudorange", far + 2, 5.0),
    ]


@pytest.mark.parametrize("seed", [1, 2])
def test_it_ends_where_the_solution_over_the_whole_history_ends(seed: int) -> None:
    """Within half a sigma, and it claims the same: what is lost by linearising once."""
    group, truth = scene(np.random.default_rng([seed, 40]))
    mine, whole = online(group), solved(group)
    sigma = np.sqrt(np.diag(whole.covariance))
    assert np.all(np.abs(mine.value - whole.value) < 0.5 * sigma)
    assert np.sqrt(np.diag(mine.covariance)) == pytest.approx(sigma, rel=0.03)
    error = mine.value - truth_of(truth)
    assert nees(error, mine.covariance) < 33  # chi2 of 11, one in two thousand


def all_at_once(joint: Joint) -> Improved:
    return improved(joint, range_rows(joint, ranges_of(), THERE))


def test_a_measurement_never_raises_a_sigma() -> None:
    joint = with_target(two_carriers(), sighting(), 300.0)
    after = [joint, all_at_once(joint).joint]
    after.append(improved(after[-1], log_rows(after[-1], [sighting()])).joint)
    place = PLACES[ONE] + 30
    after.append(improved(after[-1], fix_rows(after[-1], ONE, place, 900 * np.eye(2))).joint)
    for before, now in pairwise(after):
        larger = np.diag(now.covariance) / np.diag(before.covariance)
        assert np.all(larger <= 1 + 1e-9)
        assert np.any(larger < 0.9)


def test_derivatives_are_those_of_what_is_predicted() -> None:
    """To 3 %: how the whitening of a log changes with the point is left out on purpose."""
    joint = with_beacon(two_carriers(), "beacon/buoy", np.array([500.0, 800.0, 60.0]), np.ones(3))
    joint = with_target(joint, sighting(), 300.0)
    rng = np.random.default_rng(3)
    mean = joint.mean + rng.normal(0, 5e-3, len(joint.mean))
    mean[joint.first(TARGET) + 2 : joint.first(TARGET) + 4] = [150.0, -80.0]
    ranges = [*ranges_of(), Range(ONE, "beacon/buoy", "two_way", 3000.0, 5.0)]
    heights = {ONE: 300.0, TWO: -40.0}
    for rows_at in (
        range_rows(joint, ranges, THERE._replace(height_m=heights)),
        log_rows(joint, [sighting()]),
        fix_rows(joint, TWO, PLACES[TWO], np.array([[100.0, 30.0], [30.0, 50.0]])),
    ):
        rows = rows_at(mean)
        step = 1e-4 * np.maximum(np.abs(mean), 1.0) ** 0.5
        slope = [
            (rows_at(mean - d).residual - rows_at(mean + d).residual) / (2 * d.sum())
            for d in np.diag(step)
        ]
        assert rows.by == pytest.approx(np.array(slope).T, rel=0.03, abs=2e-4)


def turned_by(angle: float) -> tuple[Joint, Improved]:
    """The scene of two carriers, all of it turned."""
    turn = rotation_clockwise(angle)
    joint = founded(ONE, start(turn @ PLACES[ONE]))
    joint = with_carrier(joint, TWO, start(turn @ PLACES[TWO]))
    joint = with_source(joint, RADAR, np.array([20.0, 1e-3, 1e-3, 0.1, 0.0]))
    speeds = {name: turn @ speed for name, speed in SPEEDS.items()}
    there = THERE._replace(velocity_mps=speeds)
    log = sighting()
    log = log._replace(
        seen_m=turn @ log.seen_m,
        covariance=turn @ log.covariance @ turn.T,
        carrier_mps=speeds[TWO],
    )
    joint = with_target(joint, log, 300.0)
    joint = carried(joint, [(TWO, Step(2.0, turn @ np.array([20.0, 7.0]), 0.5 * np.eye(2)))])
    joint = improved(joint, range_rows(joint, ranges_of(), there)).joint
    return joint, improved(joint, log_rows(joint, [log]))


def test_turning_the_scene_turns_the_places_and_nothing_else() -> None:
    (_, plain), (_, other) = turned_by(0.0), turned_by(1.1)
    turn = rotation_clockwise(1.1)
    for name in (ONE, TWO, TARGET):
        at = plain.joint.first(name)
        assert other.joint.mean[at : at + 2] == pytest.approx(
            turn @ plain.joint.mean[at : at + 2], abs=1e-6
        )
    first = plain.joint.first(TWO)
    kept = [first + HEADING, first + CLOCK, plain.joint.first(RADAR) + LOG_TIME]
    assert other.joint.mean[kept] == pytest.approx(plain.joint.mean[kept], abs=1e-9)
    assert other.joint.of(kept) == pytest.approx(plain.joint.of(kept), rel=1e-6, abs=1e-12)


def test_ranges_to_one_beacon_say_nothing_of_the_gauge() -> None:
    """A turn of all about it changes nothing; in true axes an eighth of the sigma would go."""
    joint = two_carriers()
    before = joint.of([NORTH])[0, 0]
    for _ in range(50):
        joint = all_at_once(joint).joint
    assert joint.of([NORTH])[0, 0] == pytest.approx(before, rel=1e-3)


def test_a_second_beacon_tells_the_north() -> None:
    joint = two_carriers()
    there = THERE._replace(surveyed_m={MARK: np.zeros(3), "beacon/far": np.array([0.0, 2e4, 0.0])})
    far = [
        Range(c, b, "two_way", float(np.linalg.norm(PLACES[c] - p[:2])), 5.0)
        for c in PLACES
        for b, p in there.surveyed_m.items()
    ]
    for _ in range(4):
        joint = improved(joint, range_rows(joint, far, there)).joint
    assert joint.of([NORTH])[0, 0] < 0.02**2


def test_a_new_life_begins_as_its_own_word_has_it() -> None:
    """Whatever was learnt before: in true axes its place, north and clock are as it states."""
    joint = all_at_once(two_carriers()).joint
    joint = joint._replace(mean=joint.mean + np.eye(len(joint.mean))[NORTH] * 0.01)
    again = with_carrier(without(joint, [TWO]), TWO, start(PLACES[TWO]))
    at, turn = again.first(TWO), rotation_clockwise(again.mean[NORTH])
    assert turn @ again.mean[at : at + 2] == pytest.approx(PLACES[TWO])
    assert again.mean[at + HEADING] + again.mean[NORTH] == pytest.approx(0.0)
    by = np.array([1.0, 1.0])
    heading = by @ again.of([at + HEADING, NORTH]) @ by
    assert heading == pytest.approx(0.02**2)
    assert again.covariance == pytest.approx(again.covariance.T)


def test_stated_ties_of_place_and_north_are_kept_by_founders_and_others() -> None:
    """A pose off east by as much as its north is off: learning the north moves the place."""
    stated = SIGMA.copy()
    stated[0, 2] = stated[2, 0] = 0.9 * 200 * 0.02
    near = np.array([1e-9, 0.0])
    one = founded(ONE, start(near, stated))
    assert one.between([one.first(ONE)], [NORTH])[0, 0] == pytest.approx(-3.6)
    two = with_carrier(founded(ONE, start(near)), TWO, start(near, stated))
    at = two.first(TWO)
    assert two.between([at], [at + HEADING])[0, 0] == pytest.approx(-3.6)


def test_what_leaves_takes_nothing_along_and_a_part_is_a_part() -> None:
    joint = all_at_once(with_target(two_carriers(), sighting(), 300.0)).joint
    left = without(joint, [TARGET, TWO])
    assert left.names == (GAUGE, ONE, RADAR)
    slots = [joint.first(ONE) + i for i in range(12)]
    assert left.of([left.first(ONE) + i for i in range(12)]) == pytest.approx(joint.of(slots))
    alone = part(joint, [GAUGE, ONE])
    assert alone.mean == pytest.approx(joint.mean[: len(alone.mean)])
    assert alone.of([alone.first(ONE) + i for i in range(12)]) == pytest.approx(joint.of(slots))


def test_a_way_without_errors_of_a_known_carrier_is_followed_exactly() -> None:
    sure = CarrierStart(np.ones(2), np.diag([1e-6, 1e-6, 0.0]) ** 2)
    known = CarrierStart(np.zeros(2), np.diag([1e-6, 1e-6, 1e-4]) ** 2, current_mps=1e-6)
    joint = with_carrier(founded(ONE, sure), TWO, known)
    for _ in range(10):
        joint = carried(joint, [(TWO, Step(1.0, np.array([3.0, 4.0]), 1e-12 * np.eye(2)))])
    at = joint.first(TWO)
    assert joint.mean[at : at + 2] == pytest.approx([30.0, 40.0])
    assert velocity_mps(joint, TWO, np.array([3.0, 4.0])) == pytest.approx([3.0, 4.0])
    assert joint.of([at])[0, 0] == pytest.approx((40 * 1e-4) ** 2, rel=1e-2)  # by the north
    assert np.all(joint.of([at + CURRENT.start]) > 0)


@pytest.mark.parametrize("late_m", [60.0, 300.0, 5000.0])
def test_a_late_range_hardly_moves_what_is_known(late_m: float) -> None:
    joint = two_carriers()
    for _ in range(20):
        joint = all_at_once(joint).joint
    wrong = [r._replace(value_m=r.value_m + late_m * (i == 1)) for i, r in enumerate(ranges_of())]
    after = improved(joint, range_rows(joint, wrong, THERE))
    assert after.refused.tolist() == [False, True, False, False]
    at = joint.first(TWO)
    moved = np.abs(after.joint.mean - joint.mean)[at : at + 2]
    assert np.all(moved < np.sqrt(np.diag(joint.of([at, at + 1]))))
    chi2, dof = after.misclosure(range(4))
    assert dof == 3
    assert chi2 < 16


def test_a_log_is_late_by_both_clocks() -> None:
    """A target seen to move 200 m/s east lies 100 m further on when the stamp is half a second."""
    joint = two_carriers()
    at, source = joint.first(TWO), joint.first(RADAR)
    log = sighting()._replace(after_s=0.0, carrier_mps=np.zeros(2))
    joint = with_target(joint, log, 300.0)
    mean, first = joint.mean.copy(), joint.first(TARGET)
    mean[first + 2] = 200.0
    still = log_rows(joint, [log])(mean).residual
    mean[at + 11], mean[source + LOG_TIME] = 0.3, 0.2
    mean[first] += 100.0
    assert log_rows(joint, [log])(mean).residual == pytest.approx(still, abs=1e-6)


# detours, while nothing is known yet


def said(joint: Joint, *late_m: float) -> tuple[Joint, list[Believed]]:
    """A group that hears one link so often, with exact ranges but for what is added to them."""
    exact, told = float(np.linalg.norm(PLACES[TWO])) + 150.0, []
    for i, late in enumerate(late_m):
        ranges = [Range(TWO, MARK, "two_way", exact + late, 5.0)]
        told.append(believed(joint, i * 10**9, ranges, range_rows(joint, ranges, THERE)))
        joint = told[-1].joint
    return joint, told


def place_of(joint: Joint) -> Array:
    first = joint.first(TWO)
    return joint.mean[first : first + 2]


def test_one_range_alone_waits_and_two_that_agree_are_both_taken() -> None:
    joint = two_carriers()
    first, told = said(joint, 0.0)
    assert told[0].waits.tolist() == [True]
    assert first.mean[: len(joint.mean)] == pytest.approx(joint.mean)
    both, told = said(joint, 0.0, 1.0)
    assert told[1].waits.tolist() == [False]
    assert both.names == joint.names
    at_once = joint
    for _ in range(2):
        ranges = [Range(TWO, MARK, "two_way", float(np.linalg.norm(PLACES[TWO])) + 150.5, 5.0)]
        at_once = improved(at_once, range_rows(at_once, ranges, THERE)).joint
    sigma = np.sqrt(np.diag(at_once.of([at_once.first(TWO), at_once.first(TWO) + 1])))
    assert place_of(both) == pytest.approx(place_of(at_once), abs=0.05 * sigma.min())
    assert np.diag(both.covariance) == pytest.approx(np.diag(at_once.covariance), rel=0.02)


@pytest.mark.parametrize("late_m", [60.0, 300.0])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_of_three_ranges_the_one_by_a_detour_is_left_out(which: int, late_m: float) -> None:
    """Wherever it stands, though each of the three alone would have been believed."""
    joint = two_carriers()
    late = [late_m * (i == which) for i in range(3)]
    clean, _ = said(joint, 0.0, 0.0)
    after, told = said(joint, *late)
    assert after.names == joint.names
    assert not told[2].waits.any()
    assert np.linalg.norm(place_of(after)) == pytest.approx(np.linalg.norm(place_of(clean)), abs=5)


def test_what_nothing_bears_out_is_decided_in_the_end_and_leaves_with_its_carrier() -> None:
    joint, _ = said(two_carriers(), 0.0)
    assert waiting_for(joint, TWO) == list(joint.names[-1:])
    assert waiting_for(joint, ONE) == []
    ranges = [Range(ONE, MARK, "two_way", float(np.linalg.norm(PLACES[ONE])), 5.0)]
    later = believed(joint, 31 * 10**9, ranges, range_rows(joint, ranges, THERE))
    assert waiting_for(later.joint, TWO) == []
    assert np.linalg.norm(place_of(later.joint)) > np.linalg.norm(PLACES[TWO]) + 100
    assert later.taken.refused.tolist() == [True, False]
    assert later.waits.tolist() == [True]


def test_many_ranges_of_one_link_at_one_instant_are_borne() -> None:
    joint, exact = two_carriers(), float(np.linalg.norm(PLACES[TWO]))
    ranges = [Range(TWO, MARK, "two_way", exact + i % 3, 5.0) for i in range(40)]
    after = believed(joint, 0, ranges, range_rows(joint, ranges, THERE))
    assert not after.taken.refused.any()


# clocks that drift

CLOCKED = start(PLACES[TWO])._replace(stamp_drift=2e-5)


def gone_on(joint: Joint, seconds: float, *carriers: str) -> Joint:
    step = Step(seconds, np.zeros(2), np.zeros((2, 2)))
    return carried(joint, [(name, step) for name in carriers])


def clocks_of(joint: Joint) -> tuple[Array, Array]:
    """Of the gauge and of the second carrier: time and rate, stamp and drift."""
    first = joint.first(TWO)
    slots = [TIME, RATE, first + STAMP, first + STAMP_DRIFT]
    return joint.mean[slots], joint.of(slots)


@pytest.mark.parametrize("founder_drift", [0.0, 1e-5])
def test_a_clock_is_as_sure_whether_its_carrier_joins_early_or_late(founder_drift: float) -> None:
    joint = founded(ONE, start(PLACES[ONE])._replace(stamp_drift=founder_drift))
    early = gone_on(with_carrier(joint, TWO, CLOCKED), 1800.0, ONE, TWO)
    late = with_carrier(gone_on(joint, 1800.0, ONE), TWO, CLOCKED._replace(since_s=1800.0))
    for one, other in zip(clocks_of(early), clocks_of(late), strict=True):
        assert one == pytest.approx(other, rel=1e-12, abs=1e-18)
    parted = np.hypot(2e-5, founder_drift) * 1800
    assert clocks_of(early)[1][2, 2] == pytest.approx(0.5**2 + 0.5**2 + parted**2)


def test_what_is_known_of_the_founders_clock_is_known_of_those_who_join() -> None:
    """Its stamp is counted from the founder's, whatever has been learned of that."""
    founder = start(PLACES[ONE])._replace(stamp_drift=1e-5)
    joint = with_carrier(founded(ONE, founder), TWO, CLOCKED)
    joint = joint._replace(mean=joint.mean.copy())
    joint.mean[[TIME, RATE]] = 0.2, 3e-5
    third = with_carrier(joint, "carrier/three", CLOCKED._replace(since_s=600.0))
    at = third.first("carrier/three")
    assert third.mean[at + STAMP] == pytest.approx(-0.2 - 600 * 3e-5)
    assert third.mean[at + STAMP_DRIFT] == pytest.approx(-3e-5)


@pytest.mark.parametrize("which", [(CLOCK, CLOCK_DRIFT), (STAMP, STAMP_DRIFT)])
def test_a_clock_that_is_right_at_first_does_not_stay_so(which: tuple[int, int]) -> None:
    right = CarrierStart(PLACES[TWO], SIGMA, clock_drift_mps=0.1, stamp_drift=2e-5)
    joint = with_carrier(founded(ONE, start(PLACES[ONE])._replace(stamp_s=0.0)), TWO, right)
    after = gone_on(joint, 100.0, ONE, TWO)
    first = after.first(TWO)
    now, drift = (np.sqrt(after.of([first + slot])[0, 0]) for slot in which)
    assert now == pytest.approx(100 * drift)
    assert drift > 0
