"""The Docker engine of this machine, and what it takes to build our image on it."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest

SLIM = "python:3.11-slim"
OURS = "crossfix-base"
STAGE = "label=org.crossfix.stage=build"
PULL_S, BUILD_S, COMMAND_S = 180, 600, 120


def run(
    command: list[str],
    *,
    timeout_s: float = COMMAND_S,
    check: bool = True,
    cwd: Path | None = None,
    **variables: str,
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, with further environment variables; a failure shows all it said."""
    done = subprocess.run(
        command,
        cwd=cwd,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
    said = f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
    assert not check or done.returncode == 0, said[-4000:]
    return done


def docker(*arguments: str, timeout_s: float = COMMAND_S) -> str:
    """What a docker command prints."""
    return run(["docker", *arguments], timeout_s=timeout_s).stdout.strip()


@cache
def compose_command() -> tuple[str, ...]:
    """How compose is called here; skips the test where there is no engine or no compose."""
    if shutil.which("docker") is None:
        pytest.skip("no docker command")
    if (info := run(["docker", "info"], check=False)).returncode:
        pytest.skip(f"no Docker engine: {_last_line(info.stderr)}")
    if run(["docker", "compose", "version"], check=False).returncode == 0:
        return ("docker", "compose")
    if shutil.which("docker-compose") is None:
        pytest.skip("a Docker engine, but no docker compose")
    return ("docker-compose",)


@contextmanager
def base_image(checkout: Path, tag: str) -> Iterator[str]:
    """An image to build ours from: one that is there, or else a pulled or a new one for a while.

    Skips the test where none can be had.
    """
    given = os.environ.get("CROSSFIX_BASE")
    there = [name for name in (given, SLIM, OURS) if name and docker("images", "--quiet", name)]
    if there:
        yield there[0]
        return
    base = _new_base(checkout, tag)
    try:
        yield base
    finally:
        docker("rmi", base)


@contextmanager
def image(checkout: Path, base: str, tag: str) -> Iterator[str]:
    """Our image, built by compose from a checkout; removed with the stages of its building."""
    before = _stages()
    command = [*compose_command(), "build", "hub"]
    variables = {"CROSSFIX_BASE": base, "CROSSFIX_IMAGE": tag}
    run(command, cwd=checkout, timeout_s=BUILD_S, **variables)
    try:
        yield tag
    finally:
        docker("rmi", tag)
        if stages := _stages() - before:
            docker("rmi", *stages)


def _new_base(checkout: Path, tag: str) -> str:
    pull = run(["docker", "pull", "--quiet", SLIM], timeout_s=PULL_S, check=False)
    if pull.returncode == 0:
        return SLIM
    if shutil.which("mmdebstrap") is None or os.geteuid() != 0:
        why = f"no registry ({_last_line(pull.stderr)}), and no mmdebstrap as root to make one"
        pytest.skip(f"no base image: {why}")
    run([str(checkout / "docker" / "base-image.sh"), tag], timeout_s=BUILD_S)
    return tag


def _stages() -> set[str]:
    """Images without a name that the engine's old builder leaves of every stage."""
    command = ("images", "--quiet", "--filter=dangling=true", f"--filter={STAGE}")
    return set(docker(*command).split())


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ["it says nothing"])[-1]
