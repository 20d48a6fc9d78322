"""What the pages tell their readers to type, and a place like theirs to type it in."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.project.tree import ROOT

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
DEFAULT_HUB = "tcp/127.0.0.1:7447"
ENDPOINT = re.compile(r"tcp/(?:127\.0\.0\.1|0\.0\.0\.0|192\.0\.2\.7):7447")
JOINING = re.compile(r"(crossfix (run|peek|replay|check --run|bridge \w+)|python examples/)")
DEADLINE_S = 60.0
OURS = ("crossfix ", "python ")


def blocks(page: str, *languages: str) -> list[str]:
    """The code blocks of a page in some languages."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [code for found, code in BLOCK.findall(text) if found in languages]


def commands(page: str) -> list[str]:
    """The command lines of a page."""
    lines = (line for block in blocks(page, "sh", "") for line in block.splitlines())
    return [line for line in lines if line.strip()]


def at(endpoint: str, command: str) -> str:
    """A command line with this hub in place of the one it means."""
    if ENDPOINT.search(command):
        return ENDPOINT.sub(endpoint, command)
    is_offline = "--dry-run" in command or not JOINING.search(command)
    return command if is_offline else f"{command} --connect {endpoint}"


class Place:
    """A folder with what a user has after `make demo`, the scenario shortened.

    Args:
        duration_s: of the default scenario there.
    """

    def __init__(self, folder: Path, duration_s: int) -> None:
        self.folder = folder
        for name in ("recordings", "scenarios", "bin"):
            (folder / name).mkdir()
        (folder / "examples").symlink_to(ROOT / "examples")
        strait = (ROOT / "scenarios" / "strait.toml").read_text(encoding="utf-8")
        shortened, number = re.subn(r"duration_s = \d+", f"duration_s = {duration_s}", strait)
        assert number == 1
        (folder / "scenarios" / "strait.toml").write_text(shortened, encoding="utf-8")
        self._command("crossfix", '-m crossfix "$@"')
        self._command("python", '"$@"')

    def run(self, command: str) -> subprocess.CompletedProcess[str]:
        """Type a command line and wait for its end."""
        with self.started(command) as process:
            out, err = process.communicate(timeout=DEADLINE_S)
        return subprocess.CompletedProcess(command, process.returncode, out, err)

    @contextmanager
    def started(self, command: str) -> Iterator[subprocess.Popen[str]]:
        """Type a command line; what it starts is killed at the end, if it still runs."""
        path = f"{self.folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
        process = subprocess.Popen(
            [
                "/bin/sh",
                "-c",
                f"exec {command}" if command.startswith(OURS) and "|" not in command else command,
            ],
            cwd=self.folder,
            env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()
                process.communicate(timeout=DEADLINE_S)

    def _command(self, name: str, arguments: str) -> None:
        command = self.folder / "bin" / name
        command.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments}\n')
        command.chmod(0o755)
