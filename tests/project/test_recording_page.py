"""docs/recording.md tells the truth: its commands are run, block by block, and its example."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from msgspec.structs import replace

from schemas.recording.contents import SCHEMAS
from schemas.recording.reader import open_recording
from schemas.recording.writer import RecordingWriter
from tests.crossfix.small_recording import record
from tests.project.tree import ROOT

PAGE = (ROOT / "docs" / "recording.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
DEFAULT_HUB = "tcp/127.0.0.1:7447"
DEADLINE_S = 90


def blocks(language: str) -> list[str]:
    return [code for found, code in BLOCK.findall(PAGE) if found == language]


@pytest.fixture
def place(tmp_path: Path, hub: str) -> Path:
    """A folder with a recording, and a `crossfix` that meets at the tests' hub."""
    (tmp_path / "recordings").mkdir()
    strait(tmp_path / "recordings" / "strait.mcap")
    (tmp_path / "bin").mkdir()
    command = tmp_path / "bin" / "crossfix"
    command.write_text(
        "#!/bin/sh\n"
        'case "$1" in record|replay|tell|fusion) '
        f'exec "{sys.executable}" -m crossfix "$@" --connect {hub};; esac\n'
        f'exec "{sys.executable}" -m crossfix "$@"\n'
    )
    command.chmod(0o755)
    return tmp_path


def strait(path: Path) -> None:
    """The small recording, as one of run `strait`."""
    record(path.with_name("small.mcap"))
    with open_recording(path.with_name("small.mcap")) as small:
        header = replace(small.header, run="strait")
        files = [file for name, file in small.attachments.items() if name != SCHEMAS]
        with RecordingWriter(path, header, attachments=files) as writer:
            for message in small.messages():
                writer.write(
                    message.key.replace("/small/", "/strait/"),
                    message.payload,
                    message.encoding,
                    log_time_ns=message.log_time_ns,
                    publish_time_ns=message.publish_time_ns,
                    sequence=message.sequence,
                )
    path.with_name("small.mcap").unlink()


def run(command: list[str], place: Path) -> subprocess.CompletedProcess[str]:
    path = f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"
    with subprocess.Popen(
        command,
        cwd=place,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            out, err = process.communicate(timeout=DEADLINE_S)
        finally:  # what a page starts in the background must not outlive it
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    return subprocess.CompletedProcess(command, process.returncode, out, err)


@pytest.mark.live
@pytest.mark.slow
@pytest.mark.timeout(DEADLINE_S)
@pytest.mark.parametrize("block", blocks("sh"))
def test_every_command_of_the_page_runs(block: str, place: Path) -> None:
    done = run(["/bin/sh", "-e", "-c", block.replace("wait\n", "wait $!\n")], place)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("code", blocks("python"))
def test_every_example_of_the_page_runs(code: str, place: Path) -> None:
    done = run([sys.executable, "-c", code], place)
    assert done.returncode == 0, done.stderr
    assert "outputs" in done.stdout


def test_there_are_commands_and_an_example() -> None:
    assert len(blocks("sh")) > 5
    assert blocks("python")
