"""Bearings alone in a whole run: no number before there is one, then honest ones, then tracks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.in_process import Played, played
from fusion_center.state import pack, unpack
from schemas import codec
from schemas.messages import BearingLine, Tracks
from sim_world.scenario import Scenario, load_scenario, with_overrides

PASSIVE = load_scenario(Path(__file__).parents[2] / "scenarios" / "passive.toml")
STEP_S = 5
TARGETS = 6


def coarse(**more: Any) -> Scenario:
    """The passive scenario in steps of five seconds, solved every half minute."""
    seldom = {"time.step_s": STEP_S, "fusion.passive.solve_every_s": 30}
    return with_overrides(PASSIVE, seldom | more)


@pytest.fixture(scope="module")
def run() -> list[Played]:
    return list(played(coarse()))


def picture(step: Played) -> Tracks:
    return next(out.message for out in step.outputs if isinstance(out.message, Tracks))


def lines(step: Played) -> dict[str, BearingLine]:
    """By the name of the target."""
    return {line.id.rpartition("/")[2]: line for line in picture(step).lines}


def true_ranges_m(step: Played) -> dict[str, float]:
    """From the own carrier; a distance is the same in every frame."""
    own = np.array(step.carriers.position_m[0])
    apart = np.array(step.targets.position_m) - own
    return dict(zip(step.targets.identity, np.hypot(*apart[:, :2].T).tolist(), strict=True))


def at(run: list[Played], seconds: float) -> Played:
    return run[round(seconds / STEP_S) - 1]


def test_before_a_manoeuvre_there_is_a_line_and_no_number(run: list[Played]) -> None:
    told = lines(at(run, 120))
    assert len(told) == TARGETS
    for line in told.values():
        assert line.status == "undetermined"
        assert line.range_high_m is None
        assert line.position_m is line.velocity_mps is line.covariance is None
    assert not picture(at(run, 120)).tracks


def test_intervals_cover_and_ranges_become_known(run: list[Played]) -> None:
    """Of 95 % intervals of six targets from the first turn on; their errors hang together."""
    covered = []
    for step in run[30:]:
        true = true_ranges_m(step)
        covered += [
            line.range_low_m <= true[name] <= (line.range_high_m or np.inf)
            for name, line in lines(step).items()
            if line.t_ns == step.closed.t_ns
        ]
    assert len(covered) > 50
    assert np.mean(covered) > 0.85
    assert {line.status for line in lines(at(run, 600)).values()} == {"determined"}


def test_what_is_determined_is_a_track_where_the_target_is(run: list[Played]) -> None:
    last = at(run, 600)
    true = true_ranges_m(last)
    assert len(picture(last).tracks) == TARGETS
    for name, line in lines(last).items():
        assert line.position_m
        assert line.covariance
        told_m = np.hypot(*np.subtract(line.position_m, line.observer_m))
        sigma_m = np.sqrt(line.covariance[0] + line.covariance[4])
        assert abs(told_m - true[name]) < 4 * sigma_m
        assert line.motion
        assert line.runner_up
        assert not line.alarm


def test_a_carrier_that_never_turns_never_learns_a_range() -> None:
    straight = {
        "carriers.hunter.motion": {
            "kind": "constant_velocity",
            "east_m": 0.0,
            "north_m": 0.0,
            "course_deg": 90.0,
            "speed_mps": 10.0,
        }
    }
    only = coarse(**straight)
    for step in played(only, steps=80):
        uniform = [line for name, line in lines(step).items() if name.startswith("uniform")]
        assert all(line.status == "undetermined" for line in uniform)
        assert all(line.position_m is None for line in uniform)


def test_lines_pass_the_wire_and_survive_packing(run: list[Played]) -> None:
    message = picture(run[-1])
    assert codec.decode(Tracks, codec.encode(message)) == message
    state = run[-1].state
    assert pack(unpack(pack(state))) == pack(state)


def test_bearings_are_bounded_in_number_and_may_be_left_alone() -> None:
    few = list(played(coarse(), {"own": "hunter", "passive": {"most_bearings": 5}}, steps=30))
    assert max(line.bearings for line in lines(few[-1]).values()) == 5
    off = list(played(coarse(), {"own": "hunter", "passive": {"enabled": False}}, steps=30))
    assert not lines(off[-1])
