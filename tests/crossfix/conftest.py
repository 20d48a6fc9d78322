"""Running the command line: in this process for what it prints, as a process for what it does."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import pytest

from crossfix.__main__ import main

DEADLINE_S = 30


class Outcome(NamedTuple):
    """What a command line left behind."""

    code: int
    out: str
    err: str


Crossfix = Callable[..., Outcome]


@pytest.fixture
def crossfix(capsys: pytest.CaptureFixture[str]) -> Crossfix:
    """Run a command line in this process."""

    def run(*arguments: object) -> Outcome:
        with pytest.raises(SystemExit) as exit_:
            main([str(argument) for argument in arguments])
        printed = capsys.readouterr()
        return Outcome(int(exit_.value.code or 0), printed.out, printed.err)

    return run


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A command as a process of its own, killed at the end if it still runs."""
    process = subprocess.Popen(
        [sys.executable, "-m", "crossfix", *arguments],
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
