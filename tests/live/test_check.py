"""Our own carriers and the stranger's example pass `crossfix check` without a warning."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from crossfix.commands.run import RunOptions
from tests.live.live_run import LiveRun
from tests.live.outsiders import started

pytestmark = pytest.mark.live
SCENARIO = Path(__file__).with_name("patrol.toml")
LONG = RunOptions(rate="10", overrides=("time.duration_s=3600",))
SECONDS = 4
DEADLINE_S = 60


def test_the_example_and_our_carriers_are_clean_live(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    how = ["--run", "patrol", "--connect"]
    with LiveRun(SCENARIO, path, LONG) as run:
        example = ["examples/external_publisher.py", *how, run.endpoint, "--use-corrections"]
        with started(*example) as process:
            run.await_news("visitor has come")
            command = ["check", *how, run.endpoint, "--seconds", str(SECONDS), "--json"]
            done = subprocess.run(
                [sys.executable, "-m", "crossfix", *command],
                capture_output=True, text=True, timeout=DEADLINE_S, check=False,
            )  # fmt: skip
            run.launch.interrupt()
            assert run.await_end() == 0
            process.wait(DEADLINE_S)
    facts = json.loads(done.stdout)
    assert facts["findings"] == []
    assert done.returncode == 0
    carriers = {name.split("/")[0] for name in facts["heard"]}
    assert carriers == {"alpha", "bravo", "visitor"}
