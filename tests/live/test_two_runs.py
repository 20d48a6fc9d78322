"""Two runs at one time on one machine: each has its own hub and its own recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from crossfix.launch import Launch
from crossfix.new_file import new_recording
from schemas.errors import LaunchError
from schemas.recording.reader import open_recording

PATROL = Path(__file__).with_name("patrol.toml")
DEADLINE_S = 120
CHOOSE = "import sys; from pathlib import Path; from crossfix.new_file import new_recording; "
CHOOSE += "print(new_recording('patrol', Path(sys.argv[1])).name)"


def chosen(folder: Path) -> str:
    """The name that a process of its own chooses, and lets go of by ending."""
    command = [sys.executable, "-c", CHOOSE, str(folder)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=DEADLINE_S, check=True
    ).stdout.strip()


@pytest.mark.live
def test_two_runs_of_one_scenario_started_at_once_both_come_to_their_end(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "crossfix", "run", str(PATROL), "--set", "time.duration_s=10"]
    runs = [
        subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) for _ in "ab"
    ]
    said = [run.communicate(timeout=DEADLINE_S)[1] for run in runs]
    assert [run.returncode for run in runs] == [0, 0], said
    hubs = {line.split()[-1] for text in said for line in text.splitlines() if "listening" in line}
    assert len(hubs) == 2
    paths = sorted((tmp_path / "recordings").iterdir())
    assert [path.name for path in paths] == ["patrol-2.mcap", "patrol.mcap"]
    for path in paths:
        with open_recording(path) as recording:
            assert recording.end is not None
            assert (recording.end.reason, recording.end.gaps) == ("finished", 0)


def test_a_hub_by_default_gives_way_and_one_on_a_certain_port_says_that_it_is_taken() -> None:
    said: list[str] = []
    with (
        Launch(lambda name, line: said.append(f"{name} {line}")) as first,
        Launch(lambda name, line: said.append(f"{name} {line}")) as second,
    ):
        taken = first.start_hub()
        assert second.start_hub() != taken
        assert said[0] == f"hub listening on {taken}"
        with (
            Launch(lambda name, line: None) as third,
            pytest.raises(LaunchError, match=f"{taken} is taken"),
        ):
            third.start_hub(taken)


@pytest.mark.skipif(sys.platform != "linux", reason="names are held in Linux' abstract namespace")
def test_a_name_for_a_recording_is_given_once_and_let_go_of_at_the_end(tmp_path: Path) -> None:
    assert chosen(tmp_path) == "patrol.mcap"
    assert new_recording("patrol", tmp_path).name == "patrol.mcap"
    assert chosen(tmp_path) == "patrol-2.mcap"
    assert new_recording("patrol", tmp_path).name == "patrol-2.mcap"
