"""The group's pieces: heights on a round Earth, fixes, who has the word, who begins anew."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from bench.in_process import Played, played
from estimation.frames import Site, on_surface, site_at, target_from_source
from estimation.joint_navigation.online import NORTH
from estimation.joint_navigation.waiting import waiting_for
from fusion_center.group import chosen, frames
from fusion_center.group.axes import CARRIER, Whereabouts, is_heard
from fusion_center.group.joining import joint_of, left, takes_part
from fusion_center.group.ranging import finite, with_fix, with_ranges
from fusion_center.sources.news import NOTHING_TOLD
from fusion_center.state import Group, Link, Monitor, State
from schemas.messages import Navigation, Ranging
from sim_world.scenario import load_scenario, with_overrides

SCENARIO = with_overrides(
    load_scenario(Path(__file__).parents[2] / "scenarios" / "group.toml"),
    {f"carriers.{name}.errors.clock_s": 0.0 for name in ("one", "two", "three")},
)
ORIGIN = Site(0.8, 0.5)


@pytest.fixture(scope="module")
def played_on() -> Played:
    *_, last = played(SCENARIO, steps=30)
    return last


@pytest.fixture
def state(played_on: Played) -> State:
    return played_on.state


def group_of(state: State) -> Group:
    assert state.group is not None
    return state.group


def test_heights_follow_the_curve_of_the_earth() -> None:
    reported = site_at(ORIGIN, on_surface(ORIGIN, 60_000.0, -20_000.0, 8000.0))
    at = Whereabouts(target_from_source(ORIGIN, reported), np.zeros(2), np.zeros(2))
    true = on_surface(ORIGIN, 60_600.0, -20_300.0, 8000.0)
    assert abs(at.place_m[2] - true[2]) > 4
    assert at.height_m(true[:2]) == pytest.approx(true[2], abs=0.1)


def sigma_m(group: Group, carrier: str) -> float:
    joint = joint_of(group)
    at = joint.first(CARRIER + carrier)
    return float(np.sqrt(np.trace(joint.of([at, at + 1]))))


def fixed(last: Played) -> State:
    """The state with a carrier that now reports where it truly is."""
    truth, state = last.carriers, last.state
    origin = state.scenario.origin
    there = Site(origin.latitude_rad, origin.longitude_rad)
    true = site_at(there, truth.position_m[truth.carrier.index("two")])
    known = state.carriers["two"]
    newest = known.navigation[-1]
    pose = replace(
        newest.pose,
        latitude_rad=true.latitude_rad,
        longitude_rad=true.longitude_rad,
        covariance=[1.0, 0.0, 0.0, 1.0, 0.0, 1e-6],
    )
    sure = replace(known, navigation=(replace(newest, pose=pose),))
    return replace(state, carriers={**state.carriers, "two": sure})


def fix(state: State, after_s: float, correlation_s: float) -> Navigation:
    newest = state.carriers["two"].navigation[-1]
    t_ns = group_of(state).members["two"].fixed_t_ns + round(after_s * 1e9)
    return replace(
        newest, kind="fix", pose=newest.pose, t_ns=t_ns, correlation_time_s=correlation_s
    )


def test_a_fix_counts_once_in_its_correlation_time(played_on: Played) -> None:
    """In turned axes it tells the gauge's north."""
    state = fixed(played_on)
    group = group_of(state)
    assert with_fix(state, group, fix(state, 20, 60)) is group
    taken = with_fix(state, group, fix(state, 29, 29))
    assert joint_of(taken).of([NORTH])[0, 0] < 0.7 * joint_of(group).of([NORTH])[0, 0]
    assert with_fix(state, taken, fix(state, 20, 29)) is taken


def test_fixes_whose_error_is_constant_say_no_more_than_the_first_pose(played_on: Played) -> None:
    state = fixed(played_on)
    assert with_fix(state, group_of(state), fix(state, 1000, 0)) is group_of(state)


def wrong_ranges(state: State, off_m: float) -> list[Ranging]:
    newest = state.carriers["three"].navigation[-1]
    return [
        Ranging(
            carrier="three",
            boot="b1",
            stream="ranging",
            seq=1,
            t_ns=newest.t_ns,
            peer=peer,
            kind="two_way",
            value_m=off_m,
            sigma_m=5.0,
        )
        for peer in ("mark", "one", "two")
    ]


def test_a_carrier_whose_ranges_contradict_its_place_begins_anew(state: State) -> None:
    """Ten times as far as it is: the seventh in a row is one too many; nobody else is touched."""
    t_ns = state.carriers["three"].navigation[-1].t_ns
    for count in range(1, 8):
        assert "three" in group_of(state).members, count
        state, _ = with_ranges(state, group_of(state), t_ns, wrong_ranges(state, 1e5)[:1])
    assert sorted(group_of(state).members) == ["one", "two"]
    assert all(member.refused == 0 for member in group_of(state).members.values())


def test_who_leaves_takes_along_the_ranges_that_wait() -> None:
    *_, last = played(SCENARIO, steps=3)
    group = group_of(last.state)
    mine = waiting_for(joint_of(group), "carrier/three")
    others = set(waiting_for(joint_of(group), "carrier/one")) - set(mine)
    assert len(mine) >= 2
    assert others
    after = group_of(left(last.state, ["three"]))
    assert not set(mine) & set(after.names)
    assert others <= set(after.names)
    assert sum(member.refused for member in group.members.values()) == 0


def test_who_leaves_takes_along_what_its_tracks_have_said(state: State) -> None:
    told = {f"source/{name}/radar": NOTHING_TOLD for name in ("one", "three")}
    tracked = replace(state, group=replace(group_of(state), told=told))
    assert set(group_of(left(tracked, ["three"])).told) == {"source/one/radar"}


def test_one_range_out_of_line_is_borne(state: State) -> None:
    t_ns = state.carriers["three"].navigation[-1].t_ns
    before = sigma_m(group_of(state), "three")
    after, _ = with_ranges(state, group_of(state), t_ns, wrong_ranges(state, 1e5))
    assert group_of(after).members["three"].refused > 0
    assert sigma_m(group_of(after), "three") == pytest.approx(before, rel=0.05)


def test_the_group_has_the_word_once_it_is_sure_or_nobody_else_is(state: State) -> None:
    assert chosen.holding(state, "two") is not None
    member = group_of(state).members["two"]
    unsure = replace(member, monitor=Monitor())
    group = replace(group_of(state), members={**group_of(state).members, "two": unsure})
    without = replace(state, group=group, links={**state.links, "two": Link()})
    assert chosen.holding(without, "two") is not None
    followed = replace(without, links={**state.links, "two": Link(followed=True)})
    assert chosen.holding(followed, "two") is None
    assert chosen.lateness(followed, "two", "radar") == frames.PUNCTUAL
    assert chosen.holding(replace(state, group=None), "two") is None


def test_who_is_silent_or_holds_an_unknown_correction_is_not_placed(state: State) -> None:
    known = state.carriers["two"]
    newest = known.navigation[-1]
    assert is_heard(state, "two", newest.t_ns)
    assert not is_heard(state, "two", newest.t_ns + 31 * 10**9)
    assert not is_heard(state, "nobody", newest.t_ns)
    corrected = replace(known, navigation=(replace(newest, correction_id="x/two/1"),))
    held = replace(state, carriers={**state.carriers, "two": corrected})
    assert not is_heard(held, "two", newest.t_ns)


def test_who_ranges_is_ranged_to_or_is_own_takes_part(state: State) -> None:
    assert all(takes_part(state, name) for name in ("one", "two", "three"))
    assert not takes_part(state, "stranger")
    mute = [replace(c, ranging=[]) for c in state.scenario.carriers]
    silent = replace(state, scenario=replace(state.scenario, carriers=mute))
    assert not takes_part(silent, "one")


def test_a_group_that_all_have_left_is_none(state: State) -> None:
    assert left(state, ["one", "two", "three"]).group is None
    two = left(state, ["three"])
    assert not any("three" in name for name in group_of(two).names)


def test_numbers_that_are_none_are_noticed(state: State) -> None:
    group = group_of(state)
    assert finite(group)
    assert finite(None)
    assert not finite(replace(group, mean=group.mean * np.nan))
    assert not finite(replace(group, covariance=-group.covariance))
