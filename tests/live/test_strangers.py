"""Programs that are not ours take part in a run, as real processes over real Zenoh."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from math import isnan
from pathlib import Path

import pytest
from msgspec.structs import replace

from crossfix.commands.run import RunOptions
from crossfix.evaluation import frame_errors
from crossfix.table import frame_summaries
from examples import external_publisher as example
from schemas import keys
from schemas.messages import Closed, Correction, SourceReport, TruthCarriers
from schemas.recording.reader import open_recording
from tests.hub_process import ROOT
from tests.live.live_run import LiveRun
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

pytestmark = pytest.mark.live
SCENARIO = Path(__file__).with_name("patrol.toml")
STEPS = 60
DEADLINE_S = 60
SLOW = RunOptions(delay=0.1)
NEES_LIMIT = 21.1
"""Of three degrees of freedom: exceeded once in 10,000."""


@contextmanager
def visitor(run: LiveRun, *options: str) -> Iterator[subprocess.Popen[str]]:
    """The example as its user starts it."""
    command = [sys.executable, "examples/external_publisher.py", "--run", run.run]
    with subprocess.Popen(
        [*command, "--connect", run.endpoint, *options],
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def nees_of_visitor(path: Path) -> list[float]:
    """NEES of the applied corrections against where the example says that it truly is."""
    with open_recording(path) as recording:
        scenario = recording.scenario
    truths = [
        replace(
            truth,
            carrier=[*truth.carrier, "visitor"],
            position_m=[*truth.position_m, list(example.TRULY_AT_M)],
            velocity_mps=[*truth.velocity_mps, [0.0, 0.0, 0.0]],
            acceleration_mps2=[*truth.acceleration_mps2, [0.0, 0.0, 0.0]],
            north_error_rad=[*truth.north_error_rad, example.NORTH_ERROR_RAD],
        )
        for truth in messages(path, keys.TRUTH_CARRIERS, TruthCarriers)
    ]
    corrections = messages(path, keys.CORRECTION, Correction)
    errors = frame_errors(scenario, "alpha", [*truths, *corrections])["visitor"]
    return [error.nees for error in errors if error.state == "applied"]


@pytest.mark.parametrize(
    ("how", "options"),
    [(SLOW, ["--answer-steps"]), (SLOW, []), (RunOptions(rate="20"), [])],
    ids=["answers steps", "answers none", "paced"],
)
def test_the_example_is_recorded_and_gets_a_right_correction(
    how: RunOptions, options: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, how) as run, visitor(run, *options) as process:
        assert run.await_end() == 0
        said, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0
    assert "correction applied" in said
    assert said.endswith("ended: finished\n")

    reports = [r for r in messages(path, keys.REPORT, SourceReport) if r.carrier == "visitor"]
    steps = list(messages(path, keys.CLOSED_FUSION, Closed))
    closed_at = {step.t_ns: step.step for step in steps}
    answers = [closed_at[report.t_ns] if "--answer-steps" in options else 0 for report in reports]
    assert [report.step for report in reports] == answers
    assert len(reports) >= STEPS - 10  # it may join a moment late
    assert "visitor" in chain.from_iterable(step.joined for step in steps)
    assert not [step for step in steps if step.gave_up or step.late or step.lost]

    nees = nees_of_visitor(path)
    assert len(nees) >= STEPS / 2
    assert max(nees) < NEES_LIMIT
    with open_recording(path) as recording:
        assert recording.end is not None
        assert recording.end.gaps == 0
    assert outputs(path) == refused(path)


def test_a_visitor_that_dies_is_named_lost_and_its_errors_stay_unknown(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LiveRun(SCENARIO, path, SLOW) as run, visitor(run) as process:
        run.await_news("visitor has come")
        run.await_step(20)
        process.kill()
        health = run.await_news("visitor is lost")
        assert run.await_end() == 0
    assert health.lost == ["visitor"]
    steps = messages(path, keys.CLOSED_FUSION, Closed)
    assert [step.lost for step in steps if step.lost] == [["visitor"]]
    last = {c.carrier: c for c in messages(path, keys.CORRECTION, Correction)}["visitor"]
    assert (last.state, last.reason) == ("suspended", "visitor is lost")
    rows = {row.carrier: row for row in frame_summaries(path)}
    assert isnan(rows["visitor"].after_m)
    assert rows["bravo"].after_m < rows["bravo"].before_m
    assert outputs(path) == refused(path)
