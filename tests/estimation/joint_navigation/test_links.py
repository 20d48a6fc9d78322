"""Laws of links: a wide prior put in later is one held from the start; the wrong one is named."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.arrays import Array
from estimation.joint_navigation import links
from estimation.joint_navigation.links import errors, links_of, released, with_links
from estimation.joint_navigation.members import CarrierStart, founded, with_carrier
from estimation.joint_navigation.online import (
    SIZES,
    Joint,
    Step,
    carried,
    improved,
    joined,
    without,
)
from estimation.joint_navigation.online_rows import Range, Surroundings, link_of, range_rows

NAMES = ("carrier/a", "carrier/b")
BEACONS = {
    f"beacon/{i}": 3e3 * np.array([np.sin(angle), np.cos(angle), 0.0])
    for i, angle in enumerate(np.radians([10.0, 100.0, 170.0, 260.0]))
}
STARTS = {"carrier/a": np.array([200.0, -300.0]), "carrier/b": np.array([-500.0, 900.0])}
STEP = Step(2.0, np.array([30.0, 10.0]), 0.25 * np.eye(2))
SIGMA_M = 3.0
AGAINST_ALL = "link/carrier/a|beacon/1||two_way"


def group() -> Joint:
    starts = [CarrierStart(STARTS[n] + 20.0, np.diag([30.0, 30.0, 0.0]) ** 2) for n in NAMES]
    return with_carrier(founded(NAMES[0], starts[0]), NAMES[1], starts[1])


def ranges(places: dict[str, Array], rng: np.random.Generator, wrong_m: Array) -> list[Range]:
    """Of both carriers to each other and to all beacons; the errors of the links (9,) with them."""
    told = []
    ends = [(n, b) for n in NAMES for b in BEACONS]
    for (own, peer), off_m in zip([*ends, NAMES], wrong_m, strict=True):
        there = BEACONS[peer][:2] if peer in BEACONS else places[peer]
        exact = float(np.hypot(*(places[own] - there)))
        noise = SIGMA_M * rng.standard_normal()
        told.append(Range(own, peer, "two_way", exact + off_m + noise, SIGMA_M))
    return told


def followed(joint: Joint, wrong_m: Array, seed: int, epochs: int = 12) -> Joint:
    rng, places = np.random.default_rng(seed), dict(STARTS)
    for _ in range(epochs):
        root = np.linalg.cholesky(STEP.covariance)
        joint = carried(joint, [(name, STEP) for name in NAMES])
        places = {n: p + STEP.travel_m + root @ rng.standard_normal(2) for n, p in places.items()}
        heard = ranges(places, rng, wrong_m)
        joint = with_links(joint, heard)
        there = Surroundings(
            dict.fromkeys(NAMES, 0.0), dict.fromkeys(NAMES, STEP.travel_m / 2.0), BEACONS
        )
        joint = released(improved(joint, range_rows(joint, heard, there)).joint)
    return joint


def off(which: int, by_m: float) -> Array:
    wrong = np.zeros(9)
    wrong[which] = by_m
    return wrong


@pytest.mark.parametrize("which", [1, 6, 8])
@pytest.mark.parametrize("by_m", [-40.0, 15.0])
def test_the_wrong_link_is_found_and_its_error_taken_out(which: int, by_m: float) -> None:
    joint = followed(group(), off(which, by_m), seed=which)
    found = errors(joint)
    value, sigma = max(found.values(), key=lambda error: abs(error[0]) / error[1])
    names = [n for n in joint.names if n.startswith("link/")]
    assert abs(value - by_m) < 4 * sigma < 12
    assert found.get(names[which]) == (value, sigma)
    place = joint.mean[joint.first(NAMES[0])] - STARTS[NAMES[0]][0] - 12 * STEP.travel_m[0]
    assert abs(place) < 10


def test_right_links_are_left_alone() -> None:
    """One link in a thousand is wrong: of 180 right ones none is released here."""
    assert all(errors(followed(group(), np.zeros(9), seed)) == {} for seed in range(20))


def test_two_links_that_contradict_each_other_are_both_in_doubt() -> None:
    """Nobody else can tell which: a carrier whose place is known, ranged by one that is not."""
    rng = np.random.default_rng(3)
    joint = founded("carrier/a", CarrierStart(np.zeros(2), np.diag([30.0, 30.0, 0.0]) ** 2))
    east = {f"beacon/{i}": np.array([3e3 * sign, 0.0, 0.0]) for i, sign in enumerate((1.0, -1.0))}
    for _ in range(10):
        heard = [
            Range("carrier/a", name, "two_way", 3e3 + 80 * i + rng.standard_normal(), SIGMA_M)
            for i, name in enumerate(east)
        ]
        joint = with_links(joint, heard)
        there = Surroundings({"carrier/a": 0.0}, {"carrier/a": np.zeros(2)}, east)
        joint = released(improved(joint, range_rows(joint, heard, there)).joint)
    assert len(errors(joint)) == 2
    sigma = np.sqrt(joint.of([joint.first("carrier/a")])[0, 0])
    assert 25 < sigma < 35  # what was known before


def test_a_wide_prior_put_in_later_is_one_that_was_there_from_the_start() -> None:
    """Exact where all is linear: rows of a place far away."""
    wrong, name = off(1, 12.0), AGAINST_ALL
    narrow = joined_link(group(), name, links._SPIKE_M)
    wide = joined_link(group(), name, links._SLAB_M)
    rng = np.random.default_rng(1)
    heard = ranges(STARTS, rng, wrong)
    there = Surroundings(
        dict.fromkeys(NAMES, 0.0),
        dict.fromkeys(NAMES, np.zeros(2)),
        {b: 1e4 * p for b, p in BEACONS.items()},
    )
    far = []
    for log in heard[:-1]:
        exact = float(np.hypot(*(STARTS[log.carrier] - 1e4 * BEACONS[log.peer][:2])))
        far.append(log._replace(value_m=exact + 9.0))
    joint = improved(narrow, range_rows(narrow, far, there)).joint
    late = links._widened(joint, joint.first(name))
    soon = improved(wide, range_rows(wide, far, there)).joint
    assert late.mean == pytest.approx(soon.mean, abs=1e-3)
    assert late.covariance == pytest.approx(soon.covariance, rel=1e-4, abs=1e-3)


def joined_link(joint: Joint, name: str, sigma_m: float) -> Joint:
    nothing = np.zeros((SIZES["link"], len(joint.mean)))
    return joined(joint, name, np.zeros(1), nothing, np.array([[sigma_m**2]]))


def test_who_leaves_takes_along_its_links() -> None:
    joint = followed(group(), np.zeros(9), seed=1, epochs=1)
    mine = links_of(joint, "carrier/b")
    assert len(mine) == 5
    assert not set(mine) & set(without(joint, mine).names)
    assert link_of(Range("carrier/a", "beacon/1", "two_way", 1.0, 1.0)) == AGAINST_ALL
