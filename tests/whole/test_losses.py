"""Carriers die, come back, links fall: the run goes on, says so, and re-fuses to the same bytes."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from schemas import codec, keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.memory_bus import MemoryNetwork
from schemas.feedback import WINDOW
from schemas.messages import Ack, Closed, Step
from sim_world.scenario import Scenario, parse_scenario
from tests.whole.in_memory import MemoryRun
from tests.whole.recorded import messages, outputs
from tests.whole.refusing import refused

SCENARIO = Path(__file__).with_name("small.toml")
STEPS = 30


@pytest.fixture
def scenario() -> Scenario:
    return parse_scenario(SCENARIO.read_text(), SCENARIO.name)


def closed(path: Path) -> list[Closed]:
    return list(messages(path, keys.CLOSED_FUSION, Closed))


def test_a_killed_carrier_is_named_lost_and_its_next_life_joins(
    scenario: Scenario, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"

    def kill_and_restart(run: MemoryRun) -> None:
        run.await_step(8)
        run.kill_carrier("bravo")
        run.await_step(12)
        run.start_carrier("bravo")

    with MemoryNetwork(1, delay_s=(0.0, 0.01)) as network:
        MemoryRun(scenario, network, path).carry_out(kill_and_restart)
    steps = closed(path)
    assert [c.step for c in steps] == list(range(1, STEPS + 1))
    assert [c.lost for c in steps if c.lost] == [["bravo"]]
    joined = [c.step for c in steps if "bravo" in c.joined]
    assert joined[0] == 1
    assert len(joined) == 2
    boots = {e.boot for c in steps for e in c.manifest if e.carrier == "bravo"}
    assert len(boots) == 2
    assert outputs(path) == refused(path)


def test_a_hub_that_is_gone_for_a_second_costs_no_message(
    scenario: Scenario, tmp_path: Path
) -> None:
    quiet, path = tmp_path / "quiet.mcap", tmp_path / "run.mcap"
    with MemoryNetwork() as network:
        MemoryRun(scenario, network, quiet).carry_out()

    def outage(run: MemoryRun) -> None:
        run.await_step(10)
        names = ["alpha", "bravo", "fusion", "recorder", "world"]
        for name in names:
            network.cut(name)
        time.sleep(1.0)
        for name in names:
            network.heal(name)

    with MemoryNetwork(2, delay_s=(0.0, 0.01)) as network:
        MemoryRun(scenario, network, path).carry_out(outage)
    assert not [c for c in closed(path) if c.lost or c.gave_up]
    assert outputs(path) == outputs(quiet)


def test_a_paced_run_closes_every_step_and_refuses_to_the_same_bytes(
    scenario: Scenario, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    trouble = {"loss": 0.1, "duplicate": 0.1, "delay_s": (0.0, 0.05), "reorder": 0.2}
    with MemoryNetwork(3, **trouble) as network:
        MemoryRun(scenario, network, path, rate=20.0).carry_out()
    assert [c.step for c in closed(path)] == list(range(1, STEPS + 1))
    assert outputs(path) == refused(path)


def test_a_slow_fusion_centre_holds_the_world_back(scenario: Scenario, tmp_path: Path) -> None:
    """In lock-step nothing piles up: at most the window is granted beyond what is fused."""
    path = tmp_path / "run.mcap"
    inbox: Inbox[Sample] = Inbox()
    with MemoryNetwork() as network:
        run = MemoryRun(scenario, network, path)
        run.fusion_delay_s = 0.03
        viewer = network.bus("viewer")
        viewer.subscribe(keys.STEP.key(run.run), inbox)
        viewer.subscribe(keys.ACK.key(run.run, keys.FUSION), inbox)
        run.carry_out()
    fused, leads = 0, []
    for sample in inbox.take():
        if keys.parse(sample.key).topic is keys.ACK:
            fused = max(fused, codec.decode(Ack, sample.payload).step)
        else:
            leads.append(codec.decode(Step, sample.payload).step - fused)
    assert max(leads) in (WINDOW, WINDOW + 1)
    assert len(closed(path)) == STEPS
