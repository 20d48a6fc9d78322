"""The page on recordings tells the truth: its commands, programs and example run."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import crossfix
from crossfix.selecting import Selection
from tests.golden.make import GOLDENS
from tests.project.tree import ROOT

PAGE = (ROOT / "docs" / "analysis.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
DEADLINE_S = 120
RECORDED_S = 20.0
DIFFERENT = 1


def blocks(language: str) -> list[str]:
    """The code blocks of the page in one language."""
    return [code for found, code in BLOCK.findall(PAGE) if found == language]


COMMANDS = [line for block in blocks("sh") for line in block.splitlines() if line.strip()]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a short recording of the strait, and `crossfix` on the path."""
    folder = tmp_path_factory.mktemp("analysis")
    (folder / "recordings").mkdir()
    with crossfix.open_recording(GOLDENS[0].path) as golden:
        crossfix.cut(golden, folder / "cut.mcap", Selection(until_s=RECORDED_S))
    with crossfix.open_recording(folder / "cut.mcap") as part:
        crossfix.refuse(part, folder / "recordings" / "strait.mcap", {})
    (folder / "bin").mkdir()
    command = folder / "bin" / "crossfix"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m crossfix "$@"\n')
    command.chmod(0o755)
    return folder


def run(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        arguments,
        cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )


@pytest.mark.slow
def test_every_command_of_the_page_runs_in_its_order(place: Path) -> None:
    for command in COMMANDS:
        done = run(["/bin/sh", "-c", command], place)
        changed = "diff" in command and "wide" in command
        assert done.returncode == (DIFFERENT if changed else 0), (command, done.stderr)
        assert done.stdout, command


@pytest.mark.parametrize("code", blocks("python"), ids=["read", "refuse"])
def test_every_program_of_the_page_runs(code: str, place: Path) -> None:
    done = run([sys.executable, "-c", code], place)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_the_example_compares_settings(place: Path) -> None:
    program = str(ROOT / "examples" / "compare_settings.py")
    values = ["4", "9.21"]
    done = run(
        [sys.executable, program, "recordings/strait.mcap", "association.gate", *values], place
    )
    assert done.returncode == 0, done.stderr
    head, *lines = done.stdout.splitlines()
    assert "before, after" in head
    assert [line.split()[0] for line in lines] == [v for v in values for _ in range(2)]
    assert {line.split()[1] for line in lines} == {"poniente", "siroco"}


def test_every_verb_on_recordings_stands_on_the_page() -> None:
    verbs = {line.split()[1] for line in COMMANDS if line.startswith("crossfix ")}
    assert verbs == {"verify", "refuse", "diff", "cut", "merge", "cat", "recover", "export"}
