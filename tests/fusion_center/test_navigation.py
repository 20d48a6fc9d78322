"""Where a carrier believes it is between and after its messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from estimation.frames import Site, site_at
from fusion_center.navigation import (
    carried_sigma_m,
    frame_covariance,
    pose_at,
    site,
    velocity_mps,
    way_m,
    with_message,
)
from schemas.messages import DeclaredCarrier, Navigation, Pose

SECOND = 1_000_000_000
HOME = Site(0.7, 0.5)


def said(
    t_s: float, way: tuple[float, float], at: tuple[float, float] | None = None, **more: Any
) -> Navigation:
    """A message after a dead-reckoned way, reporting that place or another."""
    east, north = at or way
    here = site_at(HOME, [east, north, 0.0])
    more.setdefault("pose", Pose(latitude_rad=here.latitude_rad, longitude_rad=here.longitude_rad))
    return Navigation(
        carrier="a",
        boot="x",
        stream="navigation",
        seq=1,
        t_ns=round(t_s * SECOND),
        reckoned_east_m=way[0],
        reckoned_north_m=way[1],
        **more,
    )


TWO = (said(10, (0.0, 0.0)), said(12, (20.0, -8.0)))


@pytest.mark.parametrize("t_s", [10.0, 11.0, 12.0, 15.0])
def test_way_and_pose_go_on_in_a_straight_line(t_s: float) -> None:
    expected = (t_s - 10) * np.array([10.0, -4.0])
    np.testing.assert_allclose(way_m(TWO, round(t_s * SECOND)), expected, atol=1e-9)
    there = site_at(HOME, [*expected, 0.0])
    here = site(pose_at(TWO, round(t_s * SECOND)))
    assert here.latitude_rad == pytest.approx(there.latitude_rad, abs=5e-11)  # 0.3 mm: two planes
    assert here.longitude_rad == pytest.approx(there.longitude_rad, abs=5e-11)


def test_at_a_message_the_pose_is_exactly_the_reported_one() -> None:
    assert pose_at(TWO, TWO[1].t_ns) is TWO[1].pose


def test_ways_of_many_instants_at_once() -> None:
    instants = np.array([10, 11, 14]) * SECOND
    one_by_one = [way_m(TWO, int(t)) for t in instants]
    np.testing.assert_array_equal(way_m(TWO, instants), one_by_one)


def test_a_fix_moves_the_pose_and_not_the_way() -> None:
    fixed = (said(10, (0.0, 0.0)), said(12, (20.0, 0.0), at=(520.0, 300.0)))
    np.testing.assert_allclose(velocity_mps(fixed), [10.0, 0.0])
    np.testing.assert_allclose(way_m(fixed, 13 * SECOND), [30.0, 0.0])
    there = site_at(HOME, [530.0, 300.0, 0.0])
    assert site(pose_at(fixed, 13 * SECOND)).longitude_rad == pytest.approx(
        there.longitude_rad, abs=1e-10
    )


def test_a_first_message_is_carried_on_with_its_speed() -> None:
    pose = Pose(latitude_rad=0.7, longitude_rad=0.5, heading_rad=float(np.pi / 2))
    only = (said(10, (5.0, 5.0), speed_mps=4.0, pose=pose),)
    np.testing.assert_allclose(way_m(only, 12 * SECOND), [13.0, 5.0], atol=1e-9)


def test_two_messages_are_kept_in_the_order_of_their_stamps() -> None:
    first, second, third = said(1, (0, 0)), said(2, (1, 0)), said(3, (2, 0))
    assert with_message((first, second), third) == (second, third)
    assert with_message((second, third), first) == (second, third)
    assert with_message((third,), first) == (first, third)
    again = said(3, (9, 9))
    assert with_message((second, third), again) == (second, again)


def test_being_carried_on_costs_certainty() -> None:
    assert carried_sigma_m(TWO, 12 * SECOND, 0.5) == 0.0
    assert carried_sigma_m(TWO, 16 * SECOND, 0.5) == pytest.approx(0.5 * 4)
    stated = (TWO[0], said(12, (20.0, -8.0), sigma_speed_mps=0.3, sigma_heading_rad=0.04))
    across = 0.04 * np.hypot(10, 4)
    assert carried_sigma_m(stated, 16 * SECOND, 0.5) == pytest.approx(4 * np.hypot(0.3, across))


def test_the_stated_covariance_comes_before_the_declared() -> None:
    declared = DeclaredCarrier(name="a", sigma_position_m=1500.0, sigma_north_rad=0.02)
    plain = Pose(latitude_rad=0.7, longitude_rad=0.5)
    assert frame_covariance(plain, None) is None
    np.testing.assert_allclose(
        frame_covariance(plain, declared), np.diag([1500.0**2, 1500.0**2, 0.02**2])
    )
    three = Pose(latitude_rad=0.7, longitude_rad=0.5, covariance=[9.0, 1.0, 0.0, 4.0, 0.0, 1e-4])
    expected = [[9.0, 1.0, 0.0], [1.0, 4.0, 0.0], [0.0, 0.0, 1e-4]]
    np.testing.assert_array_equal(frame_covariance(three, declared), expected)


def test_of_six_the_level_three_count() -> None:
    full = np.diag([9.0, 4.0, 25.0, 1e-4, 1e-5, 1e-6])
    full[0, 3] = full[3, 0] = 0.01
    triangle = full[np.triu_indices(6)].tolist()
    pose = Pose(latitude_rad=0.7, longitude_rad=0.5, covariance=triangle)
    np.testing.assert_array_equal(
        frame_covariance(pose, None), [[9.0, 0.0, 0.01], [0.0, 4.0, 0.0], [0.01, 0.0, 1e-4]]
    )
