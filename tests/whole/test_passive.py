"""Bearings alone in a whole run: no number before there is one, then honest ones, then tracks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from bench.in_process import Played, played
from crossfix.evaluation import (
    FrameError,
    PictureSummary,
    frame_errors,
    picture_errors,
    summarise_picture,
)
from estimation.consistency import mean_interval
from fusion_center import pipeline
from fusion_center.settings import settings_from
from fusion_center.state import pack, unpack
from schemas import codec
from schemas.messages import (
    BearingLine,
    Correction,
    Input,
    Navigation,
    SourceReport,
    Tracks,
    TruthCarriers,
)
from sim_world.scenario import Scenario, load_scenario, with_overrides
from tests.fusion_center.scenes import closed

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
    """What the own carrier's bearings say, alone or with the picket's, by the target's name."""
    told = (line for line in picture(step).lines if not line.id.startswith("picket/"))
    return {line.id.rpartition("/")[2]: line for line in told}


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
    assert len(picture(last).tracks) == TARGETS
    for name, line in lines(last).items():
        true = true_ranges_m(next(step for step in run if step.closed.t_ns == line.t_ns))
        assert line.position_m
        assert line.covariance
        told_m = np.hypot(*np.subtract(line.position_m, line.observer_m))
        sigma_m = np.sqrt(line.covariance[0] + line.covariance[4])
        assert abs(told_m - true[name]) < 4 * sigma_m
        assert line.motion
        assert line.runner_up
        assert not line.alarm


@pytest.mark.slow
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


def frames_alone(seed: int) -> list[FrameError]:
    """Errors of the picket's frame, found once a minute without anything else being done."""
    only = coarse(
        **{
            "seed": seed,
            "fusion.picture.enabled": False,
            "fusion.passive.solve_every_s": 1e6,
            "fusion.passive.frames_every_s": 60,
            "fusion.monitor.apply_after": 1,
        }
    )
    said: list[TruthCarriers | Correction] = []
    for step in played(only):
        said += [step.carriers, *step.corrections.values()]
    return frame_errors(only.declared, "hunter", said)["picket"]


def picture_of(run: list[Played]) -> PictureSummary:
    said: list[Any] = []
    for step in run:
        said += [step.targets, step.carriers, picture(step)]
        said += [m for m in step.said if isinstance(m, Navigation)]
    found = summarise_picture(picture_errors(coarse().declared, "hunter", said))
    assert found is not None
    return found


def test_the_picket_is_not_placed_before_the_own_carrier_turns(run: list[Played]) -> None:
    """The first bearings meet nothing; then there are many, but from two uniform ways."""
    first = at(run, 15).corrections["picket"]
    assert first.state == "off"
    assert first.reason.startswith("two bearing-only carriers at one instant")
    for seconds in range(60, 180, STEP_S):
        found = at(run, seconds).corrections["picket"]
        assert found.state == "observing"
        assert found.reason.startswith("neither carrier has manoeuvred in the last 600 s")
        assert found.own_axes is None


def test_the_picket_s_frame_is_found_and_applied(run: list[Played]) -> None:
    last = run[-1].corrections["picket"]
    assert (last.state, last.method) == ("applied", "bearings")
    assert all(d.status == "determined" for d in last.directions)
    error = frame_errors(coarse().declared, "hunter", [run[-1].carriers, last])["picket"][0]
    assert np.hypot(*error.after_m) < 0.5 * np.hypot(*error.before_m)
    assert abs(error.after_rad) < 0.5 * abs(error.before_rad)


def test_a_target_of_both_carriers_is_one_line(run: list[Played]) -> None:
    """Before the picket is placed each has its own; then none is told twice, and it is nearer."""
    before = [line.id.partition("/")[0] for line in picture(at(run, 240)).lines]
    assert not any(line.carriers for line in picture(at(run, 240)).lines)
    assert set(before) == {"hunter"}
    last = picture(at(run, 600)).lines
    assert sorted(line.id.rpartition("/")[2] for line in last) == sorted(
        line["name"] for line in PASSIVE.tree["targets"]
    )
    assert all(line.carriers == ["hunter", "picket"] for line in last)
    alone = [line for line in lines(at(run, 240)).values() if line.covariance]
    spread = [
        np.median([line.covariance[0] + line.covariance[4] for line in some if line.covariance])
        for some in (alone, last)
    ]
    assert spread[1] < 0.25 * spread[0]


def test_its_intervals_cover_though_the_frame_is_unsure(run: list[Played]) -> None:
    covered, frame_m = [], []
    for step in run:
        true = true_ranges_m(step)
        for name, line in lines(step).items():
            if line.carriers and line.t_ns == step.closed.t_ns:
                covered.append(line.range_low_m <= true[name] <= (line.range_high_m or np.inf))
                frame_m.append(np.sqrt(line.covariance[0]) if line.covariance else np.inf)
    assert len(covered) > 20
    assert np.mean(covered) > 0.8
    assert np.median(frame_m) > 2.0  # a picket out by metres; without it they would be surer


@pytest.mark.slow
def test_a_frame_is_left_when_the_last_manoeuvre_is_forgotten() -> None:
    """The hunter turns last at 450 s; 420 s later the reason is told, then no number any more."""
    frames = {"frames_memory_s": 420, "frames_every_s": 30, "solve_every_s": 1e6}
    settings = {"own": "hunter", "picture": {"enabled": False}, "passive": frames}
    run = list(played(coarse(**{"time.duration_s": 940}), settings))
    reason = "neither carrier has manoeuvred in the last 420 s"
    applied, held, left = (at(run, seconds).corrections["picket"] for seconds in (840, 900, 940))
    assert (applied.state, applied.reason) == ("applied", "")
    assert held.state == "applied"
    assert held.reason.startswith(f"the last good estimate holds: {reason}")
    assert held.own_axes is not None
    assert left.state == "observing"
    assert left.reason.startswith(reason)
    assert left.own_axes is left.fixed_axes is None


@pytest.mark.slow
def test_its_errors_are_as_large_as_it_says() -> None:
    """Five runs, three degrees of freedom each; chance leaves the interval once in a thousand."""
    low, high = mean_interval(3, 5, 0.999)
    assert low < np.mean([frames_alone(seed)[-1].nees / 3 for seed in range(2, 7)]) < high


@pytest.mark.slow
def test_targets_are_better_known_with_the_picket(run: list[Played]) -> None:
    alone = list(played(coarse(**{"fusion.passive.frames_every_s": 1e6})))
    assert alone[-1].corrections["picket"].state == "observing"
    assert picture_of(run).error_m < picture_of(alone).error_m


def test_frames_of_bearings_do_not_depend_on_how_time_is_cut(run: list[Played]) -> None:
    """Closed at every step or once a minute, packed at each: the same memory to the bit."""
    seldom = {"frames_every_s": 60, "solve_every_s": 1e6}
    settings = settings_from({"own": "hunter", "picture": {"enabled": False}, "passive": seldom})
    finals = []
    for size in (1, 12):
        state = pipeline.initial(coarse().declared, settings)
        for number, begin in enumerate(range(0, 60, size), 1):
            steps = run[begin : begin + size]
            said = [message for step in steps for message in step.said]
            now = closed(number, said, t_ns=steps[-1].closed.t_ns)
            state, _ = pipeline.step(unpack(pack(state)), now, said)
        assert state.links["picket"].estimate is not None
        finals.append(pack(replace(state, published={})))
    assert finals[0] == finals[1]


def nameless(**more: Any) -> Scenario:
    """The same without any identity, nothing but frames looked for, twice a minute."""
    unnamed = {f"carriers.{name}.sensors.sonar.identity_share": 0 for name in ("hunter", "picket")}
    frames = {"fusion.passive.frames_every_s": 30, "fusion.passive.solve_every_s": 1e6}
    return coarse(**(unnamed | frames | {"fusion.picture.enabled": False} | more))


def seen_by(step: Played, carrier: int, bearing_rad: float) -> int:
    """The target that is where a bearing from a carrier's own north points, roughly."""
    apart = np.subtract(step.targets.position_m, step.carriers.position_m[carrier])
    off = np.arctan2(*apart[:, :2].T) - bearing_rad - step.carriers.north_error_rad[carrier]
    return int(np.argmin(np.abs(np.angle(np.exp(1j * off)))))


@pytest.fixture(scope="module")
def unnamed() -> list[Played]:
    return list(played(nameless(), steps=74))


def test_targets_without_names_are_paired_and_the_picket_is_placed(unnamed: list[Played]) -> None:
    last, state = unnamed[-1], unnamed[-1].state
    paired = {key: pair.target for key, pair in state.paired.items() if pair.agreed >= 3}
    assert len(paired) >= 4
    for other, own in paired.items():
        whose = []
        for carrier, rays in ((1, state.rays[other]), (0, state.rays[f"hunter/{own}"])):
            then = next(s for s in unnamed if s.closed.t_ns >= rays.t_ns[-1])
            whose.append(seen_by(then, carrier, float(rays.seen[-1, 2])))
        assert whose[0] == whose[1]
    found = last.corrections["picket"]
    assert (found.state, found.method) == ("applied", "bearings")
    error = frame_errors(PASSIVE.declared, "hunter", [last.carriers, found])["picket"][0]
    assert error.nees < 16.3  # of three; one in a thousand


def test_without_names_nothing_is_paired_before_a_manoeuvre(unnamed: list[Played]) -> None:
    before = at(unnamed, 180)
    assert before.corrections["picket"].state == "observing"
    assert before.corrections["picket"].reason.startswith("neither carrier has manoeuvred")
    assert not before.state.paired


def test_pairs_do_not_depend_on_how_time_is_cut(unnamed: list[Played]) -> None:
    steps = unnamed[:60]
    state = pipeline.initial(nameless().declared, settings_from(nameless().declared.fusion))
    for number, begin in enumerate(range(0, 60, 12), 1):
        some = steps[begin : begin + 12]
        said = [message for step in some for message in step.said]
        now = closed(number, said, t_ns=some[-1].closed.t_ns)
        state, _ = pipeline.step(unpack(pack(state)), now, said)
    assert state.paired
    assert pack(replace(state, published={})) == pack(replace(steps[-1].state, published={}))


@pytest.mark.slow
def test_without_names_every_target_is_one_line_and_one_track() -> None:
    """As with names, though it takes some attempts longer."""
    solved = {"fusion.passive.solve_every_s": 30, "fusion.passive.frames_every_s": 15}
    steps = list(played(nameless(**solved, **{"fusion.picture.enabled": True})))
    last = picture(steps[-1])
    both = [line for line in last.lines if line.carriers == ["hunter", "picket"]]
    assert len(both) == len(last.lines) == len(last.tracks) == TARGETS
    true = np.array(steps[-1].targets.position_m)[:, :2]
    for line in both:
        assert line.status == "determined"
        assert np.hypot(*(true - np.array(line.position_m)).T).min() < 60
    assert picture_of(steps).error_m < 60


@pytest.mark.slow
def test_carriers_that_number_their_targets_need_no_names_either() -> None:
    """The picket's numbers are not the hunter's, and the hunter knows names."""

    def numbered(message: Input) -> Input:
        if isinstance(message, SourceReport) and message.carrier == "picket" and message.identity:
            ids = [f"{len(name or '')}-{name}" for name in message.identity]
            return replace(message, identity=None, track_id=ids)
        return message

    frames = {"frames_every_s": 30, "solve_every_s": 1e6}
    settings = {"own": "hunter", "picture": {"enabled": False}, "passive": frames}
    last = list(played(coarse(), settings, steps=74, heard=numbered))[-1]
    paired = {key: pair.target for key, pair in last.state.paired.items() if pair.agreed >= 3}
    assert len(paired) >= 4
    for key, target in paired.items():
        assert key.partition("-")[2] == target.partition("/")[2]
    assert last.corrections["picket"].state == "applied"
