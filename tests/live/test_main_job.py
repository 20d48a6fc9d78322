"""The main job live: the default scenario, the same bytes under any disturbance, no leftovers."""

from __future__ import annotations

import json
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from crossfix.__main__ import main
from crossfix.commands import FileOptions
from crossfix.commands.run import RunOptions
from schemas import keys
from schemas.bus.entry import LAUNCHER
from schemas.feedback import WINDOW
from schemas.messages import Closed, Navigation
from schemas.recording.parts import parts_of
from tests.live.live_run import LiveRun
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

pytestmark = pytest.mark.live
PATROL = Path(__file__).with_name("patrol.toml")
STRAIT = Path(__file__).parents[2] / "scenarios" / "strait.toml"
DEADLINE_S = 120


def crossfix(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "crossfix", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )


def refused_with(capsys: pytest.CaptureFixture[str], *run: str | Path) -> str:
    """What is said of a run that is not started for what was asked; in this process."""
    with pytest.raises(SystemExit) as exit_:
        main(["run", *map(str, run)])
    assert exit_.value.code == 2
    return capsys.readouterr().err


@contextmanager
def load() -> Iterator[None]:
    """Two processes that compute all the time."""
    spinners = [multiprocessing.get_context("spawn").Process(target=_spin) for _ in range(2)]
    for spinner in spinners:
        spinner.start()
    try:
        yield
    finally:
        for spinner in spinners:
            spinner.kill()
            spinner.join()


def _spin() -> None:
    while True:
        pass


@contextmanager
def slow_viewer(run: LiveRun) -> Iterator[None]:
    script = Path(__file__).with_name("slow_viewer.py")
    viewer = subprocess.Popen([sys.executable, str(script), run.endpoint, run.run])
    try:
        yield
    finally:
        viewer.kill()
        viewer.wait()


def children_of(launcher: int) -> list[str]:
    """Command lines of processes that a launcher has started and that are still here."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            environment = (entry / "environ").read_bytes()
            if f"{LAUNCHER}={launcher}\0".encode() in environment + b"\0":
                found.append((entry / "cmdline").read_text())
        except OSError:
            continue
    return found


def test_the_default_scenario_brings_every_frame_far_closer(tmp_path: Path) -> None:
    path = tmp_path / "strait.mcap"
    done = crossfix("run", STRAIT, "--set", "time.duration_s=60", "-o", path, "--json")
    assert done.returncode == 0, done.stderr
    frames = json.loads(done.stdout)
    assert [frame["carrier"] for frame in frames] == ["poniente", "siroco"]
    for frame in frames:
        assert frame["state"] == "applied"
        assert frame["after_m"] < 0.1 * frame["before_m"]
        # 30 correlated corrections of one carrier: a mean NEES of 3 wanders about that much
        assert frame["nees"] / 3 < 3
    assert outputs(path) == refused(path)


def test_the_same_seed_gives_the_same_bytes_under_load_delay_and_a_slow_viewer(
    tmp_path: Path,
) -> None:
    quiet, disturbed = tmp_path / "quiet.mcap", tmp_path / "disturbed.mcap"
    with LiveRun(PATROL, quiet) as run:
        assert run.await_end() == 0
    with load(), LiveRun(PATROL, disturbed, RunOptions(delay=0.03)) as run, slow_viewer(run):
        assert run.await_end() == 0
    assert outputs(quiet) == outputs(disturbed)
    assert outputs(quiet) == refused(quiet)
    for path in (quiet, disturbed):  # bravo applies its corrections, each in its turn
        said = [m for m in messages(path, keys.NAVIGATION, Navigation) if m.carrier == "bravo"]
        held = {m.step: m.correction_id for m in said if m.correction_id}
        assert len(held) > 30
        assert held == {step: f"fusion/bravo/{step - WINDOW}" for step in held}


def test_a_run_is_recorded_in_parts_that_stand_alone(tmp_path: Path) -> None:
    files = FileOptions(fsync="flush", split_time=25.0, keep=2)
    with LiveRun(PATROL, tmp_path / "run.mcap", RunOptions(files=files)) as run:
        assert run.await_end() == 0
    parts = parts_of(tmp_path / "run.mcap")
    assert [part.name for part in parts] == ["run.0002.mcap", "run.0003.mcap"]
    steps = [{m.step for m in messages(p, keys.CLOSED_FUSION, Closed)} for p in parts]
    assert max(steps[1]) == 60
    assert not steps[0] & steps[1]


def test_a_paced_run_refuses_to_the_same_bytes(tmp_path: Path) -> None:
    path = tmp_path / "paced.mcap"
    with LiveRun(PATROL, path, RunOptions(rate="20")) as run:
        assert run.await_end() == 0
    assert len({key for key, _ in outputs(path)}) == 4
    assert outputs(path) == refused(path)


@pytest.mark.parametrize(
    "launches",
    [pytest.param(2), pytest.param(50, marks=[pytest.mark.slow, pytest.mark.timeout(900)])],
)
def test_launches_in_a_row_leave_nothing_behind(tmp_path: Path, launches: int) -> None:
    for number in range(launches):
        with LiveRun(PATROL, tmp_path / f"{number}.mcap") as run:
            run.await_step(1)
            if number % 2:
                run.launch.interrupt()
            assert run.await_end() == 0
    assert children_of(os.getpid()) == []


def test_bad_input_is_refused_before_any_process_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text(PATROL.read_text().replace("sigma_range_m", "sigma_range"))
    done = crossfix("run", bad)
    assert done.returncode == 2
    assert "sigma_range_m" in done.stderr
    assert "bad.toml" in done.stderr
    assert "listening" not in done.stderr
    assert refused_with(capsys, tmp_path / "absent.toml")
    assert refused_with(capsys, PATROL, "--rate", "fast")
    assert "--split-size or --split-time" in refused_with(capsys, PATROL, "--keep", "3")
    assert refused_with(capsys, PATROL, "--split-time", "9", "--verify")
    assert refused_with(capsys, PATROL, "--set", "fusion.association.gat=1")
