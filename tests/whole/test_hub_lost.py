"""Nobody waits for ever: not for a hub that stays away, nor beside another world of its run."""

from __future__ import annotations

from pathlib import Path

import pytest

from fusion_center.recorder import thread
from schemas import keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.member import Buses, Member
from schemas.bus.memory_bus import MemoryNetwork
from schemas.bus.patience import HubPatience
from schemas.errors import BusError, LaunchError
from schemas.recording.reader import open_recording
from sim_world.node import Pace, WorldNode
from sim_world.scenario import Scenario, parse_scenario
from sim_world.world import World
from tests.whole.in_memory import MemoryRun
from tests.whole.recorded import outputs
from tests.whole.refusing import refused

SCENARIO = Path(__file__).with_name("small.toml")
TIMEOUT_S = 0.5


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return parse_scenario(SCENARIO.read_text(), SCENARIO.name)


def test_patience_ends_when_the_link_was_down_for_so_long_without_a_break() -> None:
    hub = HubPatience(10.0)
    assert not hub.is_over(True, 0.0)
    assert not hub.is_over(False, 100.0)
    assert not hub.is_over(False, 109.9)
    assert not hub.is_over(True, 109.95)
    assert not hub.is_over(False, 111.0)
    hub.require()
    assert hub.is_over(False, 121.0)
    assert hub.is_over(True, 122.0)
    with pytest.raises(BusError, match=r"away for 10 s.*--hub-timeout"):
        hub.require()


def test_a_run_ends_without_its_hub_and_its_recording_is_sealed(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thread, "FINISH_S", 1.0)
    path = tmp_path / "run.mcap"
    everybody = (keys.WORLD, keys.FUSION, keys.RECORDER, "alpha", "bravo")

    def cut(run: MemoryRun) -> None:
        run.await_step(12)
        for name in everybody:
            run.network.cut(name)

    with MemoryNetwork() as network:
        run = MemoryRun(scenario, network, path, hub_timeout_s=TIMEOUT_S)
        run.hub_timeout_s = TIMEOUT_S
        with pytest.raises(BusError, match=r"hub has been away"):
            run.carry_out(cut)
        run.await_threads()
    assert len(run.errors) == len(everybody) - 1  # the recorder is of the fusion centre
    with open_recording(path) as recording:
        assert recording.end is not None
        assert recording.end.reason == "the hub is lost"
    assert refused(path)[: len(outputs(path))]


@pytest.mark.slow
def test_a_hub_that_comes_back_in_time_ends_nothing(scenario: Scenario, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"

    def cut(run: MemoryRun) -> None:
        run.await_step(12)
        for name in (keys.WORLD, keys.FUSION, keys.RECORDER, "alpha", "bravo"):
            run.network.cut(name)
            run.network.heal(name)

    with MemoryNetwork() as network:
        run = MemoryRun(scenario, network, path, hub_timeout_s=60.0)
        run.hub_timeout_s = 60.0
        run.carry_out(cut)
    assert outputs(path) == refused(path)


def test_a_second_world_of_a_run_is_refused_before_it_says_a_word(scenario: Scenario) -> None:
    run = scenario.declared.name
    heard: Inbox[Sample] = Inbox()
    with MemoryNetwork() as network:
        network.bus("listener").subscribe(keys.everything(run), heard)
        buses = Buses(network.bus("second"), network.bus("second"))
        member = Member(run, keys.WORLD, buses)
        node = WorldNode(World(scenario), scenario.declared, scenario.truth, member, Pace())
        with (
            network.bus("first").announce(keys.alive(run, keys.WORLD, "b1")),
            pytest.raises(LaunchError, match=r"a world of this run is alive.*another --run"),
        ):
            node.run()
        assert heard.take() == []
        node.stop("it may run now")
        assert node.run() == "it may run now"
