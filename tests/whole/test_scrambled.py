"""The same seed gives the same bytes, whatever the bus does to the messages on their way."""

from __future__ import annotations

from pathlib import Path

import pytest

from schemas.bus.memory_bus import MemoryNetwork
from sim_world.scenario import Scenario, parse_scenario
from tests.whole.in_memory import MemoryRun
from tests.whole.recorded import outputs

SCENARIO = Path(__file__).with_name("small.toml")


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return parse_scenario(SCENARIO.read_text(), SCENARIO.name)


@pytest.fixture(scope="module")
def quiet(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, bytes]]:
    path = tmp_path_factory.mktemp("quiet") / "run.mcap"
    with MemoryNetwork() as network:
        MemoryRun(scenario, network, path).carry_out()
    recorded = outputs(path)
    assert len(recorded) == 30 * 4
    return recorded


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_lost_doubled_delayed_and_reordered_messages_change_no_byte(
    scenario: Scenario, quiet: list[tuple[str, bytes]], tmp_path: Path, seed: int
) -> None:
    path = tmp_path / "run.mcap"
    trouble = {"loss": 0.2, "duplicate": 0.2, "delay_s": (0.0, 0.02), "reorder": 0.3}
    with MemoryNetwork(seed, **trouble) as network:
        MemoryRun(scenario, network, path).carry_out()
    assert outputs(path) == quiet
