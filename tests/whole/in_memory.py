"""A whole run in one process: the real nodes in threads, on a bus that loses and scrambles."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from carriers.carrier import Carrier
from carriers.node import CarrierNode
from fusion_center.process.node import FusionNode
from fusion_center.recorder import record_run
from fusion_center.settings import settings_from
from schemas import codec, keys
from schemas.bus.interface import Inbox, Sample
from schemas.bus.member import Buses, Member
from schemas.bus.memory_bus import MemoryNetwork
from schemas.messages import Step
from sim_world.node import Pace, WorldNode
from sim_world.scenario import Scenario
from sim_world.world import World

DEADLINE_S = 60.0


class MemoryRun:
    """World, carriers and fusion centre of a scenario on one `MemoryNetwork`."""

    def __init__(
        self, scenario: Scenario, network: MemoryNetwork, output: Path, **pace: Any
    ) -> None:
        self.scenario, self.network, self.output = scenario, network, output
        self.run = scenario.declared.name
        self.pace = Pace(**pace)
        self.fusion_delay_s = 0.0
        self.hub_timeout_s = 120.0
        self.carriers: dict[str, CarrierNode] = {}
        self.errors: list[BaseException] = []
        self._threads: list[threading.Thread] = []

    def carry_out(self, meanwhile: Callable[[MemoryRun], None] = lambda run: None) -> None:
        """Run to the end; `meanwhile` may make trouble."""
        self._start(self._fusion)
        for carrier in self.scenario.declared.carriers:
            self.start_carrier(carrier.name)
        world = self._start(self._world)
        meanwhile(self)
        world.join(DEADLINE_S)
        assert not world.is_alive(), "the run did not end"
        self.await_threads()
        if self.errors:
            raise self.errors[0]

    def await_threads(self) -> None:
        """Wait for everybody to leave."""
        for thread in self._threads:
            thread.join(10)

    def start_carrier(self, name: str) -> None:
        """Start one carrier: for the first time, or as the next life of one that was killed."""
        member = Member(self.run, name, self._buses(name))
        carrier = Carrier(self.scenario, name)
        node = CarrierNode(member, carrier, hub_timeout_s=self.hub_timeout_s)
        self.carriers[name] = node
        self._start(lambda: self._leave_after(member, node.run))

    def start_fusion(self) -> threading.Thread:
        """Start the fusion centre alone; the world is somebody else."""
        return self._start(self._fusion)

    def kill_carrier(self, name: str) -> None:
        """As kill -9."""
        self.network.kill(name)
        self.carriers[name].stop()

    def await_step(self, step: int) -> None:
        """Return when the world has granted a step."""
        inbox: Inbox[Sample] = Inbox()
        with self.network.bus("viewer") as bus:
            bus.subscribe(keys.STEP.key(self.run), inbox)
            deadline_s = time.monotonic() + DEADLINE_S
            while time.monotonic() < deadline_s:
                for sample in inbox.take(0.1):
                    if codec.decode(Step, sample.payload).step >= step:
                        return
        raise AssertionError(f"step {step} was never granted")

    def _world(self) -> None:
        member = Member(self.run, keys.WORLD, self._buses(keys.WORLD))
        declared, truth = self.scenario.declared, self.scenario.truth
        node = WorldNode(World(self.scenario), declared, truth, member, self.pace)
        self._leave_after(member, node.run)

    def _fusion(self) -> None:
        member = Member(self.run, keys.FUSION, self._buses(keys.FUSION))
        recorder_member = Member(self.run, keys.RECORDER, self._buses(keys.RECORDER))
        recorder, declared = record_run(recorder_member, self.output, 0.25, 10.0)
        settings = settings_from(declared.fusion)
        node = FusionNode(
            member,
            declared,
            settings,
            recorder,
            hub_timeout_s=self.hub_timeout_s,
            delay=lambda: time.sleep(self.fusion_delay_s),
        )
        self._leave_after(member, node.run)
        recorder_member.buses.close()

    def _leave_after(self, member: Member, body: Callable[[], object]) -> None:
        try:
            with member:
                body()
        finally:
            member.buses.close()

    def _buses(self, name: str) -> Buses:
        return Buses(self.network.bus(name), self.network.bus(name))

    def _start(self, body: Callable[[], object]) -> threading.Thread:
        def guarded() -> None:
            try:
                body()
            except BaseException as error:
                self.errors.append(error)

        thread = threading.Thread(target=guarded, daemon=True)
        thread.start()
        self._threads.append(thread)
        return thread
