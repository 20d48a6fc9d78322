"""Real processes over real Zenoh, killed, stopped and cut off: the run goes on and says so."""

from __future__ import annotations

import signal
import time
from itertools import islice, pairwise
from pathlib import Path

import pytest

from crossfix.commands.run import RunOptions
from crossfix.launch import KILL_S
from schemas import keys
from schemas.messages import Closed, Health
from schemas.recording.follow import follow
from schemas.recording.reader import open_recording
from tests.live.live_run import DEADLINE_S, LiveRun
from tests.promptness import prompt, within
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

pytestmark = pytest.mark.live
SCENARIO = Path(__file__).with_name("patrol.toml")
STEPS = 60
SLOW = RunOptions(delay=0.1)
"""Steps of a twentieth of a second or so: time enough to make trouble in the middle."""
LONG = RunOptions(delay=0.1, overrides=("time.duration_s=3600",))
"""The same without an end of its own."""


def closed(path: Path) -> list[Closed]:
    return list(messages(path, keys.CLOSED_FUSION, Closed))


def await_recorded(path: Path, steps: int) -> None:
    """Return when a recording that is being written holds so many closings."""
    deadline_s = time.monotonic() + DEADLINE_S
    found = follow(path, is_over=lambda: time.monotonic() > deadline_s)
    fused = (m for m in found if m.address.topic is keys.CLOSED_FUSION)
    assert len(list(islice(fused, steps))) == steps


@prompt
def test_a_carrier_killed_in_mid_run_is_told_at_once_and_the_run_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, SLOW) as run:
        run.await_step(10)
        run.signal("bravo", signal.SIGKILL)
        with within(0.5):
            health = run.await_news("bravo is lost")
        code = run.await_end()
    assert health.lost == ["bravo"]
    assert code == 128 + signal.SIGKILL
    steps = closed(path)
    assert [c.step for c in steps] == list(range(1, STEPS + 1))
    assert [c.lost for c in steps if c.lost] == [["bravo"]]
    with open_recording(path) as recording:
        assert recording.end is not None
        assert (recording.end.reason, recording.end.gaps) == ("finished", 0)
    assert outputs(path) == refused(path)


@prompt
def test_a_hung_carrier_is_given_up_within_the_lease_and_returns_with_a_new_boot(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, LONG) as run:
        run.await_step(10)
        run.signal("bravo", signal.SIGSTOP)
        with within(2.0 + 0.5):
            run.await_news("bravo is lost")
        run.await_message(Closed, lambda closed: "bravo" in closed.lost)
        run.signal("bravo", signal.SIGCONT)
        back = run.await_message(Closed, lambda c: c.step > 10 and "bravo" in c.joined)
        run.await_step(back.step + 5)
        run.launch.interrupt()
        code = run.await_end()
    assert code == 0
    boots = {e.boot for c in closed(path) for e in c.manifest if e.carrier == "bravo"}
    assert len(boots) == 2
    assert outputs(path) == refused(path)


def test_a_centre_that_falls_behind_says_every_second_how_far_it_is(tmp_path: Path) -> None:
    run = LiveRun(SCENARIO, tmp_path / "run.mcap", LONG)
    run.slow_down("fusion", 0.5)
    with run:
        told = [run.await_message(Health, lambda health: health.step > 0) for _ in range(3)]
    steps = [health.step for health in told]
    assert all(0 < after - before <= 4 for before, after in pairwise(steps)), steps


def test_a_hub_killed_and_started_again_costs_no_message(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, SLOW) as run:
        run.await_step(10)
        run.signal("hub", signal.SIGKILL)
        code = run.await_end()
    assert code == 0
    steps = closed(path)
    assert [c.step for c in steps] == list(range(1, STEPS + 1))
    assert not [c for c in steps if c.lost or c.gave_up]
    assert outputs(path) == refused(path)


def test_the_fusion_centre_killed_ends_the_run_with_its_code_and_a_readable_recording(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, SLOW) as run:
        run.await_step(1)  # the recorder has begun
        await_recorded(path, 15)
        run.signal("fusion", signal.SIGKILL)
        code = run.await_end()
    assert code == 128 + signal.SIGKILL
    recorded = closed(path)
    assert [c.step for c in recorded] == list(range(1, len(recorded) + 1))
    assert len(recorded) >= 15


@prompt
def test_an_interrupt_before_the_first_step_waits_for_nobody(tmp_path: Path) -> None:
    in_time = within(KILL_S + 3)  # who cannot hear yet is killed
    with LiveRun(SCENARIO, tmp_path / "run.mcap", SLOW) as run, in_time:
        run.launch.interrupt(begun=False)
        code = run.await_end()
    assert code == 128 + signal.SIGINT


def test_one_interrupt_ends_cleanly_with_a_finished_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, LONG) as run:
        run.await_step(10)
        run.launch.interrupt()
        code = run.await_end()
    assert code == 0
    with open_recording(path) as recording:
        assert recording.end is not None
        assert recording.end.reason == "interrupted"
    assert len(closed(path)) >= 9  # the step that was granted may still be open
    assert outputs(path) == refused(path)
