"""What docs/containers.md tells its reader to type does what it says."""

from __future__ import annotations

from pathlib import Path

import pytest

from schemas import keys
from schemas.bus.zenoh_bus import open_bus
from schemas.messages import Health, Step
from tests.containers.composed import Composed, Onlooker
from tests.project.pages import at, commands

HUB_S, LEAVE_S = 30.0, 30.0
PAGE = "docs/containers.md"
ONCE = [
    "docker compose up",
    "docker compose run --rm --no-deps fusion info recordings/strait.mcap",
    "docker compose run --rm --no-deps fusion verify recordings/strait.mcap --refuse",
    'docker cp "$(docker compose ps --all --quiet fusion)":/crossfix/recordings/strait.mcap .',
    "docker compose down --volumes",
]
MEANWHILE = [
    "crossfix peek 'correction/**' --connect tcp/127.0.0.1:7447",
    "python examples/external_publisher.py --run strait --connect tcp/127.0.0.1:7447",
    "docker compose kill poniente",
    'docker network disconnect crossfix_default "$(docker compose ps --quiet siroco)"',
    'docker network connect crossfix_default "$(docker compose ps --quiet siroco)"',
]
BY_FIXTURES = [
    "docker/base-image.sh",
    "export CROSSFIX_BASE=crossfix-base",
    "PYTHON=.venv/bin/python docker/wheels.sh",
    "docker compose up --build",
]
"""The base image, the wheels and the image are made as these say before all tests here."""
ENOUGH = {"peek": " --count 1"}


def test_every_command_of_the_page_is_run_here() -> None:
    assert {*ONCE, *MEANWHILE, *BY_FIXTURES} == set(commands(PAGE))


def typed(project: Composed, command: str) -> str:
    """What a command of the page prints, typed beside the compose file."""
    command += next((more for word, more in ENOUGH.items() if word in command), "")
    command = command.replace("crossfix_default", project.network)
    return project.shell(at(project.endpoint, command))


@pytest.mark.live
@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_page_is_right(checkout: Path, built: str) -> None:
    with Composed(checkout, built, duration_s=60) as project:
        told = {command: typed(project, command) for command in ONCE}
        assert (checkout / "strait.mcap").stat().st_size > 100_000
        assert not project.container("fusion")
    assert "finished" in told[ONCE[1]]
    assert "all equal to the byte" in told[ONCE[2]]
    with Composed(checkout, built, duration_s=3600) as project:
        project.compose("up", "--detach")
        with open_bus(project.endpoint, HUB_S) as bus:
            seen = Onlooker(bus, keys.STEP, keys.HEALTH)
            seen.await_message(Step, lambda step: step.step >= 20)
            assert "crossfix.Correction" in typed(project, f"{MEANWHILE[0]} --json")
            publisher = project.started(at(project.endpoint, MEANWHILE[1]))
            seen.await_message(Health, lambda h: any("visitor" in line for line in h.news))
            for command, carrier in zip(MEANWHILE[2:4], ("poniente", "siroco"), strict=True):
                typed(project, command)
                seen.await_message(Health, lambda h, lost=carrier: lost in h.lost)
            typed(project, MEANWHILE[4])
        project.compose("stop", "world")
        assert publisher.wait(LEAVE_S) == 0
