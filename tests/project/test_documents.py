"""Documents tell the truth: links lead somewhere, commands and examples of the README run."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from crossfix.__main__ import new_app
from tests.crossfix.small_recording import record
from tests.project.tree import ROOT, tracked

README = (ROOT / "README.md").read_text(encoding="utf-8")
DEADLINE_S = 60
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
DEFAULT_HUB = "tcp/127.0.0.1:7447"

NOT_RUN = {
    "make demo": "it is the demonstration itself; tests/live runs the same in small",
    "make test": "it would run this test",
    f"crossfix hub --listen {DEFAULT_HUB}": "it runs until Ctrl-C; the tests have one of their own",
    f"crossfix peek 'report/**' --connect {DEFAULT_HUB}": "it waits for what is published",
    "crossfix run scenarios/strait.toml --seed 7 --output recordings/seven.mcap": (
        "half a minute of two cores; tests/live runs shorter ones"
    ),
} | dict.fromkeys(
    (
        "crossfix hub --listen tcp/0.0.0.0:7447",
        "crossfix world scenarios/strait.toml --connect tcp/192.0.2.7:7447",
        "crossfix carrier levante --run strait --connect tcp/192.0.2.7:7447",
        "crossfix fusion --run strait --output recordings/strait.mcap --connect tcp/192.0.2.7:7447",
    ),
    "it is for several machines; the processes of tests/live are the same ones on one",
)
"""Commands of the README that are only looked at, and why."""


def blocks(language: str) -> list[str]:
    """The code blocks of the README in one language."""
    return [code for found, code in BLOCK.findall(README) if found == language]


COMMANDS = [line for block in blocks("sh") for line in block.splitlines() if line.strip()]
RUN = [command for command in COMMANDS if command not in NOT_RUN]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what a user has after `make demo`: a recording, and `crossfix` on the path."""
    folder = tmp_path_factory.mktemp("readme")
    (folder / "recordings").mkdir()
    record(folder / "recordings" / "strait.mcap")
    (folder / "scenarios").symlink_to(ROOT / "scenarios")
    (folder / "bin").mkdir()
    command = folder / "bin" / "crossfix"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m crossfix "$@"\n')
    command.chmod(0o755)
    return folder


def environment(folder: Path) -> dict[str, str]:
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}


@pytest.mark.parametrize("command", RUN)
def test_every_command_of_the_readme_runs(command: str, place: Path, hub: str) -> None:
    done = subprocess.run(
        ["/bin/sh", "-c", command.replace(DEFAULT_HUB, hub)],
        cwd=place,
        env=environment(place),
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_commands_that_are_only_looked_at_stand_in_the_readme() -> None:
    assert set(NOT_RUN) <= set(COMMANDS)


@pytest.mark.parametrize("command", [c for c in NOT_RUN if c.startswith("crossfix ")])
def test_their_options_exist(command: str) -> None:
    function, bound, _ = new_app().parse_args(shlex.split(command)[1:])
    assert function.__name__ == command.split()[1]
    assert bound.arguments


@pytest.mark.parametrize("code", blocks("python"))
def test_every_example_of_the_readme_runs(code: str, place: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=place,
        env=environment(place),
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_there_are_commands_and_an_example() -> None:
    assert RUN
    assert blocks("python")


def test_links_between_documents_lead_somewhere() -> None:
    dead = [
        f"{path.relative_to(ROOT)}: {target}"
        for path in tracked(".md")
        for target in relative_links(path)
        if not (path.parent / target).exists()
    ]
    assert dead == []


def test_every_make_target_in_the_documents_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    named = {
        name
        for path in tracked(".md")
        for code in CODE.findall(path.read_text(encoding="utf-8"))
        for name in re.findall(r"\bmake ([a-z][a-z-]*)", code)
    }
    assert {"demo", "test"} <= named
    assert named <= targets


def relative_links(path: Path) -> Iterator[str]:
    """Targets of the links within the project; code is no link."""
    for target in LINK.findall(CODE.sub("", path.read_text(encoding="utf-8"))):
        if not re.match(r"[a-z]+:|#", target):
            yield target.partition("#")[0]
