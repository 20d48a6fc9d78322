"""Every example runs and says what its reader is told to expect, those of the pages too."""

from __future__ import annotations

import re
import shlex
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from msgspec import to_builtins
from msgspec.structs import replace

from crossfix.commands.run import RunOptions
from examples import external_publisher
from schemas import keys
from schemas.feedback import applied, corrected
from schemas.messages import (
    Correction,
    Feedback,
    Navigation,
    Pose,
    SourceInfo,
    SourceReport,
)
from schemas.recording.reader import open_recording
from tests.live.live_run import LiveRun
from tests.live.outsiders import DEADLINE_S, await_line, started
from tests.whole.recorded import messages

ROOT = Path(__file__).parents[2]
SCENARIO = ROOT / "tests" / "live" / "patrol.toml"
PAGE = (ROOT / "docs" / "publishing.md").read_text(encoding="utf-8")
FEEDBACK_PAGE = (ROOT / "docs" / "feedback.md").read_text(encoding="utf-8")
STEPS = 60
LEAST = 40
"""Steps that a publisher must have taken part in; it may join a moment late."""
ENDED = "ended: finished"


def blocks(language: str, page: str = PAGE) -> list[str]:
    """Code of a page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page, re.DOTALL | re.MULTILINE)


class Outcome(NamedTuple):
    """What was left by all publishers together: what each printed, and the recording."""

    said: dict[str, str]
    recording: Path


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """One paced run that the example and the short program of the page take part in."""
    folder = tmp_path_factory.mktemp("examples")
    (short,) = blocks("python")
    program, path = folder / "publisher.py", folder / "run.mcap"
    program.write_text(short)
    with LiveRun(SCENARIO, path, RunOptions(rate="10"), held=True) as run:
        where = ["--run", run.run, "--connect", run.endpoint]
        with (
            started(str(ROOT / "examples" / "external_publisher.py"), *where) as example,
            started(str(program), run.run, run.endpoint) as shorter,
        ):
            run.begin_with("visitor", "short")
            assert run.await_end() == 0
            programs = {"external_publisher": example, "short": shorter}
            said = {name: p.communicate(timeout=DEADLINE_S)[0] for name, p in programs.items()}
            assert [p.returncode for p in programs.values()] == [0, 0], said
    return Outcome(said, path)


def test_every_example_is_executed_here() -> None:
    examples = {path.stem for path in (ROOT / "examples").glob("*") if path.is_file()}
    assert examples == {
        "compare_settings",
        "external_publisher",
        "range_and_odometry",
        "stonesoup_tracking",
    }


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.name)
def test_every_example_explains_itself(path: Path) -> None:
    command = [sys.executable, str(path), "--help"]
    shown = subprocess.run(command, check=True, capture_output=True, text=True, timeout=DEADLINE_S)
    assert f"python examples/{path.name}" in shown.stdout


def test_the_example_imports_nothing_of_ours() -> None:
    text = (ROOT / "examples" / "external_publisher.py").read_text()
    modules = set(re.findall(r"^(?:import|from) (\w+)", text, re.MULTILINE))
    assert modules - set(sys.stdlib_module_names) == {"zenoh", "msgpack"}


def on_the_page() -> Callable[..., list[dict[str, Any]]]:
    """`corrected` as the page on feedback has it."""
    (code,) = blocks("python", FEEDBACK_PAGE)
    names: dict[str, Any] = {}
    exec(code, names)
    found: Callable[..., list[dict[str, Any]]] = names["corrected"]
    return found


@pytest.mark.parametrize("its", [external_publisher.corrected, on_the_page()])
def test_what_example_and_page_do_with_a_correction_is_what_we_do(
    its: Callable[..., list[dict[str, Any]]],
) -> None:
    feedback = Feedback(
        latitude_rad=1e-4, longitude_rad=-2e-4, latitude_rad_s=3e-7, longitude_rad_s=-1e-7,
        north_rad=-0.02, covariance=[9.0, 1.0, 0.0, 16.0, 0.0, 1e-6],
    )  # fmt: skip
    correction = Correction(
        centre="fusion", seq=7, step=7, t_ns=7 * 10**9, valid_t_ns=7 * 10**9, carrier="b",
        id="fusion/b/7", state="applied", feedback=feedback,
    )  # fmt: skip
    envelope = {"carrier": "b", "boot": "x", "seq": 1, "t_ns": 10 * 10**9}
    own = Navigation(
        **envelope, stream="navigation", pose=Pose(latitude_rad=0.6, longitude_rad=-0.1)
    )
    seen = SourceReport(**envelope, stream="radar", bearing_rad=[1.0, 2.0], range_m=[5e3, 6e3])
    held = applied(correction, own, since_ns=0)
    pose, logs = {"latitude_rad": 0.6, "longitude_rad": -0.1}, {"bearing_rad": [1.0, 2.0]}
    where, what = its(pose, logs, to_builtins(correction), own.t_ns)
    ours, turned = corrected(own, held), corrected(seen, held)
    assert isinstance(ours, Navigation)
    assert isinstance(turned, SourceReport)
    assert where["pose"]["latitude_rad"] == pytest.approx(ours.pose.latitude_rad, abs=1e-13)
    assert where["pose"]["longitude_rad"] == pytest.approx(ours.pose.longitude_rad, abs=1e-13)
    assert where["pose"]["covariance"] == ours.pose.covariance
    assert (where["uncorrected"], where["correction_id"]) == (pose, ours.correction_id)
    assert what["bearing_rad"] == pytest.approx(turned.bearing_rad, abs=1e-13)
    assert (what["turned_rad"], what["correction_id"]) == (turned.turned_rad, "fusion/b/7")
    none = to_builtins(replace(correction, feedback=None))
    assert its(pose, logs, none, own.t_ns) == [{"pose": pose}, logs]


@pytest.mark.live
def test_the_example_tells_how_its_correction_went(outcome: Outcome) -> None:
    said = outcome.said["external_publisher"]
    assert "visitor takes part in patrol" in said
    assert re.search(r"step \d+: correction applied: [+-]\d+ m east, [+-]\d+ m north", said)
    assert said.rstrip().endswith(ENDED)


@pytest.mark.live
def test_the_short_program_of_the_page_is_recorded_without_a_gap(outcome: Outcome) -> None:
    (steps,) = re.findall(r"said something at (\d+) steps", outcome.said["short"])
    assert int(steps) >= LEAST
    counts = Counter(
        type(message).__name__
        for topic, kind in (
            (keys.SOURCE, SourceInfo),
            (keys.NAVIGATION, Navigation),
            (keys.REPORT, SourceReport),
        )
        for message in messages(outcome.recording, topic, kind)
        if message.carrier == "short"
    )
    assert counts == {"SourceInfo": 1, "Navigation": int(steps), "SourceReport": int(steps)}
    with open_recording(outcome.recording) as recording:
        assert recording.end is not None
        assert recording.end.gaps == 0


@pytest.mark.live
def test_each_publisher_gets_a_correction_of_its_own(outcome: Outcome) -> None:
    states: dict[str, set[str]] = {}
    for correction in messages(outcome.recording, keys.CORRECTION, Correction):
        states.setdefault(correction.carrier, set()).add(correction.state)
    assert "applied" in states["visitor"]
    assert "observing" in states["short"]  # its two targets are nobody's


def test_lines_of_json_on_the_page_do_what_it_says() -> None:
    for command in "".join(blocks("sh")).splitlines():
        text, bridge = command.split(" | ")
        line = shlex.split(text)[1]
        done = subprocess.run(
            [sys.executable, "-m", *shlex.split(bridge)],
            input=line,
            capture_output=True,
            text=True,
            check=True,
            timeout=DEADLINE_S,
        )
        kinds = re.findall(r"crossfix\.(\w+)\"", done.stdout)
        assert kinds == ["Navigation", "SourceInfo", "SourceReport"]
        assert "received 1, decoded 1, rejected 0" in done.stderr


def test_navigation_on_the_page_is_taken() -> None:
    (line,) = blocks("json")
    command = [sys.executable, "-m", "crossfix", "bridge", "jsonl", "-", "--dry-run"]
    done = subprocess.run(
        command, input=line, capture_output=True, text=True, check=True, timeout=DEADLINE_S
    )
    assert done.stdout.count("crossfix.Navigation") == 1


@pytest.mark.live
@pytest.mark.slow
def test_the_example_ends_with_a_world_that_died_without_a_word(tmp_path: Path) -> None:
    with LiveRun(SCENARIO, tmp_path / "run.mcap", RunOptions(rate="5")) as run:
        program = str(ROOT / "examples" / "external_publisher.py")
        with started(program, "--run", run.run, "--connect", run.endpoint) as example:
            await_line(example, "takes part in patrol")
            run.await_step(10)
            run.signal("world", signal.SIGKILL)
            assert "the world is silent" in example.communicate(timeout=DEADLINE_S)[0]
            assert example.returncode == 0
